"""The stages of an explicit step (compiled), for all methods that have a pair's tableau."""

from typing import Any

from ..compiled.entries import compile_inline


@compile_inline
def evaluate_stages(s: Any, first: int, combine: Any, slope: Any) -> None:
    """Evaluate the slopes of the stages from ``first`` on, and leave the end of a step of ``control.h``.

    ``combine(s, weights, n, h)`` sets the state to the start of the step and h times the weighted sum of the first n
    slopes; ``slope(s, t, i)`` evaluates that of the state at t [s], and stores it as slope i.
    """
    c, n = s.control, len(s.b)
    for i in range(first, n):
        combine(s, s.a[i], i, c.h)
        slope(s, c.t + c.h * s.c[i], i)
    combine(s, s.b, n, c.h)
