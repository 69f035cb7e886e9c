"""RATTLE on the rotation group with the free rigid body as drift, plain or composed to orders 4, 6 and 8.

McLachlan, Modin, Verdier, Wilkins (2014), SIAM J. Sci. Comput. 36: half a kick by forces and constraints, free motion
of every body (exact where two principal inertias are equal), half a kick by forces, velocities projected. Symplectic
and time-reversible; phi and A v at rounding in every step. Compositions: Suzuki (1990), Kahan and Li (1997).
"""

from dataclasses import dataclass, replace

from ..harness.catalogue.options import option
from ..harness.catalogue.registry import solver
from ..harness.mechanics.types import Problem, StepControl, Trajectory
from .formulations.compiled.host import WITH_PLAIN, HolonomicMarchedSolver, Method, code_option, run_plainly
from .formulations.methods.compositions import COMPOSITIONS, RATE
from .formulations.methods.rattle import make_rattle_method
from .plain import rattle

HOW = "plain (order 2), or composed: Suzuki's five steps (4), Kahan and Li's nine (6) or seventeen (8)"


@solver("rattle")
@dataclass(frozen=True)
class Rattle(HolonomicMarchedSolver):
    """Symplectic, time-reversible steps of fixed size with exact constraints."""

    composition: str = option("plain", HOW, choices=tuple(COMPOSITIONS))
    rate: float = option(0.0, RATE, "rad/s", at_least=0.0)
    tolerance: float = option(
        1e-13, "tolerance on phi in a step's iteration, at least 16 roundings (axis rows: no unit)", "m", above=0.0
    )
    code: str = code_option(*WITH_PLAIN)

    @property
    def order(self) -> float:
        """Order of the method: 2, or that of the composition."""
        return float(COMPOSITIONS[self.composition][1])

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Return why the problem is refused, or None.

        Causes: options that plain steps do not have, rows without phi, or code=mechanism where none can be made.
        """
        if self.code == "plain" and (self.composition != "plain" or self.rate):
            return "plain steps are those of order 2 of one size: leave out composition and rate"
        return super().refuses(problem, control)

    def _make_method(self, problem: Problem, control: StepControl) -> Method:
        """Return RATTLE's method, or a composition of it, with the solver's options."""
        method = make_rattle_method(problem, COMPOSITIONS[self.composition][0], self.tolerance, rate=self.rate)
        return replace(method, code=self.code)

    def _integrate_plain(self, problem: Problem, control: StepControl) -> Trajectory:
        """Integrate by the same steps in plain NumPy."""
        return run_plainly(rattle.integrate, problem, control, self.tolerance)
