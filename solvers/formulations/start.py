"""The start of an integration: the rows to keep, and (y, y') with consistent accelerations and multipliers."""

import numpy as np
from jaxtyping import Float

from ...harness.mechanics.types import Problem
from .charts import CHARTS
from .layout import Layout
from .rank import rows_to_keep
from .saddle import InverseMass, Saddle
from .sparse_pattern import FixedPattern
from .system_elements import assemble_equations

# [s] step of the central difference for lam', which serves only the first predictor. Half and twice change the
# evaluations of a pendulum by 0.4 and -3 %, and none of a top; behind a singular pose the motion is another one.
RATE_STEP = 1e-5


def choose_layout(problem: Problem, coordinates: str) -> tuple[Layout, tuple[str, ...]]:
    """Return the layout of unknowns on constraint rows independent at the start, and notes on those dropped.

    ``coordinates`` is the chart's name, "quaternion" or "euler313". The notes are empty if no row is redundant.
    """
    system = problem.system
    kept = rows_to_keep(system, problem.initial)
    dropped = np.setdiff1d(np.arange(system.nrows), kept)
    layout = Layout(system, CHARTS[coordinates], kept)
    if len(dropped) == 0:
        return layout, ()
    rows = ", ".join(map(str, dropped))
    count = f"dropped {len(dropped)} of {system.nrows} constraint rows"
    return layout, (f"{count}, redundant at the start (rank {len(kept)}): {rows}",)


def refuse_redundant_rows(problem: Problem) -> str | None:
    """Return the refusal of a system whose constraint rows are redundant at the start, or None."""
    rank, rows = len(rows_to_keep(problem.system, problem.initial)), problem.system.nrows
    if rank == rows:
        return None
    return f"{rows} constraint rows have rank {rank} at the start; set redundancy=drop to keep {rank} independent ones"


def pack_start(layout: Layout, problem: Problem) -> Float[np.ndarray, " n"]:
    """Return y = (p, u, lam) at the problem's initial state, with lam = 0."""
    p, u = layout.chart.coordinates(problem.initial)
    return np.concatenate((p.ravel(), u.ravel(), np.zeros(layout.k)))


class Accelerations:
    """Accelerations u' and multipliers lam of index 1, with Baumgarte's terms, at any (p, u)."""

    def __init__(self, layout: Layout, alpha: float = 0.0, beta: float = 0.0) -> None:
        """Assemble the equations of index 1 and the solver of their saddle; ``alpha`` and ``beta`` are in 1/s."""
        self._layout = layout
        self._motion = motion = assemble_equations(layout, "acceleration", alpha, beta, differentiable=True)
        first_c = layout.n_p + layout.n_u
        entries = np.flatnonzero((motion.row >= first_c) & motion.of_w & (motion.column >= 0))
        pattern = FixedPattern(motion.row[entries] - first_c, motion.column[entries], (layout.k, layout.n_u))
        place = np.full(len(motion.row), -1)
        place[entries] = pattern.place
        self._A = np.zeros(pattern.nnz + 1)
        self._add_A = motion.make_derivative_program(self._A, place, np.ones(len(place)))
        e, c = motion.out[layout.u], motion.out[layout.lam]
        self._saddle = Saddle(layout, pattern, InverseMass(layout, motion.y), self._A[:-1], e, c)
        self._at_rest = np.zeros(layout.n_u)

    def compute_accelerations(
        self, y: Float[np.ndarray, " n"], t: float = 0.0
    ) -> tuple[Float[np.ndarray, " n_u"], Float[np.ndarray, " k"]]:
        """Return (u', lam) at (p, u) of ``y`` and time ``t`` [s]; the lam in ``y`` is ignored.

        Raises ``StepFailure`` where the kept rows are dependent.
        """
        at, y = self._layout, y.copy()
        y[at.lam] = 0.0
        self._motion.set_inputs(y, self._at_rest, t)
        self._motion.evaluate.run()
        self._A.fill(0.0)
        self._add_A.run()
        u_dot, lam = self._saddle.solve()
        return u_dot.copy(), lam.copy()

    def compute_coordinate_rates(self, y: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n_p"]:
        """Return the coordinate rates p' of the chart at (p, u) of ``y``."""
        return self._motion.values(y, self._at_rest)[self._layout.p]


def make_consistent(
    layout: Layout, y: Float[np.ndarray, " n"], alpha: float, beta: float, t: float = 0.0
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Return (y, y') with the coordinates and velocities of ``y`` and consistent accelerations and multipliers.

    u' and lam solve the equations of index 1 with Baumgarte's ``alpha`` and ``beta`` [1/s]; p and u are not projected.
    lam' is a central difference, which serves only an integrator's first predictor.
    """
    accelerations = Accelerations(layout, alpha, beta)
    u_dot, lam = accelerations.compute_accelerations(y, t)
    y_dot = np.concatenate((accelerations.compute_coordinate_rates(y), u_dot, np.zeros(layout.k)))
    ahead, behind = (accelerations.compute_accelerations(y + h * y_dot, t + h)[1] for h in (RATE_STEP, -RATE_STEP))
    y, y_dot = y.copy(), y_dot.copy()
    y[layout.lam], y_dot[layout.lam] = lam, (ahead - behind) / (2.0 * RATE_STEP)
    return y, y_dot


def make_unloaded_start(
    layout: Layout, y: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Return (y, y') with the accelerations that the bodies have without joints.

    ``y`` is returned as it is, with its lam = 0; the constraint rows at the level of accelerations are thus violated.
    """
    accelerations = Accelerations(Layout(layout.system, layout.chart, np.zeros(0, dtype=np.int64)))
    y_short = y[: layout.n - layout.k]
    u_dot, _ = accelerations.compute_accelerations(y_short)
    return y, np.concatenate((accelerations.compute_coordinate_rates(y_short), u_dot, np.zeros(layout.k)))
