"""The periods of a motion, by its most regular observable."""

import math

import numpy as np
from jaxtyping import Float
from scipy.stats import variation

PERIODS = 50  # fewer are no long run
BAND = 0.1  # of the range of an observable, about its middle: it must cross all of it to count as a crossing
UNEVEN = 0.2  # standard deviation of the periods over their mean: more is no period


def find_periods(
    t: Float[np.ndarray, " nt"], observables: dict[str, Float[np.ndarray, " nt"]]
) -> Float[np.ndarray, " n"]:
    """Times at which the most regular observable rises through its middle; none if no observable has enough periods."""
    moving = [a for _, a in sorted(observables.items()) if np.all(np.isfinite(a)) and np.ptp(a) > 0.0]
    found = [(variation(np.diff(marks)), marks) for a in moving if len(marks := _find_rises(t, a)) > PERIODS]
    uneven, best = min(found, key=lambda item: item[0], default=(math.inf, np.zeros(0)))
    return best if uneven <= UNEVEN else np.zeros(0)


def _find_rises(t: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Rises through the middle of the range, each between a visit to the lower and to the upper edge of a band."""
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
