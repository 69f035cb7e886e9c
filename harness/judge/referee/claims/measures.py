"""Keep the catalogue of measures: functions of one run's record and series, entered under their names.

Every measure is NaN if the run has no such number, above all if it ended before the time of the claim: a run that
stopped must not look accurate. ``partial = true`` in a test asks for the part that exists.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np

from ....results.records import RunRecord
from ....results.series import Series

NAN = math.nan
Natural = Literal["zero", "one", "end", "firm"]
END = 1e-9  # relative, from t_reached to t_end: times are sums of steps, and a million roundings add up to 1e-10
COMPARED = ("position_error", "orientation_error")  # errors against a reference; NaN beyond its horizon


@dataclass(frozen=True)
class Measure:
    """A function of (record, series, arguments), with the arguments that it takes and what its number depends on.

    The fields determine which runs decide the number: for most measures, an early end leaves open what the rest of the
    run might have changed.
    """

    of: Callable[..., float]  # returns the number
    takes: tuple[str, ...]  # names of all arguments
    wants: tuple[str, ...]  # names of the required ones
    needs_series: bool = True
    of_pair: bool = False  # True if it measures two runs together
    # part of a run that settles the number: "to" (the argument ``to`` or ``at``, else the end), "end", or "known": a
    # number that exists does not change
    until: str = "to"
    grows: bool = False  # True if the number can only increase as a run continues
    of_stopped: bool = False  # True if it exists for stopped runs only, and others are left open
    of_problem: bool = False  # True if it is equal for all runs of a problem
    of_end: bool = False  # True if it is about where a run ends, so that stopped runs have it, too
    natural: Natural = "zero"  # limit from which bands are moved; "firm": a count or an end reached, never moved
    reads: tuple[str, ...] = ()  # series used besides those named by the arguments


MEASURES: dict[str, Measure] = {}


def enter_measure(
    name: str,
    of: Callable[..., Any],
    wants: str = "",
    takes: str = "",
    *,
    series: bool = True,
    pair: bool = False,
    until: str = "to",
    grows: bool = False,
    of_stopped: bool = False,
    of_problem: bool = False,
    of_end: bool = False,
    natural: Natural = "zero",
    reads: str = "",
) -> None:
    """Enter the function ``of`` in the catalogue of measures, under ``name``.

    ``wants`` and ``takes`` list, separated by blanks, the arguments that a test must give and may give; the other
    parameters are the fields of ``Measure``, ``series`` and ``pair`` those of ``needs_series`` and ``of_pair``.
    """
    needed = tuple(wants.split())
    taken = (*needed, *takes.split())
    kind = (series, pair, until, grows, of_stopped, of_problem, of_end, natural, tuple(reads.split()))
    MEASURES[name] = Measure(of, taken, needed, *kind)


def series_read(name: str, arguments: Mapping[str, Any]) -> set[str]:
    """Return the names of the series of a run that the measure ``name`` reads at every step, besides the times."""
    if not MEASURES[name].needs_series:
        return set()
    named = [arguments[k] for k in ("series", "low") if k in arguments]
    out = {*MEASURES[name].reads, *(s for one in named for s in ([one] if isinstance(one, str) else one))}
    return out | {f"{kind}_{arguments['of']}" for kind in ("obs", "ref") if "of" in arguments}


def measure(wants: str = "", takes: str = "", **kind: Any) -> Callable[..., Any]:
    """Return a decorator that enters a function in the catalogue under its name, with spaces for underscores.

    The arguments are those of ``enter_measure``.
    """

    def enter(function: Callable[..., float]) -> Callable[..., float]:
        """Enter ``function`` in the catalogue, and return it unchanged."""
        enter_measure(function.__name__.replace("_", " "), function, wants, takes, **kind)
        return function

    return enter


def evaluate(name: str, record: RunRecord, series: Series | None, arguments: Mapping[str, Any]) -> float:
    """Return the number that measure ``name`` gives for a run, in the measure's unit; NaN if the run has none."""
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
    """Return the number that measure ``name`` gives for two runs, each a record with its series.

    NaN if one has no series or stopped before ``to`` (by default its end).
    """
    asked = (min(record.t_end_s, arguments.get("to") or record.t_end_s) for record, _ in (one, other))
    reached = all(r.t_reached_s >= t * (1.0 - END) for (r, _), t in zip((one, other), asked, strict=True))
    if one[1] is None or other[1] is None or not reached:
        return NAN
    with np.errstate(all="ignore"):
        return float(MEASURES[name].of(one[1], other[1], **arguments))


def reached_end(record: RunRecord) -> bool:
    """Return whether the last accepted step ends at the requested time."""
    return record.t_reached_s >= record.t_end_s * (1.0 - END)  # False for NaN


def measure_over(
    part: Callable[..., np.ndarray | None], wants: str, functions: Mapping[str, Callable[..., Any]], **kind: Any
) -> None:
    """Enter measures that apply each of ``functions``, by name, to the values that ``part`` takes from an interval.

    Such a measure is NaN if there are no such values. ``wants`` and ``kind`` are as in ``enter_measure``.
    """

    def of_part(function: Callable[..., Any], record: RunRecord, s: Series, **arguments: Any) -> float:
        """Return the function of the values in the interval; NaN if there are none."""
        a = part(record, s, **arguments)
        return NAN if a is None else float(function(a))

    for name, function in functions.items():
        enter_measure(name, partial(of_part, function), wants, "from to partial", **kind)


def cut_interval(
    record: RunRecord, s: Series, series: str, begin: float = 0.0, to: float = NAN, partial: bool = False
) -> np.ndarray | None:
    """Return the values of a series from ``begin`` to ``to`` [s]; None if it is missing or ends before ``to``.

    With ``partial`` a run that ends before ``to`` gives the values that exist. Errors are cut to where a reference
    exists.
    """
    a, t = s.get(series), s["t"]
    end = record.t_end_s if math.isnan(to) else to
    if a is None or (not partial and t[-1] < end * (1.0 - END)):
        return None
    inside = a[(t >= begin) & (t <= end * (1.0 + END))]
    if series in COMPARED:
        inside = inside[~np.isnan(inside)]
    return inside if len(inside) else None


def bound(a: np.ndarray, found: Any) -> float:
    """Return ``found``, a number derived from ``a``; infinite if any value of ``a`` is NaN.

    A motion that became NaN has no small error.
    """
    return math.inf if np.any(np.isnan(a)) else float(found)
