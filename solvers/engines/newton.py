"""Newton: the engine of NVIDIA, Google DeepMind and Disney on a CPU, in single precision, stepped by a loop in Python.

``Featherstone`` has joint coordinates and semi-implicit Euler steps; ``MuJoCo`` is MuJoCo Warp under Newton's model;
``XPBD`` and ``Kamino`` have six coordinates per body and find joint forces by iteration, so that their joints show
gaps. Points of cut joints are ball joints outside the tree, which Featherstone ignores. Joint armature is zero.

The model check compares accelerations of Featherstone and Kamino (``export.stepping``). XPBD computes none: it moves
bodies and derives velocities from that. For XPBD and MuJoCo it compares Newton's model by MuJoCo's forces
(``export.model_check``). With ``settings`` "default" all else is as the solver ships, for example Featherstone's
angular_damping of 0.05.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

from ...harness.catalogue.options import option
from ...harness.catalogue.registry import solver
from ...harness.mechanics.cut_trees.tree import DRIVES, build_spanning_tree
from ...harness.mechanics.joints import JointKind
from ...harness.mechanics.types import Problem, StepControl
from .export.engine import LOADS, SPRINGS, TORSIONS, VARYING, SupportedElements
from .export.protocol import Adapter
from .export.stepping import BodyAdapter

SOLVERS = ("Featherstone", "MuJoCo", "XPBD", "Kamino")
MUJOCO = ("euler", "implicitfast", "rk4")
MANY = 100  # iterations at the model check


@solver("newton")
@dataclass(frozen=True)
class Newton(BodyAdapter):
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
    checks_random_velocities: ClassVar[bool] = True
    stretch: ClassVar[int] = 50

    @property
    def order(self) -> float:
        """Order of the integrator, observed where the rounding of single precision is negligible."""
        return 4.0 if (self.solver, self.integrator, self.settings) == ("MuJoCo", "rk4", "ours") else 1.0

    def compare_model(self, problem: Problem, control: StepControl) -> str | None:
        """Return the refusal of a model that differs from this project's equations, or None if they agree.

        Featherstone and Kamino are compared by the accelerations of their steps, MuJoCo and XPBD by the forces in
        Newton's model.
        """
        of_steps = self.solver in ("Featherstone", "Kamino")
        return super().compare_model(problem, control) if of_steps else Adapter.compare_model(self, problem, control)

    def stiffen(self) -> "Newton":
        """Return this solver for the model check: without damping or stabilisation, Kamino with ``MANY`` iterations."""
        return replace(self, settings="ours", max_iterations=MANY, alpha=0.0)

    def _refuse_options(self, problem: Problem, control: StepControl) -> str | None:
        """Return why Featherstone cannot solve a problem with closed loops, or None."""
        if self.solver == "Featherstone" and build_spanning_tree(problem.system, problem.initial).cuts:
            return "the system has loops, and Newton's Featherstone ignores them: use solver=MuJoCo, XPBD or Kamino"
        return None
