"""The catalogue of measures: a measure is a function of one run's record and series, entered under its name.

Every measure is NaN where the run has no such number, above all where it ended before the time asked about: a run
that stopped must not look accurate. ``partial = true`` in a test asks for the part that is there.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...results.records import RunRecord
from ...results.series import Series

NAN = math.nan
END = 1e-9  # relative: t_reached this close to t_end is the end
COMPARED = ("position_error", "orientation_error")  # against a reference: NaN is beyond its horizon


@dataclass(frozen=True)
class Measure:
    """A function of (record, series, arguments) with the arguments it takes and those it cannot do without.

    ``until`` says which part of a run settles the number: ``to`` (or ``at``; without either the end), ``end``, or
    ``known``: once there is a number, it stays. A number that ``grows`` can only become larger as a run continues.
    """

    of: Callable[..., float]
    takes: tuple[str, ...]
    wants: tuple[str, ...]
    needs_series: bool = True
    of_pair: bool = False
    until: str = "to"
    grows: bool = False
    doc: str = ""


MEASURES: dict[str, Measure] = {}


def measure(
    wants: str = "", takes: str = "", *, series: bool = True, pair: bool = False, until: str = "to", grows: bool = False
) -> Callable[..., Any]:
    """Enter a function in the catalogue under its name, with spaces for underscores."""

    def enter(function: Callable[..., float]) -> Callable[..., float]:
        needed, known = tuple(wants.split()), tuple(takes.split())
        doc = (function.__doc__ or "").strip().splitlines()[0]
        name = function.__name__.replace("_", " ")
        MEASURES[name] = Measure(function, (*needed, *known), needed, series, pair, until, grows, doc)
        return function

    return enter


def evaluate(name: str, record: RunRecord, series: Series | None, arguments: Mapping[str, Any]) -> float:
    """The number, NaN if the run has none."""
    m = MEASURES[name]
    if m.needs_series and series is None:
        return NAN
    with np.errstate(all="ignore"):
        return float(m.of(record, series, **{"begin" if k == "from" else k: v for k, v in arguments.items()}))


def evaluate_pair(
    name: str,
    one: tuple[RunRecord, Series | None],
    other: tuple[RunRecord, Series | None],
    arguments: Mapping[str, Any],
) -> float:
    """The number of two runs, NaN if one has no series or stopped before its end."""
    if one[1] is None or other[1] is None or not (reached_end(one[0]) and reached_end(other[0])):
        return NAN
    with np.errstate(all="ignore"):
        return float(MEASURES[name].of(one[1], other[1], **arguments))


def reached_end(record: RunRecord) -> bool:
    """Whether the last accepted step ends at the time asked for."""
    return record.t_reached_s >= record.t_end_s * (1.0 - END)  # False for NaN


def array(s: Series, name: str) -> np.ndarray | None:
    """The series of that name, None where a run has none."""
    return s.arrays.get(name)


def stretch(record: RunRecord, s: Series, name: str, begin: float, to: float, partial: bool) -> np.ndarray | None:
    """The series in [begin, to]; None if it does not exist or the run ended before ``to`` (``partial``: ``begin``)."""
    a, t = array(s, name), s["t"]
    end = record.t_end_s if math.isnan(to) else to
    if a is None or (not partial and t[-1] < end * (1.0 - END)):
        return None
    inside = a[(t >= begin) & (t <= end * (1.0 + END))]
    if name in COMPARED:
        inside = inside[~np.isnan(inside)]
    return inside if len(inside) else None


def bound(a: np.ndarray, found: Any) -> float:
    """Infinite as soon as one value is not a number: a motion that became NaN is no small error."""
    return math.inf if np.any(np.isnan(a)) else float(found)
