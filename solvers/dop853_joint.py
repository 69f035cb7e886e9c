"""DOP853, the pair 8(5,3) of Hairer, Norsett and Wanner (1993), in joint coordinates, by code made for the mechanism.

Unknowns are relative coordinates of a spanning tree's joints, with quaternions for spherical joints; H u_dot + b =
J^T lam, J u_dot = -gamma, with H by composite bodies, b by the recursive Newton-Euler algorithm (Featherstone 2008,
ch. 5, 6, 8), J of the joints that close loops. They are written out as straight-line code for the mechanism, in which
constants are folded: a planar mechanism has planar code. Rows that depend on others at the start are left out. After
every accepted step coordinates are projected onto phi = 0 and velocities onto phi_dot = 0 by the least change in the
metric of H. Making the code is set-up.

Above 30,000 operations, and with user forces, a recursion over bodies replaces that code (``recursion``): the tree is
data, the cost is proportional to the number of bodies, and the rows of loops, up to 600, have a dense factor.
"""

from dataclasses import dataclass
from typing import ClassVar

from ..harness.catalogue.registry import solver
from ..harness.mechanics.joint_expressions import ExpressionWriter
from ..harness.mechanics.types import Problem, StepControl, Trajectory
from .formulations.joint_coordinates.choice import refuse_loop_rows
from .formulations.joint_coordinates.expressions import WRITER
from .formulations.joint_coordinates.marching import integrate


@solver("dop853_joint")
@dataclass(frozen=True)
class Dop853Joint:
    """DOP853 in joint coordinates, error control."""

    name: ClassVar[str]
    paper_label: ClassVar[str] = ""
    control: ClassVar[str] = "rtol"
    expressions: ClassVar[ExpressionWriter] = WRITER  # offered to experiments

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Return the refusal of a large mechanism with many closed loops, or None."""
        return refuse_loop_rows(problem)

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        """Integrate with error control at ``control.rtol`` and return the trajectory."""
        return integrate(problem, control)
