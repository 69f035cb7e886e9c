"""Measure numbers for claims from the record and the series of one run.

The rules of measures are in module measures; those of steps in module steps, of equations in module equations.
"""

import math
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from ....results.records import RunRecord
from ....results.series import Series
from . import conditioning, equations, steps  # enter their measures
from .measures import (
    END,
    MEASURES,
    NAN,
    bound,
    cut_interval,
    enter_measure,
    evaluate,
    evaluate_pair,
    measure,
    measure_over,
    reached_end,
)

__all__ = ["MEASURES", "conditioning", "equations", "evaluate", "evaluate_pair", "steps"]


def _largest(a: np.ndarray) -> float:
    """Return max |a|; infinite if a value is NaN."""
    return bound(a, np.max(np.abs(a)))


def _swing(a: np.ndarray) -> float:
    """Return the smaller of the largest rise and the largest fall: zero for a monotonic drift."""
    rise, fall = np.max(a - np.minimum.accumulate(a)), np.max(np.maximum.accumulate(a) - a)
    return bound(a, min(rise, fall))


def _peak_over_median(a: np.ndarray) -> float:
    """Return max |a| over the median of |a|: how far a peak stands out; NaN if that median is zero."""
    known = np.abs(a[np.isfinite(a)])
    return float(np.max(known) / np.median(known)) if np.any(known) and np.median(known) > 0.0 else NAN


def _count_per_step(counter: str, record: RunRecord, series: Series | None) -> float:
    """Return a counter of the record per step, for a run that reached its end; else NaN."""
    return float(getattr(record, counter)) / record.steps if reached_end(record) and record.steps else NAN


# measures of a series over an interval of time; all but the first are signed
GROWING = {
    "largest": _largest,
    "highest": lambda a: bound(a, np.max(a)),
    "extent": lambda a: bound(a, np.ptp(a)),  # max - min
    "swing": _swing,  # the smaller of the largest rise and the largest fall: zero for a monotonic drift
}
measure_over(cut_interval, "series", GROWING, grows=True)
measure_over(cut_interval, "series", {"lowest": lambda a: bound(a, np.min(a))})
measure_over(
    cut_interval, "series", {"peak over median": _peak_over_median}, natural="one"
)  # how far a peak stands out

# measures of a whole run, infinite if it stopped early, since the claims say "or does not end"
LOSSES = {
    "loss": lambda r: r.position_error_judged_m,  # largest error while the motion is predictable [m]
    "orientation loss": lambda r: r.orientation_error_judged_rad,
}
for name, of in LOSSES.items():
    enter_measure(name, lambda r, _, of=of: of(r) if reached_end(r) else math.inf, series=False, of_end=True)

# counts per step of a whole run: Newton's corrections, evaluations of the equations
COUNTERS = {"corrections per step": "newton_iterations", "evaluations per step": "evaluations"}
for name, counter in COUNTERS.items():
    enter_measure(name, partial(_count_per_step, counter), series=False, until="end")


@measure("name", "partial", series=False, until="end", grows=True)
def column(record: RunRecord, series: Series | None, name: str, partial: bool = False) -> float:
    """Return the number in column ``name`` of the record; NaN if the run did not reach its end, unless ``partial``."""
    value = getattr(record, name, NAN)
    return float(value) if (partial or reached_end(record)) and isinstance(value, int | float) else NAN


@measure(series=False)
def late_energy(record: RunRecord, series: Series | None) -> float:
    """Return |time mean of the energy error over the last quarter| [J] of a run that reached its end."""
    return abs(record.energy_mean_last_quarter_J) if reached_end(record) else NAN


@measure(series=False, grows=True, of_end=True, natural="firm")
def reached(record: RunRecord, series: Series | None) -> float:
    """Return the fraction of the requested time that the run reached; 1 is the end."""
    return min(stops_at(record, series) / record.t_end_s, 1.0)


@measure(series=False, grows=True, of_end=True, natural="end")
def stops_at(record: RunRecord, series: Series | None) -> float:
    """Return the time at which the run stopped before its end [s]; infinite if it did not."""
    if reached_end(record):
        return math.inf
    return 0.0 if math.isnan(record.t_reached_s) else record.t_reached_s


@measure("", "by", series=False, of_stopped=True, of_end=True)
def stop_time(record: RunRecord, series: Series | None, by: float = math.inf) -> float:
    """Return the time at which the run stopped [s]; NaN if it reached its end or stopped after ``by`` [s]."""
    time = stops_at(record, series)
    return NAN if reached_end(record) or time > by else time


@measure("series at")
def value(record: RunRecord, s: Series, series: str, at: float) -> float:
    """Return the value of a series at the time ``at`` [s], interpolated linearly; NaN if the run stopped before it."""
    t, a = s["t"], s.get(series)
    if a is None or at > t[-1] * (1.0 + END):
        return NAN
    return float(np.interp(at, t, a))


@measure("series from to", "partial", grows=True)
def rise(record: RunRecord, s: Series, series: str, begin: float, to: float, **within: Any) -> float:
    """Return how far a series rises: its maximum from ``from`` to ``to`` [s], minus its value at ``from``."""
    a = cut_interval(record, s, series, begin, to, **within)
    return NAN if a is None else bound(a, np.max(a)) - value(record, s, series, begin)


@measure("series at", until="known")
def rate(record: RunRecord, s: Series, series: str, at: float) -> float:
    """Return |d series/dt| over the first step that ends after ``at`` [s]; NaN if the run stopped before it."""
    t, a = s["t"], s.get(series)
    if a is None or at >= t[-1]:
        return NAN
    k = int(np.searchsorted(t, at, side="right"))
    return float(abs((a[k] - a[k - 1]) / (t[k] - t[k - 1])))


@measure("series from to")
def change(record: RunRecord, s: Series, series: str, begin: float, to: float) -> float:
    """Return the value of a series at ``to`` minus that at ``from`` [s], signed."""
    return value(record, s, series, to) - value(record, s, series, begin)


@measure("of", "from to partial", grows=True)
def away(record: RunRecord, s: Series, of: str, **within: Any) -> float:
    """Return max |observable - its reference| of the observable named ``of``, over an interval of time."""
    own, exact = (cut_interval(record, s, f"{k}_{of}", **within) for k in ("obs", "ref"))
    if own is None or exact is None:
        return NAN
    known = ~np.isnan(exact)  # NaN beyond the reference's horizon
    return bound(own[known], np.max(np.abs(own[known] - exact[known]), initial=0.0)) if np.any(known) else NAN


@measure("series limit", grows=True, until="known")
def leaves_at(record: RunRecord, s: Series, series: str, limit: float) -> float:
    """Return the first time |series| exceeds a limit [s]; infinite if it never does."""
    a = s.get(series)
    if a is None:
        return NAN
    beyond = np.flatnonzero(~(np.abs(a) <= limit))
    return float(s["t"][beyond[0]]) if len(beyond) else math.inf


@measure("series", "floor", until="end", natural="one")
def grows(record: RunRecord, s: Series, series: str, floor: float = 0.0) -> float:
    """Return max |series| in the last quarter of the requested time over that in the first; 1 if both are small.

    Small is at most ``floor``.
    """
    quarter = 0.25 * record.t_end_s
    first, last = cut_interval(record, s, series, to=quarter), cut_interval(record, s, series, 3.0 * quarter)
    if first is None or last is None:
        return NAN
    a, b = float(np.max(np.abs(last))), float(np.max(np.abs(first)))
    return 1.0 if max(a, b) <= floor else math.inf if b == 0.0 or not math.isfinite(a) else a / b


@measure("series", until="end", natural="one")
def keeps_growing(record: RunRecord, s: Series, series: str) -> float:
    """Return the smallest ratio of max |series| in one quarter of the requested time to that in the quarter before.

    Above 1 the series grows in every quarter.
    """
    edges = [0.25 * k * record.t_end_s for k in range(5)]
    quarters = [cut_interval(record, s, series, a, b) for a, b in pairwise(edges)]
    if any(q is None for q in quarters) or not reached_end(record):
        return NAN
    sizes = [float(np.max(np.abs(q))) for q in quarters if q is not None]
    return min(b / a if a > 0.0 else math.inf for a, b in pairwise(sizes))


@measure("series to", until="end")
def beginning(record: RunRecord, s: Series, series: str, to: float) -> float:
    """Return max |series| up to the time ``to`` [s] over that of the whole run: small for gradual growth."""
    first, whole = cut_interval(record, s, series, to=to), cut_interval(record, s, series)
    if first is None or whole is None or not np.max(np.abs(whole)) > 0.0:
        return NAN
    return float(np.max(np.abs(first)) / np.max(np.abs(whole)))


@measure(grows=True, natural="one", reads="energy")
def energy_ratio(record: RunRecord, s: Series) -> float:
    """Return the ratio of the largest mechanical energy to the initial one, over as much of the run as exists."""
    E = s["energy"]
    return bound(E, np.max(E)) / float(E[0]) if E[0] != 0.0 else NAN


@measure("series", "to", pair=True)
def apart(one: Series, other: Series, series: list[str], to: float = math.inf) -> float:
    """Return the largest distance of two runs: the norm of the differences of the named series at the steps of ``one``.

    ``to`` [s] ends the comparison early; NaN if the other run ends before that or lacks a series.
    """
    t = one["t"][one["t"] <= to]
    if t[-1] > other["t"][-1] * (1.0 + END) or not all(k in one and k in other for k in series):
        return NAN
    gaps = [one[k][: len(t)] - np.interp(t, other["t"], other[k]) for k in series]
    away = np.sqrt(np.sum(np.square(gaps), axis=0))
    return bound(away, np.max(away))
