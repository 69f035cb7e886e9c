"""What is measured for a claim: numbers read off the record and the series of one run.

The rules of measures are in module measures; those of steps in module steps.
"""

import json
import math
from itertools import pairwise
from typing import Any

import numpy as np

from ...results.records import RunRecord
from ...results.series import Series
from . import equations, steps  # enter their measures
from .measures import END, MEASURES, NAN, bound, evaluate, evaluate_pair, measure, measure_over, reached_end, stretch

__all__ = ["MEASURES", "equations", "evaluate", "evaluate_pair", "steps"]


@measure("name", "partial", series=False, until="end", grows=True)
def column(record: RunRecord, series: Series | None, name: str, partial: bool = False) -> float:
    """A column of the record; of a run that got to its end, unless ``partial``."""
    value = getattr(record, name, NAN)
    return float(value) if (partial or reached_end(record)) and isinstance(value, int | float) else NAN


@measure("of", "part partial", series=False, until="end")
def invariant(record: RunRecord, series: Series | None, of: str, part: str = "max", partial: bool = False) -> float:
    """``max`` or ``end`` of the drift of an invariant."""
    return _embedded(record, record.invariant_drifts, of, part, partial)


@measure("of", "part partial", series=False, until="end")
def observable_error(
    record: RunRecord, series: Series | None, of: str, part: str = "max", partial: bool = False
) -> float:
    """``max`` or ``end`` of the error of an observable against the reference."""
    return _embedded(record, record.observable_errors, of, part, partial)


@measure(series=False, grows=True, natural="firm")
def reached(record: RunRecord, series: Series | None) -> float:
    """Part of the time asked for that the run got through: 1 is the end."""
    return min(stops_at(record, series) / record.t_end_s, 1.0)


@measure(series=False, grows=True, natural="end")
def stops_at(record: RunRecord, series: Series | None) -> float:
    """Time at which the run stopped before its end; infinite if it did not."""
    if reached_end(record):
        return math.inf
    return 0.0 if math.isnan(record.t_reached_s) else record.t_reached_s


@measure(series=False, of_stopped=True)
def stop_time(record: RunRecord, series: Series | None) -> float:
    """Time at which the run stopped [s], of runs that stopped before their end."""
    return NAN if reached_end(record) else stops_at(record, series)


@measure(series=False)
def loss(record: RunRecord, series: Series | None) -> float:
    """Largest position error [m] while the motion is predictable; unbounded for a run that stopped before its end."""
    return record.position_error_judged_m if reached_end(record) else math.inf


@measure(series=False)
def orientation_loss(record: RunRecord, series: Series | None) -> float:
    """The same of the orientation [rad]."""
    return record.orientation_error_judged_rad if reached_end(record) else math.inf


@measure(series=False)
def late_energy(record: RunRecord, series: Series | None) -> float:
    """|time mean of the energy error over the last quarter| [J]; unbounded for a run that stopped before its end."""
    return abs(record.energy_mean_last_quarter_J) if reached_end(record) else math.inf


@measure_over(stretch, "series", grows=True)
def largest(a: np.ndarray) -> float:
    """max |series| over a stretch of time."""
    return bound(a, np.max(np.abs(a)))


@measure_over(stretch, "series", grows=True)
def highest(a: np.ndarray) -> float:
    """max of the series over a stretch of time, signed."""
    return bound(a, np.max(a))


@measure_over(stretch, "series")
def lowest(a: np.ndarray) -> float:
    """min of the series over a stretch of time, signed."""
    return bound(a, np.min(a))


@measure_over(stretch, "series", grows=True)
def extent(a: np.ndarray) -> float:
    """max - min of the series over a stretch of time."""
    return bound(a, np.ptp(a))


@measure("series at")
def value(record: RunRecord, s: Series, series: str, at: float) -> float:
    """The series at a time, between steps by a straight line."""
    t, a = s["t"], s.arrays.get(series)
    if a is None or at > t[-1] * (1.0 + END):
        return NAN
    return float(np.interp(at, t, a))


@measure("series at", until="known")
def rate(record: RunRecord, s: Series, series: str, at: float) -> float:
    """|d series/dt| over the first step that ends after ``at``."""
    t, a = s["t"], s.arrays.get(series)
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
    a = s.arrays.get(series)
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


@measure_over(stretch, "series", grows=True)
def swing(a: np.ndarray) -> float:
    """The smaller of the largest rise and the largest fall of the series: zero for a drift, however large."""
    rise, fall = np.max(a - np.minimum.accumulate(a)), np.max(np.maximum.accumulate(a) - a)
    return bound(a, min(rise, fall))


@measure(series=False, until="end")
def corrections_per_step(record: RunRecord, series: Series | None) -> float:
    """Newton's corrections a step, of a run that got to its end."""
    return record.newton_iterations / record.steps if reached_end(record) and record.steps else NAN


@measure(series=False, until="end")
def evaluations_per_step(record: RunRecord, series: Series | None) -> float:
    """Evaluations of the equations a step, of a run that got to its end."""
    return record.evaluations / record.steps if reached_end(record) and record.steps else NAN


@measure(grows=True, natural="one")
def energy_ratio(record: RunRecord, s: Series) -> float:
    """Largest mechanical energy over that of the start, whatever part of the run there is."""
    E = s["energy"]
    return bound(E, np.max(E)) / float(E[0]) if E[0] != 0.0 else NAN


@measure_over(stretch, "series", natural="one")
def peak_over_median(a: np.ndarray) -> float:
    """max |series| over its median over a stretch of time: how far one moment stands out."""
    known = np.abs(a[np.isfinite(a)])
    return float(np.max(known) / np.median(known)) if np.any(known) and np.median(known) > 0.0 else NAN


@measure("series", "to", pair=True)
def apart(one: Series, other: Series, series: list[str], to: float = math.inf) -> float:
    """Largest distance of two whole runs in the named components, over the time of ``one`` or up to ``to``."""
    t = one["t"][one["t"] <= to]
    if t[-1] > other["t"][-1] * (1.0 + END) or not all(k in one and k in other for k in series):
        return NAN
    gaps = [one[k][: len(t)] - np.interp(t, other["t"], other[k]) for k in series]
    away = np.sqrt(np.sum(np.square(gaps), axis=0))
    return bound(away, np.max(away))


def _embedded(record: RunRecord, text: str, of: str, part: str, partial: bool) -> float:
    found = json.loads(text).get(of)
    if found is None or not (partial or reached_end(record)):
        return NAN
    return abs(float(found[part]))
