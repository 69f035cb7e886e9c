"""RATTLE on Hamilton's equations in joint coordinates, by code made for the mechanism.

Andersen (1983); Hairer, Lubich, Wanner (2006), VII.1.4: the momentum at mid-step by the slope of the energy at the
start, coordinates by the mean velocity of both ends, the momentum at the end by the slope there. The kinetic energy
depends on q, so that steps are implicit. phi and phi_dot of loops vanish at the ends of steps; |x|^2 = 1 of the
quaternion of a spherical joint is a row. The free spin of slender bodies about an axis through their spherical joints
is added exactly (``joint_coordinates.spins``), since steps would have no solution where they spin fast.

The method is of order two; symplectic and time-reversible, for trees and for loops, to the rounding at which the
iteration of a step ends. With dampers, loads, drives or user forces the order remains, and nothing is claimed on
energy. Of rows that depend on each other, independent ones are used; others are chosen, at the end of a step, where
their pivots are poor.

Above 30,000 operations, and with user forces, a recursion over bodies as data replaces the code (``recursion``).
"""

from dataclasses import dataclass
from typing import ClassVar

from ..harness.catalogue.registry import solver
from ..harness.mechanics.types import Problem, StepControl, Trajectory
from .formulations.joint_coordinates.collocation import make_rattle_tableau
from .formulations.joint_coordinates.symplectic import integrate, refuse_problem


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
        return refuse_problem(problem)

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        """Integrate with the fixed step ``control.dt`` and return the trajectory."""
        return integrate(problem, control, make_rattle_tableau(), radial=True)
