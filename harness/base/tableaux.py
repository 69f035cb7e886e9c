"""Embedded explicit Runge-Kutta pairs, first same as last: Dormand-Prince 5(4) and DOP853, as SciPy has them."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import DOP853, RK45


class Tableau(NamedTuple):
    """The coefficients of a pair; ``error`` has one row, or two (E5, E3) for DOP853, with the end's slope last."""

    c: np.ndarray  # (s,)
    a: np.ndarray  # (s, s)
    b: np.ndarray  # (s,)
    error: np.ndarray  # (1 or 2, s + 1)
    order: int


DOPRI5 = Tableau(RK45.C.copy(), np.pad(RK45.A, ((0, 0), (0, 1))).copy(), RK45.B.copy(), RK45.E[None].copy(), 5)
DOPRI853 = Tableau(DOP853.C.copy(), DOP853.A.copy(), DOP853.B.copy(), np.stack((DOP853.E5, DOP853.E3)), 8)


def evaluate_stages(
    s: Any,
    pair: Any,
    t: Any,
    h: Any,
    first: int,
    combine: Callable[[Any, Any, int, Any], None],
    slope: Callable[[Any, Any, int], None],
) -> None:
    """Evaluate the slopes of a step of h [s] from stage ``first`` on, and set the state to that at its end.

    ``s`` holds the state and the slopes, ``pair`` the coefficients a, b, c. ``combine(s, weights, n, h)`` sets the
    state to that at the start of the step plus h times the weighted sum of the first n slopes; ``slope(s, t, i)``
    evaluates the slope of the state at t, and stores it as slope i. The function runs on arrays, writes expressions,
    and is compiled into steps.
    """
    n = len(pair.b)
    for i in range(first, n):
        combine(s, pair.a[i], i, h)
        slope(s, t + h * pair.c[i], i)
    combine(s, pair.b, n, h)
