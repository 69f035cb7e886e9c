"""Gragg-Bulirsch-Stoer extrapolation with fixed basic steps, in whatever precision the start has (longdouble: 1e-19).

Modified midpoint rule with 2, 4, ..., 2 k substeps, extrapolated in h^2: order 2 k (Hairer, Norsett, Wanner I, II.9). An
integrator that no contestant uses, for second routes.
"""

from collections.abc import Callable

import numpy as np

Rate = Callable[[np.ndarray], np.ndarray]


def gbs_step(f: Rate, y: np.ndarray, H: float, columns: int = 8) -> np.ndarray:
    """``y`` after ``H`` of the autonomous y_dot = f(y)."""
    H = y.dtype.type(H)
    first = f(y)
    row: list[np.ndarray] = []
    for j in range(1, columns + 1):
        previous, row = row, [_midpoint(f, y, first, H, 2 * j)]
        for k, older in enumerate(previous):
            weight = y.dtype.type(j * j) / y.dtype.type((j - 1 - k) ** 2) - 1
            row.append(row[k] + (row[k] - older) / weight)
    return row[-1]


def gbs(f: Rate, y0: np.ndarray, t: np.ndarray, substeps: int, columns: int = 8) -> np.ndarray:
    """The motion at the times ``t`` (t[0] is the start), ``substeps`` basic steps between two of them."""
    out = [y0]
    for span in np.diff(t.astype(y0.dtype)):
        y = out[-1]
        for _ in range(substeps):
            y = gbs_step(f, y, span / substeps, columns)
        out.append(y)
    return np.stack(out)


def _midpoint(f: Rate, y: np.ndarray, first: np.ndarray, H: np.ndarray, n: int) -> np.ndarray:
    h = H / n
    older, newer = y, y + h * first
    for _ in range(n - 1):
        older, newer = newer, older + 2 * h * f(newer)
    return newer
