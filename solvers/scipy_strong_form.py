"""Methods of scipy on the strong form, Eq. (65): those of ``rk45_strong_form``, the paper's choice, and others.

Explicit are DOP853 and the pairs of Bogacki and Shampine, and of Dormand and Prince; implicit are Radau IIA of order 5
and BDF, with Jacobians by differences; LSODA switches between Adams and BDF. rtol = atol on p, u; lam and lam_dot,
quadratures that affect nothing else, are left out of the error test.

Counted are accepted steps and evaluations, which include those for Jacobians and, except for the explicit pairs, one
per step for the reaction.
"""

from dataclasses import dataclass

import scipy.integrate as si

from ..harness.catalogue.options import option
from ..harness.catalogue.registry import solver
from ..harness.mechanics.types import Problem, StepControl, Trajectory
from .formulations.recording import Clock
from .formulations.strong_ode import StrongOptions, integrate

METHODS = {m.__name__: m for m in (si.DOP853, si.RK23, si.RK45, si.Radau, si.BDF, si.LSODA)}


@solver("scipy_strong_form")
@dataclass(frozen=True)
class ScipyStrongForm(StrongOptions):
    """A method of scipy on Eq. (65)."""

    method: str = option("DOP853", "method of scipy.integrate", choices=tuple(METHODS))

    def _integrate(self, problem: Problem, control: StepControl, clock: Clock) -> Trajectory:
        """Integrate Eq. (65) by the scipy method of the option ``method``, and return the trajectory."""
        return integrate(problem, control, METHODS[self.method], self, lambda_in_test=False, clock=clock)
