"""Measures for claims: numbers read off the record and the series of one run.

The rules of measures are in module measures; those of steps in module steps, of equations in module equations.
"""

import math
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from ...results.records import RunRecord
from ...results.series import Series
from . import conditioning, equations, steps  # enter their measures
from .measures import (
    END,
    MEASURES,
    NAN,
    bound,
    enter_measure,
    evaluate,
    evaluate_pair,
    measure,
    measure_over,
    reached_end,
    stretch,
)

__all__ = ["MEASURES", "conditioning", "equations", "evaluate", "evaluate_pair", "steps"]


def _largest(a: np.ndarray) -> float:
    return bound(a, np.max(np.abs(a)))


def _swing(a: np.ndarray) -> float:
    rise, fall = np.max(a - np.minimum.accumulate(a)), np.max(np.maximum.accumulate(a) - a)
    return bound(a, min(rise, fall))


def _peak_over_median(a: np.ndarray) -> float:
    known = np.abs(a[np.isfinite(a)])
    return float(np.max(known) / np.median(known)) if np.any(known) and np.median(known) > 0.0 else NAN


def _count_per_step(counter: str, record: RunRecord, series: Series | None) -> float:
    return float(getattr(record, counter)) / record.steps if reached_end(record) and record.steps else NAN


# of a series over a stretch of time; all but the first are signed
GROWING = {
    "largest": _largest,
    "highest": lambda a: bound(a, np.max(a)),
    "extent": lambda a: bound(a, np.ptp(a)),  # max - min
    "swing": _swing,  # the smaller of the largest rise and the largest fall: zero for a drift, however large
}
measure_over(stretch, "series", GROWING, grows=True)
measure_over(stretch, "series", {"lowest": lambda a: bound(a, np.min(a))})
measure_over(stretch, "series", {"peak over median": _peak_over_median}, natural="one")  # how far a moment stands out

# of a whole run: unbounded for one that stopped before its end, whose claims say "or does not end"
LOSSES = {
    "loss": lambda r: r.position_error_judged_m,  # largest error while the motion is predictable [m]
    "orientation loss": lambda r: r.orientation_error_judged_rad,
}
for name, of in LOSSES.items():
    enter_measure(name, lambda r, _, of=of: of(r) if reached_end(r) else math.inf, series=False, of_end=True)

# counts a step, of a whole run: Newton's corrections, evaluations of the equations
COUNTERS = {"corrections per step": "newton_iterations", "evaluations per step": "evaluations"}
for name, counter in COUNTERS.items():
    enter_measure(name, partial(_count_per_step, counter), series=False, until="end")


@measure("name", "partial", series=False, until="end", grows=True)
def column(record: RunRecord, series: Series | None, name: str, partial: bool = False) -> float:
    """A column of the record; of a run that got to its end, unless ``partial``."""
    value = getattr(record, name, NAN)
    return float(value) if (partial or reached_end(record)) and isinstance(value, int | float) else NAN


@measure(series=False)
def late_energy(record: RunRecord, series: Series | None) -> float:
    """|time mean of the energy error over the last quarter| [J], of a run that got to its end: others have stopped."""
    return abs(record.energy_mean_last_quarter_J) if reached_end(record) else NAN


@measure(series=False, grows=True, of_end=True, natural="firm")
def reached(record: RunRecord, series: Series | None) -> float:
    """Part of the time asked for that the run got through: 1 is the end."""
    return min(stops_at(record, series) / record.t_end_s, 1.0)


@measure(series=False, grows=True, of_end=True, natural="end")
def stops_at(record: RunRecord, series: Series | None) -> float:
    """Time at which the run stopped before its end; infinite if it did not."""
    if reached_end(record):
        return math.inf
    return 0.0 if math.isnan(record.t_reached_s) else record.t_reached_s


@measure(series=False, of_stopped=True, of_end=True)
def stop_time(record: RunRecord, series: Series | None) -> float:
    """Time at which the run stopped [s], of runs that stopped before their end."""
    return NAN if reached_end(record) else stops_at(record, series)


@measure("series at")
def value(record: RunRecord, s: Series, series: str, at: float) -> float:
    """The series at a time, between steps by a straight line."""
    t, a = s["t"], s.get(series)
    if a is None or at > t[-1] * (1.0 + END):
        return NAN
    return float(np.interp(at, t, a))


@measure("series from to", "partial", grows=True)
def rise(record: RunRecord, s: Series, series: str, begin: float, to: float, **within: Any) -> float:
    """Highest of the series from ``from`` to ``to``, less its value at ``from``."""
    a = stretch(record, s, series, begin, to, **within)
    return NAN if a is None else bound(a, np.max(a)) - value(record, s, series, begin)


@measure("series at", until="known")
def rate(record: RunRecord, s: Series, series: str, at: float) -> float:
    """|d series/dt| over the first step that ends after ``at``."""
    t, a = s["t"], s.get(series)
    if a is None or at >= t[-1]:
        return NAN
    k = int(np.searchsorted(t, at, side="right"))
    return float(abs((a[k] - a[k - 1]) / (t[k] - t[k - 1])))


@measure("series from to")
def change(record: RunRecord, s: Series, series: str, begin: float, to: float) -> float:
    """The series at ``to`` less the series at ``from``, signed."""
    return value(record, s, series, to) - value(record, s, series, begin)


@measure("of", "from to partial", grows=True)
def away(record: RunRecord, s: Series, of: str, **within: Any) -> float:
    """max |observable - the reference's| over a stretch of time."""
    own, exact = (stretch(record, s, f"{k}_{of}", **within) for k in ("obs", "ref"))
    if own is None or exact is None:
        return NAN
    known = ~np.isnan(exact)  # NaN beyond the reference's horizon
    return bound(own[known], np.max(np.abs(own[known] - exact[known]), initial=0.0)) if np.any(known) else NAN


@measure("series limit", grows=True, until="known")
def leaves_at(record: RunRecord, s: Series, series: str, limit: float) -> float:
    """First time |series| passes a limit; infinite if it never does."""
    a = s.get(series)
    if a is None:
        return NAN
    beyond = np.flatnonzero(~(np.abs(a) <= limit))
    return float(s["t"][beyond[0]]) if len(beyond) else math.inf


@measure("series", "floor", until="end", natural="one")
def grows(record: RunRecord, s: Series, series: str, floor: float = 0.0) -> float:
    """max |series| in the last quarter of the time asked for over that in the first; 1 if both are below ``floor``."""
    quarter = 0.25 * record.t_end_s
    first, last = stretch(record, s, series, to=quarter), stretch(record, s, series, 3.0 * quarter)
    if first is None or last is None:
        return NAN
    a, b = float(np.max(np.abs(last))), float(np.max(np.abs(first)))
    return 1.0 if max(a, b) <= floor else math.inf if b == 0.0 or not math.isfinite(a) else a / b


@measure("series", until="end", natural="one")
def keeps_growing(record: RunRecord, s: Series, series: str) -> float:
    """The smallest ratio of max |series| in a quarter of the time asked for to that in the quarter before."""
    edges = [0.25 * k * record.t_end_s for k in range(5)]
    quarters = [stretch(record, s, series, a, b) for a, b in pairwise(edges)]
    if any(q is None for q in quarters) or not reached_end(record):
        return NAN
    sizes = [float(np.max(np.abs(q))) for q in quarters if q is not None]
    return min(b / a if a > 0.0 else math.inf for a, b in pairwise(sizes))


@measure("series to", until="end")
def beginning(record: RunRecord, s: Series, series: str, to: float) -> float:
    """max |series| up to a time over that of the whole run: small for what grows gradually."""
    first, whole = stretch(record, s, series, to=to), stretch(record, s, series)
    if first is None or whole is None or not np.max(np.abs(whole)) > 0.0:
        return NAN
    return float(np.max(np.abs(first)) / np.max(np.abs(whole)))


@measure(grows=True, natural="one", reads="energy")
def energy_ratio(record: RunRecord, s: Series) -> float:
    """Largest mechanical energy over that of the start, whatever part of the run there is."""
    E = s["energy"]
    return bound(E, np.max(E)) / float(E[0]) if E[0] != 0.0 else NAN


@measure("series", "to", pair=True)
def apart(one: Series, other: Series, series: list[str], to: float = math.inf) -> float:
    """Largest distance of two whole runs in the named components, over the time of ``one`` or up to ``to``."""
    t = one["t"][one["t"] <= to]
    if t[-1] > other["t"][-1] * (1.0 + END) or not all(k in one and k in other for k in series):
        return NAN
    gaps = [one[k][: len(t)] - np.interp(t, other["t"], other[k]) for k in series]
    away = np.sqrt(np.sum(np.square(gaps), axis=0))
    return bound(away, np.max(away))
