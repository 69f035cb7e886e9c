"""Integrate by Gragg-Bulirsch-Stoer extrapolation in the precision of the start (longdouble: 1e-19).

The modified midpoint rule with 2, 4, ..., 2 k substeps is extrapolated in h^2: order 2 k (Hairer, Norsett, Wanner I,
II.9). No solver uses this integrator, so that it serves as the second route.
"""

from collections.abc import Callable, Iterator

import numpy as np

Rate = Callable[[np.ndarray], np.ndarray]  # rate of several states (k, ny) at once: the columns are evaluated together


def vectorize_rate(f: Rate) -> Rate:
    """Return a rate of stacked states (k, ny), which calls the rate ``f`` of one state for each."""
    return lambda states: np.stack([f(y) for y in states])


def gbs_step(f: Rate, y: np.ndarray, H: float, columns: int = 8) -> tuple[np.ndarray, np.ndarray]:
    """Return the state ``y`` after a step ``H`` [s] of y_dot = f(y), and the last correction of the extrapolation.

    The correction is usually much larger than the error of the result. The order is twice the number of ``columns``.
    """
    increments = _integrate_midpoints(f, y, y.dtype.type(H), columns)
    row: list[np.ndarray] = []
    for j in range(1, columns + 1):
        previous, row = row, [increments[j - 1]]
        for k, older in enumerate(previous):
            weight = y.dtype.type(j * j) / y.dtype.type((j - 1 - k) ** 2) - 1
            row.append(row[k] + (row[k] - older) / weight)
    return y + row[-1], row[-1] - row[-2]


def gbs(f: Rate, y0: np.ndarray, t: np.ndarray, substeps: int, columns: int = 8) -> np.ndarray:
    """Integrate y_dot = f(y) from ``y0`` at ``t[0]``, and return the states (nt, ny) at the times ``t`` [s].

    ``f`` is the rate of one state, ``substeps`` the number of extrapolation steps between two times.
    """
    out = [y0]
    for span in np.diff(t.astype(y0.dtype)):
        y = out[-1]
        for _ in range(substeps):
            y, _ = gbs_step(vectorize_rate(f), y, span / substeps, columns)
        out.append(y)
    return np.stack(out)


def gbs_adaptive(
    f: Rate,
    y: np.ndarray,
    span: float,
    tolerance: float | np.ndarray,
    H: float,
    begin: Callable[[], None] = lambda: None,
) -> Iterator[tuple[float, np.ndarray]]:
    """Yield (time [s], state) after each accepted step over ``span`` [s]; times are counted from its start.

    Corrections stay below ``tolerance``. ``H`` [s] is the first step tried; ``begin`` is called before each step.
    Raises ArithmeticError if a step shorter than 1e-9 of the span is rejected.
    """
    t = 0.0
    while t < span:
        last = t + H >= span
        step = span - t if last else H
        begin()
        there, correction = gbs_step(f, y, step)
        size = float(np.max(np.abs(correction) / tolerance))
        H = step * min(2.0, max(0.2, 0.9 * max(size, 1e-300) ** (-1.0 / 15.0)))
        if size <= 1.0:
            t, y = span if last else t + step, there
            yield t, y
        elif step < 1e-9 * span:
            raise ArithmeticError(f"no step meets the tolerance (correction {size:.3g} times as large)")


def _integrate_midpoints(f: Rate, y: np.ndarray, H: np.floating, columns: int) -> np.ndarray:
    """Return the increments of y by the modified midpoint rule over ``H`` [s] with 2, 4, ..., 2 ``columns`` substeps.

    They are stacked along the first axis. Increments, because the extrapolation then amplifies their rounding and not
    that of ``y``.
    """
    n = 2 * np.arange(1, columns + 1)
    h = (H / n.astype(y.dtype)).reshape(-1, *[1] * y.ndim)
    newer = h * f(y[None])
    older = np.zeros_like(newer)
    for done in range(1, n[-1]):
        k = slice(int(np.searchsorted(n, done, side="right")), None)  # the columns that have more substeps
        older[k], newer[k] = newer[k].copy(), older[k] + 2 * h[k] * f(y + newer[k])
    return newer
