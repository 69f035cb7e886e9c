"""Compute numbers from series: the largest value, the trend, the mean over a span, and where errors can be judged."""

import math

import numpy as np
from jaxtyping import Float

from ..mechanics.types import GROWN, JUDGED, PREDICTABLE


def find_largest(a: Float[np.ndarray, " n"]) -> float:
    """Return max |a|; NaN if empty, infinity if a value is NaN, since a motion that became NaN has no small error."""
    if len(a) == 0:
        return math.nan
    return math.inf if np.any(np.isnan(a)) else float(np.max(np.abs(a)))


def count_predictable(t: Float[np.ndarray, " nt"], own: Float[np.ndarray, " nt"]) -> int:
    """Return the number of instants, from the start on, at which the reference is accurate enough to judge errors.

    The first instant at which it is not ends the count. ``own`` is its stated error over the length scale: it must be
    below ``PREDICTABLE``, or below ``JUDGED`` without having grown by more than a factor ``GROWN`` since a tenth of the
    time.
    """
    tenth = np.maximum(np.searchsorted(t, 0.1 * t, side="right") - 1, min(1, len(t) - 1))
    steady = (own <= JUDGED) & (own <= GROWN * own[tenth])
    return int(np.sum(np.cumprod((own <= PREDICTABLE) | steady)))


def fit_trend(t: Float[np.ndarray, " nt"], a: Float[np.ndarray, " nt"]) -> float:
    """Return the slope of the least-squares line through a(t), in units of a per s.

    Each value is weighted with the time that it stands for. NaN if ``a`` is not finite or has fewer than three values.
    """
    if len(t) < 3 or not np.all(np.isfinite(a)):
        return math.nan
    w = _weigh_steps(t)
    t0, a0 = np.sum(w * t) / np.sum(w), np.sum(w * a) / np.sum(w)
    return float(np.sum(w * (t - t0) * (a - a0)) / np.sum(w * (t - t0) ** 2))


def compute_time_mean(t: Float[np.ndarray, " nt"], a: Float[np.ndarray, " nt"], begin: float, end: float) -> float:
    """Return the mean of a over [begin, end] [s] by the trapezoidal rule on the times inside; NaN if fewer than two."""
    inside = (t >= begin) & (t <= end)
    if np.sum(inside) < 2:
        return math.nan
    return float(np.trapezoid(a[inside], t[inside]) / np.ptp(t[inside]))


def find_exceeding_time(
    t: Float[np.ndarray, " nt"], error: Float[np.ndarray, " nc"], allowed: Float[np.ndarray, " nc"]
) -> float:
    """Return the first time [s] at which ``error`` exceeds ``allowed`` or is NaN.

    Of the times ``t``, the first nc are compared; if the error stays within, return the last of these.
    """
    above = ~(error <= allowed)
    return float(t[np.argmax(above) if np.any(above) else len(error) - 1])


def _weigh_steps(t: np.ndarray) -> np.ndarray:
    """Return the time [s] that each step stands for: half the intervals on both sides."""
    dt = np.diff(t)
    return 0.5 * (np.append(dt, 0.0) + np.insert(dt, 0, 0.0))
