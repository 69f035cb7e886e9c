"""Half-explicit Runge-Kutta method HEM4 of Brasey and Hairer on index 2, order 4, five stages.

Brasey and Hairer (1993), SIAM J. Numer. Anal. 30; Hairer and Wanner (1996), VII.6. The method is explicit in poses and
velocities; only the multipliers of each stage are solved for, such that A v = 0 holds at the next stage. Rotations are
integrated by rotation vectors of the step (Munthe-Kaas 1999). The end of each step is projected onto phi = 0, then onto
A v = 0. Recorded reactions are those of index 1 there. Redundant rows get a multiplier of zero.
A(Q_{i+1}) M^-1 A(Q_i)^T must be regular; singular passages between the stages are crossed.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

from ..harness.catalogue.options import option
from ..harness.catalogue.registry import solver
from ..harness.mechanics.types import Problem, StepControl, Trajectory
from .formulations.compiled.host import WITH_PLAIN, MarchedSolver, Method, code_option, refuse_unused
from .formulations.methods.half_explicit import make_half_explicit_method
from .plain import half_explicit


@solver("half_explicit")
@dataclass(frozen=True)
class HalfExplicit(MarchedSolver):
    """Half-explicit steps of fixed size and order 4 on index 2, projected."""

    tolerance: float = option(
        1e-11, "tolerance on the last correction of a stage's velocities (m/s, rad/s)", "m/s", above=0.0
    )
    code: str = code_option(*WITH_PLAIN)

    order: ClassVar[float] = 4.0

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Return why the problem is refused, or None.

        Causes: a tolerance, which plain steps ignore, or code=mechanism where none can be made.
        """
        return refuse_unused(self, "tolerance") or super().refuses(problem, control)

    def _make_method(self, problem: Problem, control: StepControl) -> Method:
        """Return the half-explicit method with the solver's options."""
        method = make_half_explicit_method(self.tolerance)
        return replace(method, code=self.code)

    def _integrate_plain(self, problem: Problem, control: StepControl) -> Trajectory:
        """Integrate by the same steps in plain NumPy."""
        return half_explicit.integrate(problem, control)
