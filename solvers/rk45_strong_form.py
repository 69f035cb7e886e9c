"""Dormand-Prince 5(4) on the strong form, Eq. (65): the paper's ODE-45 (Sect. 4.1).

    y = (p, u, lam, lam_dot),   y' = (G u, u_dot, lam_dot, lam_ddot)   with u_dot, lam_ddot from Eq. (65)

explicit, error per step, rtol = atol. Without springs and dampers C_bar = K_bar = 0: the constraints hold through
phi_ddot = 0 alone, and phi drifts with the integration error. ``c_bar`` and ``k_bar`` give every row its own, and phi
decays as (M_bar phi_dot)' + C_bar phi_dot + K_bar phi = 0, Eq. (64). ``alpha`` and ``beta`` add Baumgarte's terms,
which the paper's strong form does not have. lam and lam_dot are quadratures that affect nothing else
(``strong_form``), so by default they are left out of the error test.

Counted are accepted steps and evaluations, from which rejected steps follow: an attempted step takes six evaluations,
the start two.
"""

from dataclasses import dataclass
from typing import ClassVar

from scipy.integrate import RK45

from ..harness.catalogue.options import option
from ..harness.catalogue.registry import solver
from ..harness.mechanics.types import Problem, StepControl, Trajectory
from .formulations.recording import Clock
from .formulations.strong_ode import StrongOptions, integrate


@solver("rk45_strong_form")
@dataclass(frozen=True)
class Rk45StrongForm(StrongOptions):
    """Explicit Runge-Kutta 5(4) on Eq. (65)."""

    lambda_in_error_test: bool = option(False, "include lam and lam_dot in the local error test")

    paper_label: ClassVar[str] = "ODE-45"

    def _integrate(self, problem: Problem, control: StepControl, clock: Clock) -> Trajectory:
        """Integrate Eq. (65) by scipy's RK45, and return the trajectory."""
        return integrate(problem, control, RK45, self, self.lambda_in_error_test, clock=clock)
