"""Gauss collocation of orders 4 to 12 on Hamilton's equations in joint coordinates, by code made for the mechanism.

Hairer, Lubich, Wanner (2006), II.1.3, VI.4, VIII.6. Unknowns are angles and lengths of a spanning tree's joints, with
their momenta; a spherical joint has a quaternion x with four momenta, a canonical system in R^8 without chart, hence
without singularity: |x|^2 is a quadratic invariant, which Gauss methods conserve. Joints that close loops are rows at
the nodes of Lobatto, with velocities closed at the ends of steps: the Gauss-Lobatto SPARK methods of Jay (2007), SIAM
J. Numer. Anal. 45, also of order 2 s.

The method is symplectic and time-reversible, for trees and for loops, to the rounding at which the iteration of a step
ends; energy is not conserved exactly, but does not drift. With dampers, loads, drives or user forces the order remains,
and nothing is claimed on energy. Of rows that depend on each other, independent ones are used; others are chosen, at
the end of a step, where their pivots are poor.

Above 30,000 operations, and with user forces, a recursion over bodies as data replaces the code (``recursion``).
"""

from dataclasses import dataclass
from typing import ClassVar

from ..harness.catalogue.options import option
from ..harness.catalogue.registry import solver
from ..harness.mechanics.types import Problem, StepControl, Trajectory
from .formulations.joint_coordinates.collocation import make_gauss_lobatto_tableau
from .formulations.joint_coordinates.symplectic import integrate, refuse_problem


@solver("gauss_joint")
@dataclass(frozen=True)
class GaussJoint:
    """Gauss collocation in joint coordinates, symplectic steps of fixed size."""

    stages: int = option(4, "number of stages s: the order is 2 s", choices=(2, 3, 4, 5, 6))
    name: ClassVar[str]
    paper_label: ClassVar[str] = ""
    control: ClassVar[str] = "dt"

    @property
    def order(self) -> float:
        """Order of the method, twice the number of stages."""
        return 2.0 * self.stages

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Return the refusal of rows without phi, and of a large mechanism with many closed loops, or None."""
        return refuse_problem(problem)

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        """Integrate with the fixed step ``control.dt`` and return the trajectory."""
        return integrate(problem, control, make_gauss_lobatto_tableau(self.stages))
