"""RATTLE on Hamilton's equations in joint coordinates, by code made for the mechanism.

Andersen (1983); Hairer, Lubich, Wanner (2006), VII.1.4: the momentum of the middle by the slope of the energy at the
start, coordinates by the mean velocity of both ends, the momentum of the end by the slope there. H depends on q, so
that all three are implicit. phi and phi_dot of loops vanish at the ends of steps; |x|^2 = 1 of a ball's quaternion is
a row. The spin of slender bodies that balls on their axes hold is added exactly (``joint_coordinates.spins``), since
steps would have no solution where they turn fast.

Order two; symplectic and time-reversible, for trees and for loops, to the rounding at which the iteration of a step
ends. With dampers, loads, drives or user forces the order holds, and no claim on energy. Of rows that depend on each
other, independent ones hold; others are chosen, at the end of a step, where their pivots are poor.

Above 30,000 operations, and with user forces, a recursion over bodies as data takes the place of code (``recursion``).
"""

from dataclasses import dataclass
from typing import ClassVar

from ..harness.catalogue.registry import solver
from ..harness.types import Problem, StepControl, Trajectory
from .formulations.joint_coordinates.collocation import rattle
from .formulations.joint_coordinates.symplectic import integrate, refusal


@solver("rattle_joint")
@dataclass(frozen=True)
class RattleJoint:
    """RATTLE in joint coordinates, symplectic steps of fixed size."""

    name: ClassVar[str]
    paper_label: ClassVar[str] = ""
    control: ClassVar[str] = "dt"
    order: ClassVar[float] = 2.0

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Return the refusal of rows without phi, and of a large mechanism with many closed loops, or None."""
        return refusal(problem)

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        """Integrate with the fixed step ``control.dt``."""
        return integrate(problem, control, rattle(), radial=True)
