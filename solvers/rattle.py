"""RATTLE on the rotation group with the free rigid body as drift, plain or composed to orders 4, 6 and 8.

McLachlan, Modin, Verdier, Wilkins (2014), SIAM J. Sci. Comput. 36: half a kick by forces and constraints, free motion
of every body (exact where two principal inertias are equal), half a kick, velocities projected. Symplectic and
time-reversible; phi and A v at rounding in every step. Compositions: Suzuki (1990), Kahan and Li (1997).
"""

from dataclasses import dataclass, replace
from typing import ClassVar

from ..harness.catalogue.options import option
from ..harness.catalogue.registry import solver
from ..harness.types import Problem, StepControl, Trajectory
from .formulations.compiled.host import integrate, tolerance_of
from .formulations.methods.compositions import COMPOSITIONS, RATE
from .formulations.methods.rattle import symplectic_steps
from .formulations.refusals import without_phi

HOW = "plain (order 2), or composed: Suzuki's five steps (4), Kahan and Li's nine (6) or seventeen (8)"


@solver("rattle")
@dataclass(frozen=True)
class Rattle:
    """Symplectic, time-reversible steps of fixed size with exact constraints."""

    composition: str = option("plain", HOW, choices=tuple(COMPOSITIONS))
    rate: float = option(0.0, RATE, "rad/s", at_least=0.0)
    tolerance: float = option(
        1e-13, "tolerance on phi in a step's iteration, at least 16 roundings (axis rows: no unit)", "m", above=0.0
    )

    name: ClassVar[str]
    paper_label: ClassVar[str] = ""
    control: ClassVar[str] = "dt"

    @property
    def order(self) -> float:
        """2, or that of the composition."""
        return float(COMPOSITIONS[self.composition][1])

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Rows without phi; redundant rows are dropped as they appear."""
        return without_phi(problem.system)

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        """March with the fixed step ``control.dt``."""
        gamma = COMPOSITIONS[self.composition][0]
        tolerance, notes = tolerance_of(self.tolerance, problem)
        method = symplectic_steps(problem.system, gamma, tolerance, rate=self.rate)
        return integrate(problem, control, replace(method, notes=notes))
