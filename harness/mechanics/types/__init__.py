"""Define types that cross the layers: problems and solvers on one side, runner, results and reports on the other.

Imports point one way: ``mechanics <- mechanics.types <- catalogue <- problems, solvers <- judge <- run``.
"""

from ..presentation import Presentation
from ..state import State, States
from .problem import Invariant, Observable, Problem, Reference, ReferenceKind, Trait, classify_reference
from .solver import LEAST_RTOL, Solver, Spool, StepControl, Trajectory
from .verdicts import (
    ACCURATE,
    ALLOWED,
    GROWN,
    JUDGED,
    PASSAGE,
    PREDICTABLE,
    RIGHT_REACTION,
    EndCause,
    Law,
    NotInstalled,
    Reason,
    Status,
)

__all__ = [
    "ACCURATE",
    "ALLOWED",
    "GROWN",
    "JUDGED",
    "LEAST_RTOL",
    "PASSAGE",
    "PREDICTABLE",
    "RIGHT_REACTION",
    "EndCause",
    "Invariant",
    "Law",
    "NotInstalled",
    "Observable",
    "Presentation",
    "Problem",
    "Reason",
    "Reference",
    "ReferenceKind",
    "Solver",
    "Spool",
    "State",
    "States",
    "Status",
    "StepControl",
    "Trait",
    "Trajectory",
    "classify_reference",
]
