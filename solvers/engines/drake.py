"""Drake: joint coordinates of a tree, discrete steps or integrators of its continuous plant, its own compiled loop.

Discrete steps are of first order: each solves a convex problem (sap; similar and lagged are newer approximations of
contact in it) or applies TAMSI. Integrators take fixed steps here; ``drake_adaptive`` runs them with error control.
Loops are ball constraints of the convex steps, which regularise them; a continuous plant and TAMSI do not enforce them,
so that loops are refused there, as are loops cut at the ground, at which Drake crashes. With ``settings`` "default" the
steps are those of an unconfigured plant: lagged.
"""

from dataclasses import dataclass
from typing import ClassVar

from ...harness.catalogue.options import option
from ...harness.catalogue.registry import solver
from ...harness.mechanics.cut_trees.tree import DRIVES, build_spanning_tree
from ...harness.mechanics.joints import JointKind, MovingKind
from ...harness.mechanics.system import GROUND
from ...harness.mechanics.types import Problem, StepControl
from .export.engine import SupportedElements
from .export.protocol import Adapter

DISCRETE = ("sap", "similar", "lagged", "tamsi")
INTEGRATORS = {
    "runge_kutta3": 3.0,
    "runge_kutta5": 5.0,
    "runge_kutta2": 2.0,
    "bogacki_shampine3": 3.0,
    "explicit_euler": 1.0,
    "semi_explicit_euler": 1.0,
    "implicit_euler": 1.0,
    "velocity_implicit_euler": 1.0,
    "radau1": 1.0,
    "radau3": 3.0,
    "cenic": 1.0,
    **dict.fromkeys(DISCRETE, 1.0),
}

TAKEN = SupportedElements(
    loads="varying",  # applied by a system in Python
    lacks={
        **dict.fromkeys(DRIVES, "its joints can be locked, not driven"),
        JointKind.DISTANCE: "its continuous plant ignores it and its discrete steps regularise it",
        MovingKind.ROLLING: "its contacts are regularised",
        "rack and pinion": "its couplers of coordinates are regularised",
    },
)


@solver("drake")
@dataclass(frozen=True)
class Drake(Adapter):
    """Drake's discrete or continuous plant with fixed steps."""

    integrator: str = option("runge_kutta3", "Drake's name of it, or of its discrete steps", choices=tuple(INTEGRATORS))
    settings: str = option("ours", "ours: the options above; default: the engine's own", choices=("ours", "default"))

    inside: ClassVar[str] = "drake"
    package: ClassVar[str] = "pydrake"
    wheel: ClassVar[str] = "drake"
    takes: ClassVar[SupportedElements] = TAKEN

    @property
    def order(self) -> float:
        """Observed order of the chosen fixed steps; 1 with the default settings."""
        return 1.0 if self.settings == "default" else INTEGRATORS[self.integrator]

    def _refuse_options(self, problem: Problem, control: StepControl) -> str | None:
        """Return why the chosen steps cannot enforce the closed loops of the problem, or None if they can."""
        return refuse_loops(problem, "lagged" if self.settings == "default" else self.integrator)


def refuse_loops(problem: Problem, integrator: str) -> str | None:
    """Return why an integrator, or discrete scheme, cannot enforce the closed loops of a problem, or None.

    ``integrator`` is a key of ``INTEGRATORS``. Only sap, similar and lagged can, for loops that are not cut at the
    ground; a problem without loops is never refused.
    """
    cuts = build_spanning_tree(problem.system, problem.initial).cuts
    if integrator in ("sap", "similar", "lagged"):
        to_ground = any(GROUND in (cut.i, cut.j) for cut in cuts)
        return "a loop is cut at the ground, and Drake's ball constraints to the world crash it" if to_ground else None
    if not cuts:
        return None
    why = {"tamsi": "TAMSI has no constraints", "cenic": "CENIC has no ball constraints"}
    kind = why.get(integrator, "its continuous plant ignores constraints")
    return f"the system has loops, and {kind}: use sap, similar or lagged (integrator={integrator})"
