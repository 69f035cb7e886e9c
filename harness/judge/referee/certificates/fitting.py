"""Fit orders to ladders: find the range of steps where the error is a power of the step, without choosing by eye.

``fit_ladder`` is for fixed steps, whose errors are smooth in dt: coarse steps are pre-asymptotic, fine ones lie on a
floor of rounding or of the solver's own tolerance, and between them slopes agree. ``fit_scattered`` is for error
control, where every run has its own steps and errors scatter: Theil and Sen's median of slopes needs no such range.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import t as student
from scipy.stats import theilslopes

from ....results.judgements.runs import FitKind

AGREE = 0.15  # slopes of halvings within this are one power: C dt^p (1 + K dt) at K dt = 0.1 bends as much
FLAT = 0.3  # a slope below this is a floor, not a power; so is a tail of finer steps with less overall slope
FEWEST = 3  # least number of slopes that must agree: four steps
HUBER = 0.05  # in ln(error): residuals above 5 % are outliers; the maximum over steps jitters by less
LEVEL = 0.95  # the customary level: 0.9 makes an interval a sixth narrower, 0.99 a third wider


@dataclass(frozen=True)
class Fit:
    """The fitted ``order`` with its interval over the points ``used``, and the kind of the ladder."""

    kind: FitKind  # "flat": errors do not depend on the step; "lost": not a power at the finest steps
    used: tuple[bool, ...] = ()  # for each point, whether the order is fitted to it
    slopes: tuple[float, ...] = ()  # slopes between neighbouring points
    order: float = math.nan  # exponent p of error = C dt^p
    low: float = math.nan  # ends of the 95 % interval of the order
    high: float = math.nan
    floor: float = math.nan  # median error of the finer points left out

    @property
    def finer_slopes(self) -> tuple[float, ...]:
        """The slopes between points finer than the points used; empty if the finest is used."""
        last = max((k for k, u in enumerate(self.used) if u), default=len(self.slopes))
        return self.slopes[last:]


def fit_ladder(dt: Sequence[float], error: Sequence[float], small: float = 0.0) -> Fit:
    """Fit the order p of error = C dt^p to errors > 0 of runs at decreasing fixed steps ``dt`` [s].

    Errors below ``small`` may be set by a tolerance. Finer points may only be left out if they show a floor
    (``_is_floor``); otherwise the kind of the fit is ``lost``. Fewer than four points give the kind ``none``.
    """
    x, y = np.log(np.asarray(dt, dtype=float)), np.log(np.asarray(error, dtype=float))
    slopes = np.diff(y) / np.diff(x)
    nothing = (False,) * len(x)
    if len(x) < FEWEST + 1:
        return Fit("none", nothing, tuple(slopes))
    window = _find_agreement(slopes)
    if window is None:
        return Fit("flat" if np.median(np.abs(slopes)) < FLAT else "none", nothing, tuple(slopes))
    first, last = window  # slopes first..last agree: points first..last + 1
    used = tuple(first <= k <= last + 1 for k in range(len(x)))
    order, low, high = _fit_line(x[first : last + 2], y[first : last + 2])
    low, high = min(low, float(slopes[last])), max(high, float(slopes[last]))  # the finest pair is the least biased
    finer = slopes[last + 1 :]
    if np.all(np.abs(finer - order) <= AGREE):  # scatter about the order: neither lost nor a floor
        return Fit("power", used, tuple(slopes), order, low, high)
    if not _is_floor(x[last + 2 :], y[last + 2 :], small):
        return Fit("lost", used, tuple(slopes), order, low, high)
    return Fit("power", used, tuple(slopes), order, low, high, float(np.exp(np.median(y[last + 2 :]))))


def _is_floor(x: np.ndarray, y: np.ndarray, small: float) -> bool:
    """Return whether the errors of the finer points stop decreasing: they lie on a floor.

    ``x`` and ``y`` are the logarithms of their steps and errors, the finest last. They lie on one if the finest error
    is at most ``small``, or if the slope from any of them to the finest is below ``FLAT``. The slope into the first of
    them is not used: a slope of 1.1 may be half of a floor or the first of a lost order.
    """
    if np.exp(y[-1]) <= small:
        return True
    return bool(np.any((y[:-1] - y[-1]) < FLAT * (x[:-1] - x[-1])))


def fit_scattered(x: Sequence[float], error: Sequence[float]) -> Fit:
    """Fit the order to errors > 0 of runs under error control, the finest last.

    ``x`` is their mean step [s], or their tolerance; then the result is the exponent against the tolerance.
    """
    a, y = np.log(np.asarray(x, dtype=float)), np.log(np.asarray(error, dtype=float))
    slopes = np.diff(y) / np.diff(a) if len(np.unique(a)) == len(a) else np.full(max(len(a) - 1, 0), math.nan)
    n = len(a)
    while n > 2 and y[n - 2] - y[n - 1] < FLAT * abs(a[n - 2] - a[n - 1]):
        n -= 1  # drop the finest ones that no longer improve
    n = len(a) if n == len(a) - 1 else n  # a single one may be scatter
    used = tuple(k < n for k in range(len(a)))
    if n < FEWEST + 1:
        return Fit("none", (False,) * len(a), tuple(slopes))
    order, _, low, high = (float(v) for v in theilslopes(y[:n], a[:n], LEVEL))
    floor = float(np.exp(np.median(y[n:]))) if n < len(a) else math.nan
    return Fit("power", used, tuple(slopes), order, low, high, floor)


def _find_agreement(slopes: np.ndarray) -> tuple[int, int] | None:
    """Return the first and last index of the longest run of slopes that agree and are no floor; None without one.

    Of runs of equal length the finest is returned.
    """
    agreeing = [
        (first, last)
        for first, last in combinations(range(len(slopes)), 2)
        if last - first + 1 >= FEWEST and np.ptp(part := slopes[first : last + 1]) <= AGREE and np.median(part) >= FLAT
    ]
    return max(agreeing, key=lambda window: (window[1] - window[0], window[0]), default=None)


def _fit_line(x: np.ndarray, y: np.ndarray) -> tuple[float, float, float]:
    """Return the slope of the robust line (Huber's loss) through (x, y), with the ends of its 95 % interval.

    The interval is Student's, from the weighted residuals.
    """
    d = x - np.mean(x)

    def residual(p: np.ndarray) -> np.ndarray:
        """Return the line of intercept p[0] and slope p[1] minus the values."""
        return p[0] + p[1] * d - y

    slope, intercept = np.polyfit(d, y, 1)
    found = least_squares(residual, (intercept, slope), loss="huber", f_scale=HUBER)
    order, r = float(found.x[1]), found.fun
    weight = np.minimum(1.0, HUBER / np.maximum(np.abs(r), 1e-300))
    free = len(x) - 2
    variance = float(np.sum(weight * r**2)) / free / float(np.sum(weight * d**2))
    half = float(student.ppf(0.5 + 0.5 * LEVEL, free)) * math.sqrt(variance)
    return order, order - half, order + half
