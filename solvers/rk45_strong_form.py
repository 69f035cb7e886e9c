"""Dormand-Prince 5(4) on the strong form, Eq. (65): the paper's ODE-45 (Sect. 4.1).

    y = (p, u, lam, lam_dot),   y' = (G u, u_dot, lam_dot, lam_ddot)   with u_dot, lam_ddot from Eq. (65)

explicit, error per step, rtol = atol. Without springs and dampers C_bar = K_bar = 0: the constraints hold through
phi_ddot = 0 alone, and phi drifts with the integration error. ``c_bar`` and ``k_bar`` give every row its own, and phi
decays as (M_bar phi_dot)' + C_bar phi_dot + K_bar phi = 0, Eq. (64). ``alpha`` and ``beta`` add Baumgarte's terms,
which the paper's strong form does not have. lam and lam_dot are quadratures that affect nothing else
(``strong_form``), so by default they are left out of the error test.

Counted: accepted steps and evaluations; rejected steps follow (six evaluations an attempt, two at the start).
"""

import time
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.integrate import RK45

from ..harness.catalogue.options import option
from ..harness.catalogue.registry import solver
from ..harness.types import Problem, Status, StepControl, Trajectory
from .formulations.classical import SymbolicOptions
from .formulations.ida import OUT_OF_TEST
from .formulations.recording import Clock, StepFailure, march, no_trajectory, trajectory
from .formulations.start import coordinates_and_velocities, layout_for
from .formulations.strong_form import Choice, StrongForm
from .formulations.symbolic import DIRECTIONS

EVALUATIONS_AT_START = 2  # scipy's RK45: y'(0) and one to choose the first step
EVALUATIONS_A_STEP = 6  # seven stages, the last of which is the next step's first


@solver("rk45_strong_form")
@dataclass(frozen=True)
class Rk45StrongForm(SymbolicOptions):
    """Explicit Runge-Kutta 5(4) on Eq. (65)."""

    alpha: float = option(0.0, "Baumgarte: 2 alpha phi_dot (none in the paper)", "1/s", at_least=0.0)
    beta: float = option(0.0, "Baumgarte: beta^2 phi (none in the paper)", "1/s", at_least=0.0)
    direction: str = option("a", "c_R of Eq. (31): a/(a.a), M^-1 a/(a.M^-1 a), or (e_k, 0)", choices=DIRECTIONS)
    c_bar: float = option(0.0, "C_bar of every row, added to that of Eq. (32); axis rows kg m2/s", "kg/s", at_least=0.0)
    k_bar: float = option(0.0, "K_bar of every row, added to that of Eq. (32); axis rows N m", "N/m", at_least=0.0)
    lambda_in_error_test: bool = option(False, "include lam and lam_dot in the local error test")

    name: ClassVar[str]
    paper_label: ClassVar[str] = "ODE-45"
    control: ClassVar[str] = "rtol"

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Why this solver cannot solve the problem, or None."""
        if self.direction == "translation" and np.any(problem.system.joint_revolute):
            return "direction 'translation' needs spherical joints: an axis row has no translation"
        return super().refuses(problem, control)

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        """Integrate from the start to ``t_end``."""
        began, reason = time.process_time(), self.refuses(problem, control)
        if reason is not None:
            return no_trajectory(problem, Status.REFUSED, reason)
        layout, notes = layout_for(problem, self.coordinates)
        k, n = layout.k, layout.n_p + layout.n_u
        choice = Choice(self.direction, self.c_bar, self.k_bar)
        form, clock = StrongForm(layout, self.alpha, self.beta, choice), Clock(control.wall_limit)
        latest = np.zeros(k)  # reaction at the last evaluation, the seventh stage, which is the accepted state

        def rhs(t: float, y: np.ndarray) -> np.ndarray:
            clock.check()
            rates = form.rates(y[:n], y[n : n + k], y[n + k :])
            latest[:] = rates.reaction
            return np.concatenate((rates.p_dot, rates.u_dot, y[n + k :], rates.lam_ddot))

        y = np.concatenate((coordinates_and_velocities(layout, problem)[:n], np.zeros(2 * k)))
        atol = np.full(len(y), control.rtol)
        if not self.lambda_in_error_test:
            atol[n:] = OUT_OF_TEST
        try:
            rhs(0.0, y)
            reaction = latest.copy()
            options: dict = {"rtol": control.rtol, "atol": atol, "max_step": control.max_step or np.inf}
            rk = RK45(rhs, 0.0, y, problem.t_end, **options)
        except StepFailure as failure:
            return no_trajectory(problem, failure.status, f"no acceleration at the start: {failure.message}")
        setup_time = time.process_time() - began
        clock.restart()

        def advance() -> tuple[float, np.ndarray, np.ndarray]:
            with np.errstate(all="ignore"):  # overflow on the way to a failure that is reported
                message = rk.step()
            if rk.status == "failed":
                raise StepFailure(Status.STEP_UNDERFLOW, str(message).rstrip(".").lower())
            return rk.t, rk.y[:n], latest

        done = march(advance, (0.0, y[:n], reaction), layout, problem.t_end, control, clock)
        cpu_time = clock.cpu_time()
        attempts = (rk.nfev - EVALUATIONS_AT_START) // EVALUATIONS_A_STEP
        counters = {"rejected": max(0, attempts - (len(done.t) - 1)), "evaluations": rk.nfev}
        return trajectory(layout, done, counters, notes, cpu_time=cpu_time, setup_time=setup_time)
