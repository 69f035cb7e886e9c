"""Decide when a measured number lies in its band, and combine several numbers into the judged one."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

NAN = math.nan
FACTOR = 1.5  # factor by which a band is moved to see whether the verdict depends on it


@dataclass(frozen=True)
class Band:
    """A closed interval with possibly infinite ends; a number that does not exist lies in no band."""

    low: float
    high: float

    def holds(self, value: float) -> bool:
        """Return whether the value lies in the band; False for NaN."""
        return self.low <= value <= self.high

    def move(self, factor: float, *, is_ratio: bool = False, end: float = math.inf) -> "Band":
        """Return the band widened by ``factor``, or narrowed if it is below 1; an infinite end stays.

        A single limit moves by its distance from the natural one, which is fixed: 0, 1 for a ratio, or the ``end`` of
        the time if that is nearer. Two limits move away from their middle, in logarithms if both are above zero.
        """
        if math.isinf(self.low) or math.isinf(self.high):
            return Band(
                _move_limit(self.low, 1.0 / factor, is_ratio, end), _move_limit(self.high, factor, is_ratio, end)
            )
        if self.low > 0.0:
            middle, half = math.sqrt(self.low * self.high), math.sqrt(self.high / self.low) ** factor
            return Band(middle / half, middle * half)
        middle, half = 0.5 * (self.low + self.high), 0.5 * (self.high - self.low) * factor
        return Band(middle - half, middle + half)

    def measure_excess(self, value: float) -> float:
        """Return how far the value lies outside the band; infinite for NaN.

        Inside the band it is negative: the distance to the nearer end.
        """
        return math.inf if math.isnan(value) else max(self.low - value, value - self.high)


def _move_limit(limit: float, factor: float, is_ratio: bool, end: float) -> float:
    """Return a limit of a band with its distance from the natural limit multiplied by ``factor``.

    Below the natural limit the distance is divided instead, so that the limit rises with ``factor`` in both cases. A
    ratio below 1 is moved by its inverse. For ``is_ratio`` and ``end`` see ``Band.move``.
    """
    if is_ratio and 0.0 < limit < 1.0:
        return 1.0 / _move_limit(1.0 / limit, 1.0 / factor, is_ratio, end)
    natural = 1.0 if is_ratio else end if abs(end - limit) < abs(limit) < math.inf else 0.0
    return natural + (limit - natural) * (factor if limit > natural else 1.0 / factor)


def _divide(above: float, below: float) -> float:
    """Return above/below; 1 if both are equal, even 0, and infinite if only ``below`` is 0.

    NaN if one is NaN or both are infinite, since then both runs failed.
    """
    if math.isnan(above) or math.isnan(below) or (math.isinf(above) and math.isinf(below)):
        return NAN
    if above == below:
        return 1.0
    return math.inf if below == 0.0 else above / below


def _find_largest_ratio(values: Sequence[float]) -> float:
    """Return the largest ratio of a value to the one before it: below 1, the values fall at each step.

    A pair without a ratio, such as two failed runs, could only increase the result, which is then NaN unless the other
    ratios reach 1 already.
    """
    ratios = [_divide(b, a) for a, b in pairwise(values)]
    known = [r for r in ratios if not math.isnan(r)]
    worst = max(known, default=NAN)
    return worst if len(known) == len(ratios) or worst >= 1.0 else NAN


def _apply_to_all(function: Callable[[Sequence[float]], float], values: Sequence[float]) -> float:
    """Return ``function`` of the values; NaN if there are none or one is NaN: no run without a number is ignored."""
    return NAN if not values or any(math.isnan(v) for v in values) else float(function(values))


NEAREST = "nearest"  # combines runs, not values: the one value of the dimension that meets all tests best
SPREADS = ("spread", "relative spread")  # 0 where the dimension that the claim looks across does not act
RATIOS = ("last over first", "worst step")  # NaN if there is nothing to compare, which decides nothing

# values in the order of the dimension: the loosest tolerance first, others from the smallest
COMBINE: dict[str, Callable[[Sequence[float]], float]] = {
    "last over first": lambda v: _divide(v[-1], v[0]) if len(v) > 1 else NAN,
    "worst step": lambda v: _apply_to_all(_find_largest_ratio, v),
    "largest": lambda v: _apply_to_all(max, v),
    "smallest": lambda v: _apply_to_all(min, v),
    "spread": lambda v: _apply_to_all(lambda a: max(a) - min(a), v),
    "relative spread": lambda v: _apply_to_all(lambda a: _divide(max(a) - min(a), float(np.mean(np.abs(a)))), v),
}

BEST = "over best settings"  # any choice is admitted for the others, too: over the largest of each solver's least value
OVER = ("over largest", "over smallest", BEST)  # ratios

# compares a value with those of other runs; distances are measured pair by pair (``TriedRun.find_distance``)
COMPARE: dict[str, Callable[[float, Sequence[float]], float]] = {
    "over largest": lambda a, others: _divide(a, _apply_to_all(max, others)),
    "over smallest": lambda a, others: _divide(a, _apply_to_all(min, others)),
    BEST: lambda a, others: _divide(
        a, _apply_to_all(max, others)
    ),  # others: of each solver the least, see ``take_best``
    "minus largest": lambda a, others: a - _apply_to_all(max, others),
    "smallest distance": lambda a, others: _apply_to_all(min, others),
    "largest distance": lambda a, others: _apply_to_all(max, others),
}


def take_best(solvers: Sequence[str], values: Sequence[float]) -> list[float]:
    """Return the least of the values of each solver, NaN if one of them is; ``solvers`` names that of each value."""
    named = list(zip(solvers, values, strict=True))
    return [_apply_to_all(min, [v for s, v in named if s == solver]) for solver in dict.fromkeys(solvers)]
