"""Anderson's acceleration of the sweeps of a step (compiled): Walker and Ni 2011, SIAM J. Numer. Anal. 49.

The next unknowns are the combination of the sweeps so far, with weights of sum 1, whose changes cancel best. This needs
no Jacobian and leaves the equations of a step as they are. An orthonormal basis of the differences of changes is kept
and, for each of its columns, the difference of the unknowns after a sweep along it.
"""

from typing import Any

import numpy as np

from ..compiled.algebra import clear, copy
from ..compiled.entries import compile_inline

MEMORY = 12  # sweeps combined: with half of them it takes 1 in 9 more on the pendulum, with twice no less
DEPENDENT = 1e-8  # share of a change of changes outside the span of others below which it is rounding


@compile_inline
def accelerate(s: Any, h: float, known: int) -> int:
    """Replace ``unknowns`` after a sweep by Anderson's combination of the sweeps so far, in the bundle ``s``.

    Return the number of columns of ``basis`` found in this step. ``known`` is that number before the call, -1 before
    the first accelerated sweep; beyond ``MEMORY`` a new column replaces the oldest. ``h`` [s] is the step.
    """
    n, k = len(s.unknowns), len(s.weights)
    if known < 0:
        _set_weights(s, h)
    for a in range(k):
        s.change[a] = s.weights[a] * (s.unknowns[a] - s.entered[a])
    if known < 0:
        known = 0
    else:
        place, kept = known % MEMORY, min(known, MEMORY)
        new, image = s.basis[place], s.images[place]
        for a in range(k):
            new[a] = s.change[a] - s.change_before[a]
        for a in range(n):
            image[a] = s.unknowns[a] - s.left[a]
        before = _dot_columns(new, new)
        for j in range(kept):
            if j != place:
                _remove_component(s, j, new, image)
        after = _dot_columns(new, new)
        if after > DEPENDENT * DEPENDENT * before:
            scale = 1.0 / np.sqrt(after)
            for a in range(k):
                new[a] *= scale
            for a in range(n):
                image[a] *= scale
            known += 1
        elif known >= MEMORY:
            clear(new)
            clear(image)
    copy(s.change, s.change_before)
    copy(s.unknowns, s.left)
    for j in range(min(known, MEMORY)):
        _remove_component(s, j, s.change, s.unknowns)
    return known


@compile_inline
def _set_weights(s: Any, h: float) -> None:
    """Set the ``weights`` of the changes of all unknowns: h / (1 + |q|) for rates of q, else h / (largest momentum)."""
    n, moment = len(s.start[0]), 0.0
    for k in range(n):
        moment = max(moment, abs(s.start[1, k]))
        for i in range(len(s.b)):
            moment = max(moment, h * abs(s.F[i, 1, k]))
    for a in range(len(s.weights)):
        k, is_rate = a % n, a < 2 * n * len(s.b) and (a // n) % 2 == 0
        s.weights[a] = h / (1.0 + abs(s.start[0, k])) if is_rate else (h / moment if moment > 0.0 else 0.0)


@compile_inline
def _remove_component(s: Any, j: int, change: Any, unknowns: Any) -> None:
    """Subtract from ``change`` its component along column j of ``basis``, and its counterpart from ``unknowns``."""
    q, u = s.basis[j], s.images[j]
    along = _dot_columns(q, change)
    for a in range(len(change)):
        change[a] -= along * q[a]
    for a in range(len(unknowns)):
        unknowns[a] -= along * u[a]


@compile_inline
def _dot_columns(x: Any, y: Any) -> float:
    """Return the scalar product of x and y, by four independent sums, which a processor adds in parallel."""
    n = len(x) - len(x) % 4
    p = q = r = t = 0.0
    for a in range(0, n, 4):
        p += x[a] * y[a]
        q += x[a + 1] * y[a + 1]
        r += x[a + 2] * y[a + 2]
        t += x[a + 3] * y[a + 3]
    for a in range(n, len(x)):
        p += x[a] * y[a]
    return (p + q) + (r + t)
