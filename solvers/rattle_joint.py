"""RATTLE on Hamilton's equations in joint coordinates, by code made for the mechanism.

Andersen (1983); Hairer, Lubich, Wanner (2006), VII.1.4: half a kick at the start and half a one at the end, each by the
slope of the energy at the momentum of the middle; H depends on q, so both halves are implicit. Rows of joints that close
loops hold at the ends of steps, as phi and as phi_dot; the unit length of a ball's quaternion is a row, too.

Order two, symplectic and time-reversible for trees and for loops, as long as no damper, load of time or drive acts, to
the rounding to which steps converge. Where rows of loops depend on each other, those that are independent at the start
hold; the run ends where their rank changes. Making the code is set-up.
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
        """Rows without phi, user forces, and mechanisms that need too much code."""
        return refusal(problem)

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        """March in steps of ``control.dt``."""
        return integrate(problem, control, rattle(), radial=True)
