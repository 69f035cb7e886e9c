"""Types that cross the layers: problems and solvers on one side, runner, results and reports on the other.

Arrows point one way: ``harness.mechanics <- harness.types <- problems, solvers <- harness.execution <- reports``.
"""

from ..mechanics.presentation import Presentation
from ..mechanics.state import State, States
from .problem import Invariant, Observable, Problem, Reference, ReferenceKind, Trait, kind_of
from .solver import LEAST_RTOL, Solver, Spool, StepControl, Trajectory
from .verdicts import ACCURATE, ALLOWED, GROWN, JUDGED, PREDICTABLE, EndedBy, Law, NotInstalled, Reason, Status

__all__ = ["ACCURATE", "ALLOWED", "GROWN", "JUDGED", "LEAST_RTOL", "PREDICTABLE", "EndedBy", "Invariant", "Law",
           "NotInstalled", "Observable", "Presentation", "Problem", "Reason", "Reference", "ReferenceKind", "Solver",
           "Spool", "State", "States", "Status", "StepControl", "Trait", "Trajectory", "kind_of"]  # fmt: skip
