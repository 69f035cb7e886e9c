"""Keep the catalogue of measures: plain functions of one run's record and series, registered under their names.

Every measure is NaN if the run has no such number, above all if it ended before the time of the claim: a run that
stopped must not look accurate. ``partial = true`` in a test asks for the part that exists. A function with ``@measure``
adds one; its parameters after record and series are the arguments of a test, ``begin`` under the name ``from``.
"""

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, wraps
from typing import Any, Literal

import numpy as np

from ....results.records import RunRecord
from ....results.series import Series

NAN = math.nan
END = 1e-9  # relative, from t_reached to t_end: times are sums of steps, and a million roundings add up to 1e-10


@dataclass(frozen=True)
class Measure:
    """A function of (record, series, arguments), or of two runs' records and series, and what its number depends on.

    The fields determine which runs decide the number: for most measures, an early end leaves open what the rest of the
    run might have changed.
    """

    of: Callable[..., float]  # returns the number
    needs_series: bool = True
    of_pair: bool = False  # True if it measures two runs together
    # part of a run that settles the number: "to" (the argument ``to`` or ``at``, else the end), "end", or "known": a
    # number that exists does not change
    until: Literal["to", "end", "known"] = "to"
    grows: bool = False  # True if the number can only increase as a run continues
    of_stopped: bool = False  # True if it exists for stopped runs only, and others are left open
    of_problem: bool = False  # True if it is equal for all runs of a problem
    of_end: bool = False  # True if it is about where a run ends, so that stopped runs have it, too
    # limit from which bands are moved; "firm": a count or an end reached, never moved
    natural: Literal["zero", "one", "end", "firm"] = "zero"
    reads: tuple[str, ...] = ()  # series used besides those named by the arguments

    @cached_property
    def defaults(self) -> dict[str, Any]:
        """The arguments of a test by name, with their defaults; ``inspect.Parameter.empty`` for the required ones.

        They are the function's parameters after record and series, or after those of two runs.
        """
        own = list(inspect.signature(self.of).parameters.values())[4 if self.of_pair else 2 :]
        return {"from" if p.name == "begin" else p.name: p.default for p in own}

    @property
    def takes(self) -> tuple[str, ...]:
        """The names of all arguments."""
        return tuple(self.defaults)

    @property
    def wants(self) -> tuple[str, ...]:
        """The names of the required arguments."""
        return tuple(k for k, v in self.defaults.items() if v is inspect.Parameter.empty)


MEASURES: dict[str, Measure] = {}


def measure(**kind: Any) -> Callable[[Callable[..., float]], Callable[..., float]]:
    """Return a decorator that registers a function in ``MEASURES`` under its name, with spaces for underscores.

    ``kind`` are fields of ``Measure``.
    """

    def register_function(function: Callable[..., float]) -> Callable[..., float]:
        """Register ``function``, and return it unchanged."""
        MEASURES[function.__name__.replace("_", " ")] = Measure(function, **kind)
        return function

    return register_function


def measure_values(part: Callable[..., np.ndarray | None], **kind: Any) -> Callable[..., Any]:
    """Return a decorator that registers a function of an array as a measure of the array that ``part`` cuts from a run.

    ``part`` takes record, series and the arguments of a test, such as ``cut_interval``; the measure has its arguments,
    and is NaN where it returns None. ``kind`` are fields of ``Measure``.
    """

    def register_function(function: Callable[[np.ndarray], float]) -> Callable[[np.ndarray], float]:
        """Register ``function``, applied to the array that ``part`` returns, and return it unchanged."""

        @wraps(part)  # has the signature of ``part``
        def of_values(*run: Any, **arguments: Any) -> float:
            """Return ``function`` of the values that ``part`` returns; NaN if there are none."""
            a = part(*run, **arguments)
            return NAN if a is None else float(function(a))

        of_values.__doc__ = function.__doc__
        MEASURES[function.__name__.replace("_", " ")] = Measure(of_values, **kind)
        return function

    return register_function


def evaluate(name: str, record: RunRecord, series: Series | None, arguments: Mapping[str, Any], *other: Any) -> float:
    """Return the number that measure ``name`` gives for a run, in the measure's unit; NaN if the run has none.

    ``other`` are record and series of another run, for a measure of two.
    """
    m = MEASURES[name]
    if m.needs_series and (series is None or None in other):
        return NAN
    with np.errstate(all="ignore"):
        return float(m.of(record, series, *other, **{"begin" if k == "from" else k: v for k, v in arguments.items()}))


def list_series_read(name: str, arguments: Mapping[str, Any]) -> set[str]:
    """Return the names of the series of a run that the measure ``name`` reads at every step, besides the times.

    Some are fixed for the measure, others are named by the ``arguments`` of a test: ``series``, ``low``, and ``of``,
    an observable with its reference.
    """
    if not MEASURES[name].needs_series:
        return set()
    named = [arguments[k] for k in ("series", "low") if k in arguments]
    out = {*MEASURES[name].reads, *(s for one in named for s in ([one] if isinstance(one, str) else one))}
    return out | {f"{kind}_{arguments['of']}" for kind in ("obs", "ref") if "of" in arguments}


def reached_end(record: RunRecord) -> bool:
    """Return whether the last accepted step ends at the requested time."""
    return record.t_reached_s >= record.t_end_s * (1.0 - END)  # False for NaN
