"""Measure the order of errors over a ladder of steps or tolerances, and judge it: all tolerances on orders are here.

What stays of a residual at the finest step is judged, too (``bound_remainder``): it should fall like an error. A few
runs tell an order by the slope between the finest two (``judge_ladder``), two by Richardson's estimate
(``bound_fine_error``). Four and more are fitted: the range of steps where the error is a power of the step is found
without choosing by eye. ``fit_ladder`` is for fixed steps, whose errors are smooth in dt: coarse steps are
pre-asymptotic, fine ones lie on a floor of rounding or of the solver's own tolerance, and between them slopes agree.
``fit_scattered`` is for error control, where every run has its own steps and errors scatter: Theil and Sen's median of
slopes needs no such range.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, compress

import numpy as np
from jaxtyping import Float

from ..results.findings import Finding, judge_value, leave_open, make_failure
from ..results.judgements.runs import FitKind, OrderVerdict

# "Half" and "twice" in these comments: verdicts that change when 404 published ladders of fixed steps are fitted again.
# distances from the declared order
# of a fitted order: 2 % of noise in errors moves it by less. Half: 13 certified orders become undecided; twice: one
# undecided order is certified.
WITHIN = 0.1
# of one slope, and of the ends of a fit's interval: C dt^p (1 + K dt) at K dt = 0.3 bends as much. Half: 13 certified
# orders become undecided; twice: none changes.
SLOPE = 0.2
LEAST_ORDER = 1.0 - SLOPE  # of a solver that declares no order: it converges, at least like a first-order scheme
SECOND_ORDER = 1.5  # between 1, as of reactions one step late, and 2, the least of correct second-order schemes
# sizes of errors, as fractions of the scale of a large one
EXACT = 1e-13  # rounding of some thousand steps; a tolerance of 1e-12 leaves more
ROUNDED = 1e-11  # below, rounding of the steps bends the slope of a few runs
HELD = 1e-9  # errors below at every step are set by a tolerance, not by the step
ITERATED = 1e-8  # below, corrections that end at their tolerance may leave errors independent of the step
KEPT = 1e-7  # as HELD, if errors do not depend on the step at all
DIFFERENCED = 1e-7  # of reactions: error of sixth-order differences of the exact motion
NEXT_TERM = 2.0  # factor on Richardson's estimate, for the next term of the error
# of what stays of a residual: left by the motion, or by iterations, which vary about one size
GROWTH = 2.0  # least of the last quarter of a motion over the largest of the first; 3 in proportion to time
STEADY = 0.1  # relative variation over the last three quarters; what iterations leave varies by orders of magnitude
# of fits
# slopes of halvings within this are one power: C dt^p (1 + K dt) at K dt = 0.1 bends as much. Half: 12 verdicts become
# undecided; twice: one more is certified.
AGREE = 0.15
# a slope below this is a floor, not a power; so is a tail of finer steps with less overall slope. Half: none changes;
# twice: 2 undecided orders are below the declared one.
FLAT = 0.3
# least number of slopes that must agree: four steps. At 1, three undecided ladders get an order; at 6, 159 lose theirs.
FEWEST = 3
# in ln(error): residuals above 5 % are outliers; the maximum over steps jitters by less. Half, twice: none changes.
HUBER = 0.05
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


NOTHING = Fit("none")


def measure_slopes(dt: Sequence[float], error: Sequence[float]) -> Float[np.ndarray, " n"]:
    """Return the observed order between each two neighbouring runs, of errors > 0 at steps or tolerances ``dt``."""
    return np.diff(np.log(np.asarray(error, dtype=float))) / np.diff(np.log(np.asarray(dt, dtype=float)))


def bound_fine_error(halved: float, order: float) -> float:
    """Return a bound on the error at half the step, by Richardson's estimate at this ``order`` and ``NEXT_TERM``.

    ``halved`` is the change of the result when the step was halved; the bound has its unit.
    """
    return halved * NEXT_TERM / (2.0**order - 1.0)


def judge_ladder(
    control: str,
    settings: Sequence[float],
    errors: Sequence[float],
    what: str,
    *,
    resolved: float,
    declared: float = math.nan,
    least: float = LEAST_ORDER,
) -> Finding:
    """Judge how errors fall over a few runs at decreasing ``settings`` of ``control``: steps dt, or tolerances rtol.

    In dt, the order is the slope between the two finest runs, or the steepest one if the solver's iteration may have
    set the finest error. It must be at least the ``declared`` one, within ``SLOPE``, or ``least`` if none is declared
    (NaN). In rtol, errors must fall at least as ``find_least_fall`` says, or to rounding. Errors below ``resolved`` are
    left out; with fewer than two others the finding is open. ``what`` names the scale of the errors in words.
    """
    at = ", ".join(f"{x:g}" for x in settings)
    words = f"errors {', '.join(f'{x:.3g}' for x in errors)} {what} at {control} {at}"
    if not np.all(np.isfinite(errors)):
        return make_failure(words)
    seen = [(x, e) for x, e in zip(settings, errors, strict=True) if e >= resolved]
    if len(seen) < 2:
        return leave_open(f"rounding alone: {words}")
    if control == "rtol":
        smaller = errors[0] / max(errors[-1], resolved)
        least = min(find_least_fall(settings), errors[0] / resolved)
        return judge_value(smaller, "times smaller", least, words=words, count=len(seen))
    slopes = measure_slopes(*zip(*seen, strict=True))
    order = float(slopes[-1] if seen[-1][1] > ITERATED else np.max(slopes))
    if math.isnan(declared):
        return judge_value(order, "order", least, words=words, count=len(seen))
    words = f"higher than declared: {words}" if order > declared + SLOPE else words
    return judge_value(order, f"order, {declared:g} declared", declared - SLOPE, words=words, count=len(seen))


def find_least_fall(tolerances: Sequence[float]) -> float:
    """Return the least factor by which errors fall from the first rtol to the last: rtol^(p/(p + 1)) at order p = 1."""
    return math.sqrt(tolerances[0] / tolerances[-1])


def remove_power(coarse: np.ndarray, fine: np.ndarray, order: float) -> np.ndarray:
    """Return the absolute part of a residual at half the step, ``fine``, that is not proportional to dt^order.

    ``coarse`` is the residual at the whole step, at equal times. Without an ``order`` (NaN) it is 1, which leaves parts
    of any other order falling as they do.
    """
    power = 2.0 ** (1.0 if math.isnan(order) else order)
    return np.abs(power * fine - coarse) / (power - 1.0)


def bound_remainder(coarser: float, fall: float = 2.0**LEAST_ORDER) -> float:
    """Return the limit on a residual: that of the ``coarser`` step over ``fall``, and at least ``ITERATED``."""
    return max(coarser / fall, ITERATED)


def grows_or_stays_constant(t: Float[np.ndarray, " nt"], left: Float[np.ndarray, " nt"]) -> bool:
    """Return whether a residual ``left`` grows with time ``t`` or is constant; what iterations leave does neither."""
    quarter = 0.25 * t[-1]
    grows = np.min(left[t >= 3.0 * quarter]) >= GROWTH * np.max(left[t <= quarter], initial=0.0)
    later = left[t > quarter]
    return bool(grows or np.ptp(later) <= STEADY * np.max(later))


def judge_fit(fit: Fit, declared: float, *, fixed: bool) -> OrderVerdict:
    """Return the verdict on a fitted order against the declared one (NaN if none); ``fixed`` means fixed steps."""
    if fit.kind == "exact":
        return "exact"
    if fit.kind == "flat" and math.isfinite(fit.floor):
        return "floor"
    if fit.kind == "flat" and not math.isnan(declared):
        return "below declared"
    if fit.kind != "power":
        return "undecided"
    if not fixed or math.isnan(declared):
        return "measured"
    if abs(fit.order - declared) <= WITHIN and fit.low >= declared - SLOPE and fit.high <= declared + SLOPE:
        return "certified"
    if fit.low > declared + WITHIN:
        return "above declared"
    return "below declared" if fit.high < declared - WITHIN else "undecided"


def fit_errors(
    steps: Sequence[float],
    errors: Sequence[float],
    good: Sequence[bool],
    scale: float,
    tolerance: float | Sequence[float],
) -> tuple[Fit, Fit]:
    """Return the fit of errors against steps, and under error control the fit against rtol (else ``NOTHING``).

    ``good`` says of each error whether it can be fitted, ``scale`` is the size of a large error. ``tolerance`` is a
    number for fixed steps, the fraction of ``scale`` that the step equations may leave; under error control it is rtol
    of each run. If all errors are rounding, or set by a tolerance, nothing is fitted: ``exact`` or ``flat``.
    """
    if max(errors) <= EXACT * scale:
        return Fit("exact"), NOTHING
    if max(errors) <= HELD * scale:
        return Fit("flat", floor=max(errors)), NOTHING
    x, y = (list(compress(v, good)) for v in (steps, errors))
    if isinstance(tolerance, float):
        fit = fit_ladder(x, y, max(HELD, tolerance) * scale)
        held = fit.kind == "flat" and max(y) <= KEPT * scale
        return (replace(fit, floor=max(y)) if held else fit), NOTHING
    if len(y) <= FEWEST:
        return NOTHING, NOTHING
    return fit_scattered(x, y), fit_scattered(list(compress(tolerance, good)), y)


def fit_ladder(dt: Sequence[float], error: Sequence[float], small: float = 0.0) -> Fit:
    """Fit the order p of error = C dt^p to errors > 0 of runs at decreasing fixed steps ``dt`` [s].

    The fit is over the longest range of steps where slopes agree. Without one the kind of the fit is ``flat`` if most
    slopes are near zero, else ``none``, as with fewer than four points. Finer points may only be left out if they lie
    on a floor (``_is_floor``, with ``small`` for errors that a tolerance may set); otherwise the kind is ``lost``.
    """
    x, y = np.log(np.asarray(dt, dtype=float)), np.log(np.asarray(error, dtype=float))
    slopes = measure_slopes(dt, error)
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
    """Return whether the errors of the points finer than those fitted stop decreasing: they lie on a floor.

    ``x`` and ``y`` are the logarithms of the steps and errors of these points, the finest last. They lie on a floor if
    the finest error is at most ``small``, or if the slope from any of them to the finest is below ``FLAT``. The slope
    from the fitted points to the first of these is not used: 1.1 may be half of a floor or the first of a lost order.
    """
    if np.exp(y[-1]) <= small:
        return True
    return bool(np.any((y[:-1] - y[-1]) < FLAT * (x[:-1] - x[-1])))


def fit_scattered(x: Sequence[float], error: Sequence[float]) -> Fit:
    """Fit the order to errors > 0 of runs under error control, the finest last, by Theil and Sen's median of slopes.

    ``x`` are their mean steps [s] or their tolerances, of which the order is then the exponent. The finest runs are
    left out if their errors no longer fall; fewer than four others give the kind ``none``.
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
    from scipy.stats import theilslopes  # here: it takes half a second to load, and most commands fit nothing

    order, _, low, high = (float(v) for v in theilslopes(y[:n], a[:n], LEVEL))
    floor = float(np.exp(np.median(y[n:]))) if n < len(a) else math.nan
    return Fit("power", used, tuple(slopes), order, low, high, floor)


def _find_agreement(slopes: np.ndarray) -> tuple[int, int] | None:
    """Return the first and last index of the longest sequence of slopes that agree and are no floor; None without one.

    At least ``FEWEST`` slopes must agree to ``AGREE``. Of sequences of equal length the finest is returned.
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
    from scipy.optimize import least_squares  # here, as in ``fit_scattered``
    from scipy.stats import t as student

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
