"""When the iteration of a step has settled (compiled)."""

import numpy as np

from ..compiled.entries import inner

MOST_ITERATIONS = 60
SLOW = 0.5  # of the size before: then S is factored anew, whose redundant rows are those of the poses at hand
GO_ON, SETTLED, FAILED = range(3)


@inner
def has_settled(size, last, tolerance):
    """Whether residual and correction are below the tolerance and fall no more, or are no longer finite.

    Growth is no failure: errors in poses and velocities may turn into each other before both fall.
    """
    if not np.isfinite(size):
        return FAILED
    return SETTLED if size <= tolerance and (size == 0.0 or size > 0.1 * last) else GO_ON
