"""The iteration of a method until its corrections vanish, in Python or, where it is marked so, in compiled steps."""

import math
from collections.abc import Callable
from typing import Any

GO_ON, STALE, SETTLED, FAILED = range(4)  # STALE: go on with a new factor


def iterate(
    s: Any,
    sweep: Callable[[Any, int, bool], float],
    classify: Callable[[Any, int, float, float], int],
    most: int,
) -> bool:
    """Repeat ``size = sweep(s, i, stale)`` until it settles or fails, at most ``most`` times.

    Return whether it settled. ``sweep`` corrects the unknowns of the step ``s`` once, counts itself, and returns the
    size of residual and correction, not finite where it cannot go on; ``i`` counts sweeps. ``classify(s, i, size,
    last)`` returns GO_ON, STALE, SETTLED or FAILED for that size and the one before; STALE makes ``stale`` of the next
    sweep true.
    """
    last, state = math.inf, GO_ON
    for i in range(most):
        size = sweep(s, i, state == STALE)
        state = classify(s, i, size, last)
        last = size
        if state >= SETTLED:
            break
    return state == SETTLED
