"""Newton (NVIDIA, Google DeepMind, Disney): its solvers on a CPU, in single precision, stepped by a loop in Python.

``Featherstone`` has joint coordinates and semi-implicit Euler steps; ``MuJoCo`` is MuJoCo Warp under Newton's model;
``XPBD`` and ``Kamino`` have six coordinates a body, and find joint forces by iteration: gaps of joints are theirs.
Points of cut joints are ball joints outside of the tree, which Featherstone does not know. Joint armature is zero.
Accelerations of Featherstone and Kamino are compared (``export.stepping``). XPBD has none: it moves bodies and takes
velocities from that: what is compared is the model that it is given, by MuJoCo's forces (``export.model_check``).
With ``settings`` "default" all else is as the solver ships: Featherstone's angular_damping 0.05 for one.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

from ...harness.catalogue.options import option
from ...harness.catalogue.registry import solver
from ...harness.mechanics.joints import JointKind
from ...harness.types import Problem, StepControl
from .export.engine import LOADS, SPRINGS, TORSIONS, VARYING, SupportedElements
from .export.protocol import Adapter
from .export.stepping import Stepped
from .export.tree import DRIVES, spanning_tree

SOLVERS = ("Featherstone", "MuJoCo", "XPBD", "Kamino")
MUJOCO = ("euler", "implicitfast", "rk4")
MANY = 100  # iterations at the model check


@solver("newton")
@dataclass(frozen=True)
class Newton(Stepped):
    """Newton's solvers on a CPU."""

    solver: str = option("Featherstone", "Newton's solver", choices=SOLVERS)
    integrator: str = option("rk4", "integrator (solver=MuJoCo only)", choices=MUJOCO)
    iterations: int = option(50, "XPBD iterations per step (solver=XPBD only)", at_least=1)
    joint_relaxation: float = option(
        0.4, "joint_linear_relaxation and joint_angular_relaxation of solver=XPBD, which ships 0.7 and 0.4", above=0.0
    )
    max_iterations: int = option(200, "iterations per step (solver=Kamino only)", at_least=1)
    alpha: float = option(0.01, "stabilisation of solver=Kamino", at_least=0.0, at_most=1.0)
    time_constant: float = option(2.0, "time constant of loops, in steps (solver=MuJoCo only)", at_least=2.0)
    impedance: float = option(0.99, "impedance of loops (solver=MuJoCo only)", at_least=1e-4, at_most=0.9999)
    settings: str = option("ours", "ours: the options above; default: the engine's own", choices=("ours", "default"))

    inside: ClassVar[str] = "newton"
    package: ClassVar[str] = "newton"
    wheel: ClassVar[str] = "newton"
    takes: ClassVar[SupportedElements] = SupportedElements(
        springs=False,
        torsions=False,
        lacks={
            SPRINGS: "its springs are of particles",
            TORSIONS: "not all its solvers know those of joints",
            JointKind.DISTANCE: "not all its solvers know it",
            **dict.fromkeys((LOADS, VARYING), "forces are what its caller sets at each step"),
            **dict.fromkeys(DRIVES, "its joints have targets, not prescribed motions"),
        },
    )
    moving: ClassVar[bool] = True
    stretch: ClassVar[int] = 50

    @property
    def order(self) -> float:
        """Order of its steps, as long as single precision does not show."""
        return 4.0 if (self.solver, self.integrator, self.settings) == ("MuJoCo", "rk4", "ours") else 1.0

    def compare_model(self, problem: Problem, control: StepControl) -> str | None:
        """Return how the solver's accelerations, or those of the model that it is given, differ from ours, or None."""
        of_steps = self.solver in ("Featherstone", "Kamino")
        return super().compare_model(problem, control) if of_steps else Adapter.compare_model(self, problem, control)

    def stiffest(self) -> "Newton":
        """Return the same model without the damping of a default, its iterations many."""
        return replace(self, settings="ours", max_iterations=MANY, alpha=0.0)

    def _cannot(self, problem: Problem, control: StepControl) -> str | None:
        """Return why Featherstone cannot take a problem with loops, or None."""
        if self.solver == "Featherstone" and spanning_tree(problem.system, problem.initial).cuts:
            return "the system has loops, and Newton's Featherstone ignores them: use solver=MuJoCo, XPBD or Kamino"
        return None
