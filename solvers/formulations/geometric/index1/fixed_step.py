"""What marches of fixed steps share: the clock, when an iteration has settled, moving poses, keeping a step (compiled).

``clock`` (3,) counts steps, iterations and factorisations.
"""

import numpy as np
from numba import njit

from ..vectors import turned_by
from .kernel import HOT
from .rkmk import keep

STUCK = 4  # outcome of a march: the iteration of a step does not converge
MOST_ITERATIONS = 60
GO_ON, SETTLED, FAILED = range(3)


@njit(**HOT)
def times_of(clock, dt, t_end):
    """Start and end [s] of the next step, the last one cut at ``t_end``; the end is NaN when there is none."""
    n = clock[0]
    if n >= int(np.ceil(t_end / dt - 1e-9)):
        return t_end, np.nan
    return n * dt, min((n + 1) * dt, t_end)


@njit(**HOT)
def settled(size, last, tolerance):
    """Of residual and correction: below the tolerance and falling no more, or no longer finite.

    Growth is no failure: errors in poses and velocities may turn into each other before both fall.
    """
    if not np.isfinite(size):
        return FAILED
    return SETTLED if size <= tolerance and (size == 0.0 or size > 0.1 * last) else GO_ON


@njit(**HOT)
def largest(a):
    """max |a|, NaN if any is."""
    size = 0.0
    for at in np.ndindex(a.shape):
        x = abs(a[at])
        if not x <= size:
            size = x
    return size


@njit(**HOT)
def move(r0, R0, dq, k):
    """Poses of ``k``: r0 + dq_t, R0 exp(dq_theta), dq (nb, 6)."""
    for b in range(len(dq)):
        for a in range(3):
            k.r[b, a] = r0[b, a] + dq[b, a]
        turned_by(R0[b], (dq[b, 3], dq[b, 4], dq[b, 5]), k.R[b])


@njit(**HOT)
def keep_step(k, lam, clock, t, record, n):
    """Row ``n`` of the record at ``t`` [s]; returns whether the velocities are finite."""
    if not np.isfinite(largest(k.v)):
        return False
    clock[0] += 1
    record.t[n] = t
    keep(k, lam, record, n)
    return True
