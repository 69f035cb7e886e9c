"""What marches of fixed steps share: the clock, when an iteration has settled, moving poses, keeping a step (compiled).

``clock`` (3,) counts steps, iterations and factorisations. ``pace`` (3,) is that of reversible step control (Hairer and
Soederlind 2005, SIAM J. Sci. Comput. 26): z, the time reached [s], and 1 once it has started::

    h = dt / z,  z_(n+1/2) = z_(n-1/2) + dt G(y_n),  G = d/dt ln(1/s),  1/s = (1 + sum_b |Omega_b / rate|^4)^(1/4)

so that z follows 1/s, never less than 1, and the way back takes the same steps. G takes the accelerations at y_n.
"""

import numpy as np
from numba import njit

from ..vectors import turned_by
from .kernel import HOT
from .rkmk import keep

STUCK, TURNED, DONE = 4, 5, 6  # of a step, the first two of a march: no convergence, more than half a turn
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
def paced(pace, k, rate, clock, dt, t_end):
    """``times_of`` under reversible step control; ``k`` is at y_n with ``v_dot``, and fixed steps go by a rate of 0."""
    if rate == 0.0:
        return times_of(clock, dt, t_end)
    fourth, power = rate**4, 0.0
    for b in range(len(k.v)):
        w0, w1, w2 = k.v[b, 3], k.v[b, 4], k.v[b, 5]
        square = w0 * w0 + w1 * w1 + w2 * w2
        power += square * (w0 * k.v_dot[b, 3] + w1 * k.v_dot[b, 4] + w2 * k.v_dot[b, 5])
        fourth += square * square
    G = power / fourth
    if pace[2] == 0.0:
        pace[2] = 1.0
        pace[0] = fourth**0.25 / rate + 0.5 * dt * G
    else:
        pace[0] += dt * G
    t0 = pace[1]
    if t0 >= t_end:
        return t_end, np.nan
    h = dt / max(pace[0], 0.1)
    # what is left below a hundredth of a step goes with the last one
    pace[1] = t_end if t0 + 1.01 * h >= t_end else t0 + h
    return t0, pace[1]


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
