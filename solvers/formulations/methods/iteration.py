"""The iteration of a step, and when it has settled (compiled)."""

import numpy as np

from ..compiled.entries import inner, run
from ..compiled.marching import STUCK

MOST_ITERATIONS = 60
GO_ON, SETTLED, FAILED = range(3)


@inner
def settled(size, last, tolerance):
    """Of residual and correction: below the tolerance and falling no more, or no longer finite.

    Growth is no failure: errors in poses and velocities may turn into each other before both fall.
    """
    if not np.isfinite(size):
        return FAILED
    return SETTLED if size <= tolerance and (size == 0.0 or size > 0.1 * last) else GO_ON


@inner
def iterate(s, set_end, correct):
    """``set_end(s)`` sets the end of the step and its rows, ``correct(s)`` returns the size of what was off."""
    c, last, state = s.control, np.inf, GO_ON
    for i in range(MOST_ITERATIONS):
        set_end(s)
        if i == 0:
            run(s.kernel.factorise)
            c.factorisations += 1
        size = correct(s)
        c.iterations += 1
        state = settled(size, last, s.scheme.tolerance)
        last = size
        if state != GO_ON:
            break
    if state == FAILED or not last <= s.scheme.tolerance:
        c.status = STUCK
