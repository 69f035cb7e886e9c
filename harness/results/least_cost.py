"""Find what an error costs at least, and how a cost grows: for verdicts, pages, the ladder and ``advise``."""

import math
from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np

from .records import RunRecord
from .words import select_judged_error

EXACT = 1e-12  # fraction of the mechanism's size: smaller position errors are rounding
Run = TypeVar("Run")


def choose_error(records: Sequence[RunRecord]) -> tuple[str, str]:
    """Return name and unit of the error by which runs of one problem are compared, such as ``position_error``, ``m``.

    Where all positions are exact (a body that only turns), it is the orientation error, in rad.
    """
    length = max((r.length_scale_m for r in records if r.length_scale_m > 0.0), default=1.0)
    moved = any(select_judged_error(r, "position_error", "m") > EXACT * length for r in records)
    return ("position_error", "m") if moved else ("orientation_error", "rad")


def find_cheapest(
    runs: Iterable[Run], target: float, error: Callable[[Run], float], cost: Callable[[Run], Any]
) -> Run | None:
    """Return the run of least cost whose error is at most ``target``, the first of equals; None if there is none.

    ``error`` and ``cost`` are functions of a run; a run whose error is NaN does not count.
    """
    return min((r for r in runs if error(r) <= target), key=cost, default=None)


def find_least_cost(ladder: Sequence[tuple[float, float]], target: float) -> tuple[float, bool, int] | None:
    """Return the least cost for the error ``target``, whether that is an upper bound, and the index of its run.

    ``ladder`` holds pairs of error and cost, the coarsest first. Costs are interpolated log-log between a run that
    misses ``target`` and the next one if that reaches it; the cost of a run that reaches it is an upper bound. Return
    None if no run reaches it.
    """
    reached = find_cheapest(range(len(ladder)), target, lambda k: ladder[k][0], lambda k: ladder[k][1])
    out = [] if reached is None else [(ladder[reached][1], True, reached)]
    for k, ((ea, low), (eb, high)) in enumerate(pairwise(ladder), 1):
        if ea > target >= eb:
            fraction = math.log(ea / target) / math.log(ea / eb) if eb > 0.0 else 1.0
            out.append((min(high, low * (high / low) ** fraction), False, k))
    return min(out, key=lambda found: found[:2], default=None)


def fit_growth(sizes: Sequence[float], costs: Sequence[float]) -> tuple[float, float]:
    """Return exponent p and log(c) of the power law c size^p through ``costs`` > 0, by least squares of logarithms."""
    power, factor = np.polyfit(np.log(sizes), np.log(costs), 1)
    return float(power), float(factor)
