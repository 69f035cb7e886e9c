"""The iteration of a step until its corrections vanish (compiled)."""

import numpy as np

from ..compiled.entries import compile_inline

MOST_ITERATIONS = 60  # more help iterations that converge slowly, fewer end hopeless ones sooner
# ratio to the size before, above which S is factorised anew, of the present poses: less pays factors, more iterations
SLOW = 0.5
GO_ON, SETTLED, FAILED = range(3)


@compile_inline
def classify_iteration(size, last, tolerance):
    """Return the state of an iteration: GO_ON, SETTLED or FAILED.

    It is SETTLED when ``size``, of residual and correction, is within the tolerance and no longer falls below a tenth
    of ``last``; FAILED when ``size`` is not finite. Growth is no failure: errors in poses and velocities may turn into
    each other before both fall.
    """
    if not np.isfinite(size):
        return FAILED
    return SETTLED if size <= tolerance and (size == 0.0 or size > 0.1 * last) else GO_ON


@compile_inline
def iterate(s, sweep, tolerance):
    """Repeat ``size = sweep(s, i, slow)`` until it settles, fails or reaches ``MOST_ITERATIONS``.

    Return whether ``size`` is within the tolerance. ``sweep`` corrects the unknowns once and returns the size of
    residual and correction; ``slow`` says that the last sweep reduced ``size`` little, since the matrix is old.
    """
    last, slow = np.inf, False
    for i in range(MOST_ITERATIONS):
        size = sweep(s, i, slow)
        s.control.iterations += 1
        state = classify_iteration(size, last, tolerance)
        slow = size > SLOW * last
        last = size
        if state != GO_ON:
            break
    return state != FAILED and last <= tolerance
