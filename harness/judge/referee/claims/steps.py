"""Measure a solver's steps, and the motion as it passes its first lowest point."""

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ....results.records import RunRecord
from ....results.series import Series
from .measures import END, NAN, cut_interval, measure, measure_over

START_UP = 0.01  # fraction of t_end after which step sizes are judged


def _steps(
    record: RunRecord, s: Series, begin: float = NAN, to: float = NAN, partial: bool = False
) -> np.ndarray | None:
    """Return the sizes [s] of the accepted steps between ``begin`` and ``to`` [s], without the run's last one.

    None if the run stopped before ``to``, unless ``partial``, or if fewer than three steps are left. By default they
    begin after the start-up.
    """
    t, dt = s["t"][:-1], s["dt"][:-1]
    begin = START_UP * record.t_end_s if math.isnan(begin) else begin
    end = record.t_end_s if math.isnan(to) else to
    if not partial and s["t"][-1] < end * (1.0 - END):
        return None
    inside = dt[(t > begin) & (t <= end) & (dt > 0.0)]
    return inside if len(inside) > 2 else None


# measured after the start-up, without the last step
measure_over(_steps, "", {"step ratio": lambda dt: np.max(dt) / np.min(dt)}, grows=True, natural="one")
STEPS: Mapping[str, Callable[..., Any]] = {
    "irregularity": lambda dt: np.mean(np.abs(np.diff(np.log10(dt)))),  # change from step to step: 0 for a fixed step
    "typical step": np.median,  # [s]
    "smallest step": np.min,  # [s]
}
measure_over(_steps, "", STEPS)


@measure("series low within", until="known")
def drop_at_lowest(record: RunRecord, s: Series, series: str, low: str, within: float) -> float:
    """Return the least value of ``series`` near the first minimum of series ``low``, minus its first value there.

    Near means within ``within`` [s]; the result is negative for a fall. NaN if the run does not get so far.
    """
    a, turn, t = s.get(series), _first_minimum(s, low), s["t"]
    if a is None or turn is None or t[-1] < (t[turn] + within) * (1.0 - END):
        return NAN
    near = a[np.abs(t - t[turn]) <= within]
    return float(np.min(near) - near[0])


@measure("series low", "to")
def peak_after_lowest(record: RunRecord, s: Series, series: str, low: str, to: float = NAN) -> float:
    """Return the time [s] between the maximum of |series| up to ``to`` [s] and the first minimum of series ``low``."""
    a, turn = cut_interval(record, s, series, to=to), _first_minimum(s, low)
    return NAN if a is None or turn is None else float(abs(s["t"][int(np.argmax(np.abs(a)))] - s["t"][turn]))


def _first_minimum(s: Series, low: str) -> int | None:
    """Return the row of the first local minimum of series ``low``; None if it has none."""
    h = s.get(low)
    if h is None:
        return None
    turns = np.flatnonzero((h[1:-1] < h[:-2]) & (h[1:-1] <= h[2:])) + 1
    return int(turns[0]) if len(turns) else None
