"""Eq. (65) as an explicit ODE, y = (p, u, lam, lam_dot), integrated by a method of SciPy; options of these solvers."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import OdeSolver

from ...harness.catalogue.options import option
from ...harness.mechanics.types import Problem, Status, StepControl, Trajectory
from .classical import SymbolicOptions
from .error_test import tolerances
from .recording import Clock, StepFailure, march
from .start import choose_layout, pack_start
from .strong_form import StrongForm
from .symbolic import DIRECTIONS

EVALUATIONS_AT_START = 2  # scipy's Runge-Kutta pairs: y'(0) and one to choose the first step
ROWS_EVERY = 1  # steps between checks of the rows in use: long explicit steps pass a place of dependence in two
STAGES = {"RK23": 3, "RK45": 6, "DOP853": 12}  # evaluations an attempt; the last is at its end, the next one's first


@dataclass(frozen=True)
class StrongOptions(SymbolicOptions):
    """Options of Eq. (65): the choices that it leaves open, and Baumgarte's terms."""

    alpha: float = option(0.0, "Baumgarte: 2 alpha phi_dot (none in the paper)", "1/s", at_least=0.0)
    beta: float = option(0.0, "Baumgarte: beta^2 phi (none in the paper)", "1/s", at_least=0.0)
    direction: str = option("a", "c_R of Eq. (31): a/(a.a), M^-1 a/(a.M^-1 a), or (e_k, 0)", choices=DIRECTIONS)
    c_bar: float = option(0.0, "C_bar of every row, added to that of Eq. (32); axis rows kg m2/s", "kg/s", at_least=0.0)
    k_bar: float = option(0.0, "K_bar of every row, added to that of Eq. (32); axis rows N m", "N/m", at_least=0.0)

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Return why this solver cannot solve the problem, or None.

        Direction "translation" is refused for joints that have rows other than point rows.
        """
        system = problem.system
        if self.direction == "translation" and np.any(system.joint_rows > 3 * (system.joint_points > 0)):
            return "direction 'translation' needs spherical joints: other rows have no translation of their own"
        return super().refuses(problem, control)


def integrate(
    problem: Problem,
    control: StepControl,
    method: Callable[..., OdeSolver],
    options: StrongOptions,
    lambda_in_test: bool,
    clock: Clock,
) -> Trajectory:
    """Integrate Eq. (65) as an ODE by SciPy's ``method``, accepted step by accepted step.

    ``lambda_in_test`` includes lam and lam_dot in the error test. If the method's steps do not end with an evaluation,
    the reactions cost one more per step. ``clock`` has run since the set-up began.
    """
    pair = STAGES.get(method.__name__)
    layout, notes = choose_layout(problem, options.coordinates)
    k, n = layout.k, layout.n_p + layout.n_u
    form = StrongForm(layout, options.alpha, options.beta, options.direction, options.c_bar, options.k_bar)
    latest = np.zeros(k)  # reaction at the last evaluation

    def rhs(t: float, y: np.ndarray) -> np.ndarray:
        clock.check()
        rates = form.rates(y[:n], y[n : n + k], y[n + k :], t)
        latest[:] = rates.reaction
        return np.concatenate((rates.p_dot, rates.u_dot, y[n + k :], rates.lam_ddot))

    y = np.concatenate((pack_start(layout, problem)[:n], np.zeros(2 * k)))
    rhs(0.0, y)
    reaction = form.all_rows(latest)
    assert control.rtol is not None  # the catalogue requires it
    atol = tolerances(control.rtol, len(y), () if lambda_in_test else (slice(n, None),))
    limits: dict[str, Any] = {"rtol": control.rtol, "atol": atol, "max_step": control.max_step or np.inf}
    ode = method(rhs, 0.0, y, problem.t_end, **limits)

    def advance() -> tuple[float, np.ndarray, np.ndarray]:
        nonlocal form
        message = ode.step()
        if ode.status == "failed":
            raise StepFailure(Status.STEP_UNDERFLOW, str(message).rstrip(".").lower())
        if pair is None:
            rhs(ode.t, ode.y)
        reaction = form.all_rows(latest)
        form = form.change_rows_if_worn(ode.y[:n], ode.t, ROWS_EVERY)
        return ode.t, ode.y[:n], reaction

    def count(steps: int) -> dict[str, int]:
        if pair is not None:
            attempts = (ode.nfev - EVALUATIONS_AT_START) // pair
            return {"rejected": max(0, attempts - steps), "evaluations": ode.nfev}
        of_jacobians = {"jacobians": ode.njev, "factorisations": ode.nlu} if ode.njev else {}  # LSODA does not say
        return {"evaluations": ode.nfev + steps, **of_jacobians}

    return march(problem, control, layout, clock, advance, y[:n], reaction, count, notes)
