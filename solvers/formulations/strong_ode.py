"""Eq. (65) as an explicit ODE, y = (p, u, lam, lam_dot), integrated by a method of SciPy; options of these solvers."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.integrate import OdeSolver

from ...harness.catalogue.options import option
from ...harness.mechanics.types import Problem, Status, StepControl, Trajectory
from .classical import SymbolicOptions
from .error_test import tolerances
from .layout import Layout
from .recording import Clock, StepFailure, march
from .rows_in_use import RowsInUse
from .start import choose_layout, pack_start
from .strong_form import StrongForm
from .symbolic import DIRECTIONS

EVALUATIONS_AT_START = 2  # scipy's Runge-Kutta pairs: y'(0) and one to choose the first step
# steps between checks of the rows in use: long explicit steps pass a place of dependence in two. Twice changes the
# evaluations on two of Bennett's linkages by 3 and -9 %, and no bit of three other mechanisms; there is no half.
ROWS_EVERY = 1
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

    ``lambda_in_test`` includes lam and lam_dot in the error test. Where the constraint rows in use become nearly
    dependent, the method starts anew on others, at the state projected onto the constraints: what the dropped rows have
    drifted would grow from change to change. ``clock`` has run since the set-up began.
    """
    layout, notes = choose_layout(problem, options.coordinates)
    pieces = list[_Segment]()

    def begin(layout: Layout, problem: Problem) -> None:
        """Begin a new integration at the initial state of ``problem``, on the rows of ``layout``; lam is kept."""
        outer = pieces[-1].outer if pieces else np.zeros((2, layout.system.nrows))
        pieces.append(_Segment(layout, problem, control, method, options, outer, lambda_in_test, clock))

    rows = RowsInUse(layout, begin, problem, every=ROWS_EVERY)

    def advance() -> tuple[float, np.ndarray, np.ndarray]:
        """Take a step, and change the rows where needed; return its time [s], (p, u) and the reactions of all rows."""
        t, pu, reaction = pieces[-1].step()
        rows.update_rows(t, pu)
        return t, pu, reaction

    def count(_: int) -> dict[str, int]:
        """Return the counters, summed over all integrations."""
        counts = [piece.count_work() for piece in pieces]
        return {name: sum(each.get(name, 0) for each in counts) for name in counts[0]}

    in_use = lambda: (rows.layout, rows.notes)  # noqa: E731  read anew at each call
    start = pieces[0]
    return march(problem, control, layout, clock, advance, start.pu, start.reaction, count, notes, in_use)


class _Segment:
    """An integration of Eq. (65) by a method of SciPy on one choice of constraint rows.

    ``outer`` are lam and lam_dot of all rows at the start, zero on those that were not in use before.
    """

    def __init__(
        self,
        layout: Layout,
        problem: Problem,
        control: StepControl,
        method: Callable[..., OdeSolver],
        options: StrongOptions,
        outer: Float[np.ndarray, "2 nrows"],
        lambda_in_test: bool,
        clock: Clock,
    ) -> None:
        """Start SciPy's ``method`` at the initial state of ``problem``, on the rows of ``layout``.

        ``options`` are those of the solver; ``lambda_in_test`` includes lam and lam_dot in the error test.
        """
        assert control.rtol is not None  # the catalogue requires it
        self._layout, self._clock = layout, clock
        self._n = n = layout.n_p + layout.n_u
        self._form = StrongForm(layout, options.alpha, options.beta, options.direction, options.c_bar, options.k_bar)
        self._stages, self._steps = STAGES.get(method.__name__), 0
        self._latest = np.zeros(layout.k)  # reaction at the last evaluation
        t, y = problem.initial.t, np.concatenate((pack_start(layout, problem)[:n], *outer[:, layout.kept]))
        self._rhs(t, y)
        self.pu, self.reaction = y[:n], layout.all_rows(self._latest)
        atol = tolerances(control.rtol, len(y), () if lambda_in_test else (slice(n, None),))
        limits: dict[str, Any] = {"rtol": control.rtol, "atol": atol, "max_step": control.max_step or np.inf}
        self._ode = method(self._rhs, t, y, problem.t_end, **limits)

    def step(self) -> tuple[float, Float[np.ndarray, " n_pu"], Float[np.ndarray, " nrows"]]:
        """Advance by one accepted step; return the time [s], (p, u) and the reaction.

        If the method's steps do not end with an evaluation, the reaction costs one more.
        """
        message = self._ode.step()
        if self._ode.status == "failed":
            raise StepFailure(Status.STEP_UNDERFLOW, str(message).rstrip(".").lower())
        self._steps += 1
        if self._stages is None:
            self._rhs(self._ode.t, self._ode.y)
        return self._ode.t, self._ode.y[: self._n], self._layout.all_rows(self._latest)

    @property
    def outer(self) -> Float[np.ndarray, "2 nrows"]:
        """The present lam and lam_dot of all rows, zero on those that are not in use."""
        return np.array([self._layout.all_rows(each) for each in np.split(self._ode.y[self._n :], 2)])

    def count_work(self) -> dict[str, int]:
        """Return the counters of this integration: evaluations and, as the method reports them, others.

        Explicit pairs add rejected steps, derived from their stages; implicit methods add Jacobians and factorisations.
        """
        ode = self._ode
        if self._stages is not None:
            attempts = (ode.nfev - EVALUATIONS_AT_START) // self._stages
            return {"rejected": max(0, attempts - self._steps), "evaluations": ode.nfev}
        of_jacobians = {"jacobians": ode.njev, "factorisations": ode.nlu} if ode.njev else {}  # LSODA does not say
        return {"evaluations": ode.nfev + self._steps, **of_jacobians}

    def _rhs(self, t: float, y: np.ndarray) -> np.ndarray:
        """Return the derivative of ``y`` = (p, u, lam, lam_dot) at ``t`` [s], and store the reaction.

        Raises ``StepFailure`` at the CPU limit and where the kept rows are dependent.
        """
        self._clock.check()
        n, k = self._n, self._layout.k
        rates = self._form.rates(y[:n], y[n : n + k], y[n + k :], t)
        self._latest[:] = rates.reaction
        return np.concatenate((rates.p_dot, rates.u_dot, y[n + k :], rates.lam_ddot))
