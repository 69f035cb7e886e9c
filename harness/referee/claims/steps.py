"""Measures of how a solver steps, and of what happens as the motion passes its first lowest point."""

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ...results.records import RunRecord
from ...results.series import Series
from .measures import END, NAN, measure, measure_over, stretch

START_UP = 0.01  # of t_end: step sizes are judged after it


def _steps(
    record: RunRecord, s: Series, begin: float = NAN, to: float = NAN, partial: bool = False
) -> np.ndarray | None:
    t, dt = s["t"][:-1], s["dt"][:-1]
    begin = START_UP * record.t_end_s if math.isnan(begin) else begin
    end = record.t_end_s if math.isnan(to) else to
    if not partial and s["t"][-1] < end * (1.0 - END):
        return None
    inside = dt[(t > begin) & (t <= end) & (dt > 0.0)]
    return inside if len(inside) > 2 else None


# after the start-up, the last step left out
measure_over(_steps, "", {"step ratio": lambda dt: np.max(dt) / np.min(dt)}, grows=True, natural="one")
STEPS: Mapping[str, Callable[..., Any]] = {
    "irregularity": lambda dt: np.mean(np.abs(np.diff(np.log10(dt)))),  # from step to step: 0 for a fixed one
    "typical step": np.median,  # [s]
    "smallest step": np.min,  # [s]
}
measure_over(_steps, "", STEPS)


@measure("series low within", until="known")
def drop_at_lowest(record: RunRecord, s: Series, series: str, low: str, within: float) -> float:
    """Lowest of ``series`` within a time of the first minimum of ``low``, less its value before: a fall is negative."""
    a, turn, t = s.get(series), _first_minimum(s, low), s["t"]
    if a is None or turn is None or t[-1] < (t[turn] + within) * (1.0 - END):
        return NAN
    near = a[np.abs(t - t[turn]) <= within]
    return float(np.min(near) - near[0])


@measure("series low", "to")
def peak_after_lowest(record: RunRecord, s: Series, series: str, low: str, to: float = NAN) -> float:
    """|time of the largest |series| up to ``to`` - time of the first minimum of ``low``| [s]."""
    a, turn = stretch(record, s, series, to=to), _first_minimum(s, low)
    return NAN if a is None or turn is None else float(abs(s["t"][int(np.argmax(np.abs(a)))] - s["t"][turn]))


def _first_minimum(s: Series, low: str) -> int | None:
    h = s.get(low)
    if h is None:
        return None
    turns = np.flatnonzero((h[1:-1] < h[:-2]) & (h[1:-1] <= h[2:])) + 1
    return int(turns[0]) if len(turns) else None
