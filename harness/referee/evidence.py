"""What is measured for a claim: numbers read off the record and the series of one run.

Every measure is NaN where the run has no such number, above all where it ended before the time asked about: a run
that stopped must not look accurate. ``partial = true`` in a test asks for the part that is there.
"""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.records import RunRecord
from harness.series import Series

NAN = math.nan
END = 1e-9  # relative: t_reached this close to t_end is the end
ORIGIN = 0.01  # of t_end: step sizes are judged after a solver's start-up


@dataclass(frozen=True)
class Measure:
    """A function of (record, series, arguments) with the arguments it takes and those it cannot do without."""

    of: Callable[..., float]
    takes: tuple[str, ...]
    wants: tuple[str, ...]
    needs_series: bool = True
    of_pair: bool = False
    doc: str = ""


MEASURES: dict[str, Measure] = {}


def measure(wants: str = "", takes: str = "", *, series: bool = True, pair: bool = False) -> Callable[..., Any]:
    """Enter a function in the catalogue under its name, with spaces for underscores."""

    def enter(function: Callable[..., float]) -> Callable[..., float]:
        needed, known = tuple(wants.split()), tuple(takes.split())
        doc = (function.__doc__ or "").strip().splitlines()[0]
        MEASURES[function.__name__.replace("_", " ")] = Measure(function, (*needed, *known), needed, series, pair, doc)
        return function

    return enter


def evaluate(name: str, record: RunRecord, series: Series | None, arguments: Mapping[str, Any]) -> float:
    """The number, NaN if the run has none."""
    m = MEASURES[name]
    if m.needs_series and series is None:
        return NAN
    with np.errstate(all="ignore"):
        return float(m.of(record, series, **{"begin" if k == "from" else k: v for k, v in arguments.items()}))


def evaluate_pair(name: str, one: Series | None, other: Series | None, arguments: Mapping[str, Any]) -> float:
    """The number of two runs, NaN if one has no series."""
    if one is None or other is None:
        return NAN
    with np.errstate(all="ignore"):
        return float(MEASURES[name].of(one, other, **arguments))


@measure("name", "partial", series=False)
def column(record: RunRecord, series: Series | None, name: str, partial: bool = False) -> float:
    """A column of the record; of a run that got to its end, unless ``partial``."""
    value = getattr(record, name, NAN)
    return float(value) if (partial or reached_end(record)) and isinstance(value, int | float) else NAN


@measure("of", "part partial", series=False)
def invariant(record: RunRecord, series: Series | None, of: str, part: str = "max", partial: bool = False) -> float:
    """``max`` or ``end`` of the drift of an invariant."""
    return _embedded(record, record.invariant_drifts, of, part, partial)


@measure("of", "part partial", series=False)
def observable_error(
    record: RunRecord, series: Series | None, of: str, part: str = "max", partial: bool = False
) -> float:
    """``max`` or ``end`` of the error of an observable against the reference."""
    return _embedded(record, record.observable_errors, of, part, partial)


@measure(series=False)
def reached(record: RunRecord, series: Series | None) -> float:
    """Part of the time asked for that the run got through: 1 is the end."""
    if reached_end(record):
        return 1.0
    return 0.0 if math.isnan(record.t_reached_s) else min(record.t_reached_s / record.t_end_s, 1.0)


@measure(series=False)
def stops_at(record: RunRecord, series: Series | None) -> float:
    """Time at which the run stopped before its end; infinite if it did not."""
    if reached_end(record):
        return math.inf
    return 0.0 if math.isnan(record.t_reached_s) else record.t_reached_s


@measure(series=False)
def loss(record: RunRecord, series: Series | None) -> float:
    """Largest position error against the reference [m]; unbounded for a run that stopped before its end."""
    return record.position_error_max_m if reached_end(record) else math.inf


@measure(series=False)
def late_energy(record: RunRecord, series: Series | None) -> float:
    """|time mean of the energy error over the last quarter| [J]; unbounded for a run that stopped before its end."""
    return abs(record.energy_mean_last_quarter_J) if reached_end(record) else math.inf


@measure("series", "from to partial")
def largest(
    record: RunRecord, s: Series, series: str, begin: float = 0.0, to: float = NAN, partial: bool = False
) -> float:
    """max |series| over a stretch of time."""
    a = _stretch(record, s, series, begin, to, partial)
    return NAN if a is None else _bound(a, np.max(np.abs(a)))


@measure("series", "from to partial")
def highest(
    record: RunRecord, s: Series, series: str, begin: float = 0.0, to: float = NAN, partial: bool = False
) -> float:
    """max of the series over a stretch of time, signed."""
    a = _stretch(record, s, series, begin, to, partial)
    return NAN if a is None else _bound(a, np.max(a))


@measure("series", "from to partial")
def lowest(
    record: RunRecord, s: Series, series: str, begin: float = 0.0, to: float = NAN, partial: bool = False
) -> float:
    """min of the series over a stretch of time, signed."""
    a = _stretch(record, s, series, begin, to, partial)
    return NAN if a is None else _bound(a, np.min(a))


@measure("series", "from to partial")
def extent(
    record: RunRecord, s: Series, series: str, begin: float = 0.0, to: float = NAN, partial: bool = False
) -> float:
    """max - min of the series over a stretch of time."""
    a = _stretch(record, s, series, begin, to, partial)
    return NAN if a is None else _bound(a, np.ptp(a))


@measure("series at")
def value(record: RunRecord, s: Series, series: str, at: float) -> float:
    """The series at a time, between steps by a straight line."""
    t, a = s["t"], _array(s, series)
    if a is None or at > t[-1] * (1.0 + END):
        return NAN
    return float(np.interp(at, t, a))


@measure("series at")
def rate(record: RunRecord, s: Series, series: str, at: float) -> float:
    """|d series/dt| over the first step that ends after ``at``."""
    t, a = s["t"], _array(s, series)
    if a is None or at >= t[-1]:
        return NAN
    k = int(np.searchsorted(t, at, side="right"))
    return float(abs((a[k] - a[k - 1]) / (t[k] - t[k - 1])))


@measure("series from to")
def change(record: RunRecord, s: Series, series: str, begin: float, to: float) -> float:
    """The series at ``to`` less the series at ``from``, signed."""
    return value(record, s, series, to) - value(record, s, series, begin)


@measure("of", "from to partial")
def away(record: RunRecord, s: Series, of: str, begin: float = 0.0, to: float = NAN, partial: bool = False) -> float:
    """max |observable - the reference's| over a stretch of time."""
    own, exact = (_stretch(record, s, f"{k}_{of}", begin, to, partial) for k in ("obs", "ref"))
    if own is None or exact is None:
        return NAN
    known = ~np.isnan(exact)  # NaN beyond the reference's horizon
    return _bound(own[known], np.max(np.abs(own[known] - exact[known]), initial=0.0)) if np.any(known) else NAN


@measure("series limit")
def leaves_at(record: RunRecord, s: Series, series: str, limit: float) -> float:
    """First time |series| passes a limit; infinite if it never does."""
    a = _array(s, series)
    if a is None:
        return NAN
    beyond = np.flatnonzero(~(np.abs(a) <= limit))
    return float(s["t"][beyond[0]]) if len(beyond) else math.inf


@measure("series")
def grows(record: RunRecord, s: Series, series: str) -> float:
    """max |series| in the last quarter of the time asked for over that in the first quarter."""
    quarter = 0.25 * record.t_end_s
    first = _stretch(record, s, series, 0.0, quarter, False)
    last = _stretch(record, s, series, 3.0 * quarter, NAN, False)
    if first is None or last is None:
        return NAN
    a, b = float(np.max(np.abs(last))), float(np.max(np.abs(first)))
    return 1.0 if a == b == 0.0 else math.inf if b == 0.0 or not math.isfinite(a) else a / b


@measure("series to")
def beginning(record: RunRecord, s: Series, series: str, to: float) -> float:
    """max |series| up to a time over that of the whole run: small for what grows gradually."""
    first, whole = _stretch(record, s, series, 0.0, to, False), _stretch(record, s, series, 0.0, NAN, False)
    if first is None or whole is None or not np.max(np.abs(whole)) > 0.0:
        return NAN
    return float(np.max(np.abs(first)) / np.max(np.abs(whole)))


@measure()
def energy_ratio(record: RunRecord, s: Series) -> float:
    """Largest mechanical energy over that of the start, whatever part of the run there is."""
    E = s["energy"]
    return _bound(E, np.max(E)) / float(E[0]) if E[0] != 0.0 else NAN


@measure("", "from to")
def step_ratio(record: RunRecord, s: Series, begin: float = NAN, to: float = NAN) -> float:
    """Largest over smallest step after the start-up, the last step left out."""
    dt = _steps(record, s, begin, to)
    return NAN if dt is None else float(np.max(dt) / np.min(dt))


@measure("", "from to")
def irregularity(record: RunRecord, s: Series, begin: float = NAN, to: float = NAN) -> float:
    """Mean |change of log10 dt| from step to step after the start-up: 0 for a fixed step."""
    dt = _steps(record, s, begin, to)
    return NAN if dt is None else float(np.mean(np.abs(np.diff(np.log10(dt)))))


@measure("", "from to")
def typical_step(record: RunRecord, s: Series, begin: float = NAN, to: float = NAN) -> float:
    """Median step after the start-up [s]."""
    dt = _steps(record, s, begin, to)
    return NAN if dt is None else float(np.median(dt))


@measure("", "from to")
def smallest_step(record: RunRecord, s: Series, begin: float = NAN, to: float = NAN) -> float:
    """Smallest step after the start-up [s], the last step left out."""
    dt = _steps(record, s, begin, to)
    return NAN if dt is None else float(np.min(dt))


@measure("series low within")
def drop_at_lowest(record: RunRecord, s: Series, series: str, low: str, within: float) -> float:
    """Lowest of ``series`` within a time of the first minimum of ``low``, less its value before: a fall is negative."""
    found = _around_lowest(s, series, low, within)
    return NAN if found is None else float(np.min(found) - found[0])


@measure("series low within")
def rise_at_lowest(record: RunRecord, s: Series, series: str, low: str, within: float) -> float:
    """Highest of ``series`` within a time of the first minimum of ``low``, less its value before."""
    found = _around_lowest(s, series, low, within)
    return NAN if found is None else float(np.max(found) - found[0])


@measure("series low", "to")
def peak_after_lowest(record: RunRecord, s: Series, series: str, low: str, to: float = NAN) -> float:
    """|time of the largest |series| up to ``to`` - time of the first minimum of ``low``| [s]."""
    a, turn = _stretch(record, s, series, 0.0, to, False), _first_minimum(s, low)
    return NAN if a is None or turn is None else float(abs(s["t"][int(np.argmax(np.abs(a)))] - s["t"][turn]))


@measure("series", "from to partial")
def peak_over_median(
    record: RunRecord, s: Series, series: str, begin: float = 0.0, to: float = NAN, partial: bool = False
) -> float:
    """max |series| over its median over a stretch of time: how far one moment stands out."""
    a = _stretch(record, s, series, begin, to, partial)
    if a is None or not np.any(np.isfinite(a)):
        return NAN
    known = np.abs(a[np.isfinite(a)])
    return float(np.max(known) / np.median(known)) if np.median(known) > 0.0 else NAN


@measure("series", "", pair=True)
def apart(one: Series, other: Series, series: list[str]) -> float:
    """Largest distance of two runs in the named components, over the time of ``one``; NaN if ``other`` is shorter."""
    t = one["t"]
    if t[-1] > other["t"][-1] * (1.0 + END) or not all(k in one and k in other for k in series):
        return NAN
    gaps = [one[k] - np.interp(t, other["t"], other[k]) for k in series]
    away = np.sqrt(np.sum(np.square(gaps), axis=0))
    return _bound(away, np.max(away))


def reached_end(record: RunRecord) -> bool:
    """Whether the last accepted step ends at the time asked for."""
    return record.t_reached_s >= record.t_end_s * (1.0 - END)  # False for NaN


def _embedded(record: RunRecord, text: str, of: str, part: str, partial: bool) -> float:
    found = json.loads(text).get(of)
    if found is None or not (partial or reached_end(record)):
        return NAN
    return abs(float(found[part]))


def _array(s: Series, name: str) -> np.ndarray | None:
    return s.arrays.get(name)


def _stretch(record: RunRecord, s: Series, name: str, begin: float, to: float, partial: bool) -> np.ndarray | None:
    """The series in [begin, to]; None if it does not exist or the run ended before ``to`` (``partial``: ``begin``)."""
    a, t = _array(s, name), s["t"]
    end = record.t_end_s if math.isnan(to) else to
    if a is None or (not partial and t[-1] < end * (1.0 - END)):
        return None
    inside = a[(t >= begin) & (t <= end * (1.0 + END))]
    if name.endswith("_error") and name != "energy_error":  # against a reference: NaN is beyond its horizon
        inside = inside[~np.isnan(inside)]
    return inside if len(inside) else None


def _bound(a: np.ndarray, found: Any) -> float:
    """Infinite as soon as one value is not a number: a motion that became NaN is no small error."""
    return math.inf if np.any(np.isnan(a)) else float(found)


def _steps(record: RunRecord, s: Series, begin: float, to: float) -> np.ndarray | None:
    t, dt = s["t"][:-1], s["dt"][:-1]
    begin = ORIGIN * record.t_end_s if math.isnan(begin) else begin
    end = math.inf if math.isnan(to) else to
    inside = dt[(t > begin) & (t <= end) & (dt > 0.0)]
    return inside if len(inside) > 2 else None


def _first_minimum(s: Series, low: str) -> int | None:
    h = _array(s, low)
    if h is None:
        return None
    turns = np.flatnonzero((h[1:-1] < h[:-2]) & (h[1:-1] <= h[2:])) + 1
    return int(turns[0]) if len(turns) else None


def _around_lowest(s: Series, name: str, low: str, within: float) -> np.ndarray | None:
    a, turn, t = _array(s, name), _first_minimum(s, low), s["t"]
    return None if a is None or turn is None else a[np.abs(t - t[turn]) <= within]
