"""Find the periods of a motion from its most regular observable."""

import math

import numpy as np
from jaxtyping import Float

# "Half" and "twice": tried on a spherical and a simple pendulum, a top and a free body, of 107, 84, 162 and 85 periods.
# fewest periods, plus one, of a motion that counts as periodic. Half finds half as many of the simple pendulum, by
# another observable; twice finds twice as many of the free body, and none of the simple pendulum.
PERIODS = 50
# share of an observable's range, about its middle, that a crossing must traverse. Half finds two periods in each of the
# free body's; twice changes none.
BAND = 0.1
# standard deviation of the periods over their mean, above which a motion is not periodic; half, twice: none changes
UNEVEN = 0.2


def find_periods(
    t: Float[np.ndarray, " nt"], observables: dict[str, Float[np.ndarray, " nt"]]
) -> Float[np.ndarray, " n"]:
    """Return the times [s] at which the most regular observable rises through its middle: where its periods begin.

    ``observables`` are series by name. Empty if none is periodic with at least ``PERIODS`` periods.
    """
    moving = [a for _, a in sorted(observables.items()) if np.all(np.isfinite(a)) and np.ptp(a) > 0.0]
    found = [(_measure_variation(np.diff(marks)), marks) for a in moving if len(marks := _find_rises(t, a)) > PERIODS]
    uneven, best = min(found, key=lambda item: item[0], default=(math.inf, np.zeros(0)))
    return best if uneven <= UNEVEN else np.zeros(0)


def _measure_variation(periods: np.ndarray) -> float:
    """Return the standard deviation of periods over their mean; importing scipy.stats would take half a second."""
    return float(np.std(periods) / np.mean(periods))


def _find_rises(t: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Return the times [s] at which a series ``a`` rises through the middle of its range.

    A rise counts if it crosses a band about the middle, ``BAND`` of the range wide, so that small oscillations about
    the middle do not count as periods. The range is that from the 2nd to the 98th percentile.
    """
    low, high = np.quantile(a, (0.02, 0.98))
    middle, half = 0.5 * (low + high), 0.5 * BAND * (high - low)
    side = np.where(a > middle + half, 1, np.where(a < middle - half, -1, 0))
    seen = np.flatnonzero(side)
    ups = np.flatnonzero((side[seen[:-1]] == -1) & (side[seen[1:]] == 1))
    marks = []
    for begin, end in zip(seen[ups], seen[ups + 1], strict=True):
        k = begin + int(np.argmax(a[begin : end + 1] >= middle))  # the first at or above the middle
        share = (middle - a[k - 1]) / (a[k] - a[k - 1])
        marks.append(t[k - 1] + share * (t[k] - t[k - 1]))
    return np.array(marks)
