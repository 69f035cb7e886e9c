"""Lie-group variational integrator of second order with the discrete free body of Moser and Veselov.

Moser and Veselov (1991), Commun. Math. Phys. 139; Lee, Leok and McClamroch (2007), Comput. Methods Appl. Mech. Eng.
196: the discrete Euler-Lagrange equations with kinetic energy by chords, potential energy by the trapezoidal rule, and
rows at the ends of steps. In momentum form these are RATTLE's equations with another free body: symplectic,
time-reversible, spatial momentum conserved, phi and A v at rounding. Redundant rows get a multiplier of zero.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

from ..harness.catalogue.options import option
from ..harness.catalogue.registry import solver
from ..harness.mechanics.types import Problem, StepControl, Trajectory
from .formulations.compiled.host import WITH_PLAIN, HolonomicMarchedSolver, Method, code_option, run_plainly
from .formulations.methods.compositions import COMPOSITIONS
from .formulations.methods.rattle import make_rattle_method
from .plain import rattle


@solver("lie_variational")
@dataclass(frozen=True)
class LieVariational(HolonomicMarchedSolver):
    """Discrete Euler-Lagrange equations on the rotation group, fixed steps, exact constraints."""

    tolerance: float = option(
        1e-13, "tolerance on phi in a step's iteration, at least 16 roundings (axis rows: no unit)", "m", above=0.0
    )
    code: str = code_option(*WITH_PLAIN)
    order: ClassVar[float] = 2.0

    def _make_method(self, problem: Problem, control: StepControl) -> Method:
        """Return RATTLE's method with Moser and Veselov's discrete free body."""
        method = make_rattle_method(problem, COMPOSITIONS["plain"][0], self.tolerance, discrete=True)
        return replace(method, code=self.code)

    def _integrate_plain(self, problem: Problem, control: StepControl) -> Trajectory:
        """Integrate by the same steps in plain NumPy."""
        return run_plainly(rattle.integrate, problem, control, self.tolerance, discrete=True)
