"""When a measured number lies in its band, and how several numbers become the one that is judged."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

NAN = math.nan
FACTOR = 1.5  # by which a band is moved to see whether a verdict hangs on it


@dataclass(frozen=True)
class Band:
    """A closed interval; infinite where it is open. A number that does not exist lies in no band."""

    low: float
    high: float

    def holds(self, value: float) -> bool:
        return self.low <= value <= self.high  # False for NaN

    def move(self, factor: float, *, is_ratio: bool = False, end: float = math.inf) -> "Band":
        """Wider by ``factor``, or narrower by one below 1; an open end stays.

        A limit alone moves by its distance from the natural one, which does not move: 0, 1 of a ratio, or the ``end``
        of the time where that is nearer. One of two limits moves away from the middle, which is that of logarithms
        where both are above zero.
        """
        if math.isinf(self.low) or math.isinf(self.high):
            return Band(_raise(self.low, 1.0 / factor, is_ratio, end), _raise(self.high, factor, is_ratio, end))
        if self.low > 0.0:
            middle, half = math.sqrt(self.low * self.high), math.sqrt(self.high / self.low) ** factor
            return Band(middle / half, middle * half)
        middle, half = 0.5 * (self.low + self.high), 0.5 * (self.high - self.low) * factor
        return Band(middle - half, middle + half)

    def beyond(self, value: float) -> float:
        """How far outside, or (negative) how near to the end of the band; endless for no number."""
        return math.inf if math.isnan(value) else max(self.low - value, value - self.high)


def _raise(limit: float, factor: float, is_ratio: bool, end: float) -> float:
    """The limit, higher by ``factor`` in its distance from the natural one; a ratio below 1 by its inverse."""
    if is_ratio and 0.0 < limit < 1.0:
        return 1.0 / _raise(1.0 / limit, 1.0 / factor, is_ratio, end)
    natural = 1.0 if is_ratio else end if abs(end - limit) < abs(limit) < math.inf else 0.0
    return natural + (limit - natural) * (factor if limit > natural else 1.0 / factor)


def _ratio(above: float, below: float) -> float:
    """above/below; 1 for two that are equally good. Two that are unbounded cannot be compared: both runs failed."""
    if math.isnan(above) or math.isnan(below) or (math.isinf(above) and math.isinf(below)):
        return NAN
    if above == below:
        return 1.0
    if below == 0.0:
        return math.inf
    return above / below


def _worst_step(values: Sequence[float]) -> float:
    """Largest ratio of a value to the one before: below 1, each is smaller than the last.

    Two failures beside each other cannot be compared, and could only make it larger: where the others leave it below 1,
    nothing is known.
    """
    ratios = [_ratio(b, a) for a, b in pairwise(values)]
    known = [r for r in ratios if not math.isnan(r)]
    worst = max(known, default=NAN)
    return worst if len(known) == len(ratios) or worst >= 1.0 else NAN


def _of_all(function: Callable[[Sequence[float]], float]) -> Callable[[Sequence[float]], float]:
    """NaN as soon as one is: a run that has no such number must not be passed over."""

    def reduce_values(values: Sequence[float]) -> float:
        return NAN if not values or any(math.isnan(v) for v in values) else float(function(values))

    return reduce_values


NEAREST = "nearest"  # not of values but of runs: the one value of the dimension that meets all tests, or nearly so
RATIOS = ("last over first", "worst step")  # NaN where there is nothing to compare, which decides nothing

# values in order of the dimension: the loosest tolerance first, the smallest of any other first
COMBINE: dict[str, Callable[[Sequence[float]], float]] = {
    "last over first": lambda v: _ratio(v[-1], v[0]) if len(v) > 1 else NAN,
    "worst step": _of_all(_worst_step),
    "largest": _of_all(max),
    "smallest": _of_all(min),
    "spread": _of_all(lambda v: max(v) - min(v)),
    "relative spread": _of_all(lambda v: _ratio(max(v) - min(v), float(np.mean(np.abs(v))))),
}

# a value against those of other runs
COMPARE: dict[str, Callable[[float, Sequence[float]], float]] = {
    "over largest": lambda a, others: _ratio(a, _of_all(max)(others)),
    "over smallest": lambda a, others: _ratio(a, _of_all(min)(others)),
    "minus largest": lambda a, others: a - _of_all(max)(others),
    "smallest distance": lambda a, others: _of_all(min)(others),
    "largest distance": lambda a, others: _of_all(max)(others),  # distances are measured pair by pair: see evidence
}
