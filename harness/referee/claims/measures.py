"""The catalogue of measures: a measure is a function of one run's record and series, entered under its name.

Every measure is NaN where the run has no such number, above all where it ended before the time asked about: a run
that stopped must not look accurate. ``partial = true`` in a test asks for the part that is there.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np

from ...results.records import RunRecord
from ...results.series import Series

NAN = math.nan
Natural = Literal["zero", "one", "end", "firm"]
END = 1e-9  # relative: t_reached this close to t_end is the end
COMPARED = ("position_error", "orientation_error")  # against a reference: NaN is beyond its horizon


@dataclass(frozen=True)
class Measure:
    """A function of (record, series, arguments) with the arguments it takes and those it cannot do without.

    ``until`` says which part of a run settles the number: ``to`` (or ``at``; without either the end), ``end``, or
    ``known``: once there is a number, it stays. A number that ``grows`` can only become larger as a run continues.
    One ``of_stopped`` runs alone leaves the others open, one ``of_problem`` is the same of all runs. One ``of_end`` is
    about where a run ends, so that one which stopped has it, too; of any other measure an early end leaves open what
    the rest of the run might have changed. Bands are moved
    from the limit ``natural``; a ``firm`` one is a count or an end reached, which no factor moves. ``reads`` are the
    series that it takes beside those its arguments name.
    """

    of: Callable[..., float]
    takes: tuple[str, ...]
    wants: tuple[str, ...]
    needs_series: bool = True
    of_pair: bool = False
    until: str = "to"
    grows: bool = False
    of_stopped: bool = False
    of_problem: bool = False
    of_end: bool = False
    natural: Natural = "zero"
    reads: tuple[str, ...] = ()


MEASURES: dict[str, Measure] = {}


def enter_measure(
    name: str, of: Callable[..., Any], wants: str = "", takes: str = "", *, series: bool = True, pair: bool = False,
    until: str = "to", grows: bool = False, of_stopped: bool = False, of_problem: bool = False,
    of_end: bool = False, natural: Natural = "zero", reads: str = "",
) -> None:  # fmt: skip
    """Enter a function in the catalogue."""
    needed = tuple(wants.split())
    taken = (*needed, *takes.split())
    kind = (series, pair, until, grows, of_stopped, of_problem, of_end, natural, tuple(reads.split()))
    MEASURES[name] = Measure(of, taken, needed, *kind)


def series_read(name: str, arguments: Mapping[str, Any]) -> set[str]:
    """The series of a run that the measure reads at every step, beside the times."""
    if not MEASURES[name].needs_series:
        return set()
    named = [arguments[k] for k in ("series", "low") if k in arguments]
    out = {*MEASURES[name].reads, *(s for one in named for s in ([one] if isinstance(one, str) else one))}
    return out | {f"{kind}_{arguments['of']}" for kind in ("obs", "ref") if "of" in arguments}


def measure(wants: str = "", takes: str = "", **kind: Any) -> Callable[..., Any]:
    """Enter a function in the catalogue under its name, with spaces for underscores."""

    def enter(function: Callable[..., float]) -> Callable[..., float]:
        enter_measure(function.__name__.replace("_", " "), function, wants, takes, **kind)
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
    """The number of two runs, NaN if one has no series or stopped before ``to`` (by default its end)."""
    asked = (min(record.t_end_s, arguments.get("to") or record.t_end_s) for record, _ in (one, other))
    reached = all(r.t_reached_s >= t * (1.0 - END) for (r, _), t in zip((one, other), asked, strict=True))
    if one[1] is None or other[1] is None or not reached:
        return NAN
    with np.errstate(all="ignore"):
        return float(MEASURES[name].of(one[1], other[1], **arguments))


def reached_end(record: RunRecord) -> bool:
    """Whether the last accepted step ends at the time asked for."""
    return record.t_reached_s >= record.t_end_s * (1.0 - END)  # False for NaN


def measure_over(
    part: Callable[..., np.ndarray | None], wants: str, functions: Mapping[str, Callable[..., Any]], **kind: Any
) -> None:
    """Enter functions of what ``part`` takes from a stretch of time; NaN where that is nothing."""

    def of_part(function: Callable[..., Any], record: RunRecord, s: Series, **arguments: Any) -> float:
        a = part(record, s, **arguments)
        return NAN if a is None else float(function(a))

    for name, function in functions.items():
        enter_measure(name, partial(of_part, function), wants, "from to partial", **kind)


def stretch(
    record: RunRecord, s: Series, series: str, begin: float = 0.0, to: float = NAN, partial: bool = False
) -> np.ndarray | None:
    """The series in [begin, to]; None if it does not exist or the run ended before ``to`` (``partial``: ``begin``)."""
    a, t = s.get(series), s["t"]
    end = record.t_end_s if math.isnan(to) else to
    if a is None or (not partial and t[-1] < end * (1.0 - END)):
        return None
    inside = a[(t >= begin) & (t <= end * (1.0 + END))]
    if series in COMPARED:
        inside = inside[~np.isnan(inside)]
    return inside if len(inside) else None


def bound(a: np.ndarray, found: Any) -> float:
    """Infinite as soon as one value is not a number: a motion that became NaN is no small error."""
    return math.inf if np.any(np.isnan(a)) else float(found)
