"""Series made small enough to draw, with every peak kept: largest value, or smallest and largest, per span of time."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

SPANS_UPPER = 240  # a panel is about 3 in wide: more spans than that are not seen
SPANS_SIGNED = 320


@dataclass(frozen=True)
class Curve:
    """Points of a line; with ``low`` it is the upper edge of a band."""

    t: Float[np.ndarray, " n"]
    y: Float[np.ndarray, " n"]
    low: Float[np.ndarray, " n"] | None = None
    high: Float[np.ndarray, " n"] | None = None

    def __len__(self) -> int:
        return len(self.t)


def upper(t: Float[np.ndarray, " nt"], a: Float[np.ndarray, " nt"], t_end: float) -> Curve:
    """The largest |a| in each span of time: what a bound must not be below. Values that are no numbers are left out."""
    t, a = _finite(t, np.abs(a))
    at = [k[np.argmax(a[k])] for k in _spans(t, t_end, SPANS_UPPER)]
    return Curve(t[at], a[at])


def signed(t: Float[np.ndarray, " nt"], a: Float[np.ndarray, " nt"], t_end: float) -> Curve:
    """First, smallest, largest and last value in each span, in their order of time."""
    t, a = _finite(t, a)
    at: list[int] = []
    for k in _spans(t, t_end, SPANS_SIGNED):
        at += sorted({int(k[0]), int(k[np.argmin(a[k])]), int(k[np.argmax(a[k])]), int(k[-1])})
    return Curve(t[at], a[at])


def band(t: Float[np.ndarray, " nt"], a: Float[np.ndarray, " nt"], t_end: float) -> Curve:
    """Median, smallest and largest value in each span."""
    t, a = _finite(t, a)
    spans = list(_spans(t, t_end, SPANS_UPPER))
    return Curve(
        np.array([t[k[-1]] for k in spans]),
        np.array([np.median(a[k]) for k in spans]),
        np.array([np.min(a[k]) for k in spans]),
        np.array([np.max(a[k]) for k in spans]),
    )


def _finite(t: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    n = min(len(t), len(a))
    with np.errstate(invalid="ignore"):
        good = np.isfinite(t[:n]) & np.isfinite(a[:n])
    return t[:n][good].astype(float), a[:n][good].astype(float)


def _spans(t: np.ndarray, t_end: float, n: int) -> Iterator[np.ndarray]:
    """Rows by span; all of [0, t_end] in ``n`` equal ones, so that curves of one figure have the same spans."""
    if len(t) == 0:
        return
    whole = max(t_end if t_end > 0.0 else 0.0, float(t[-1]), 1e-300)
    span = np.minimum((t / whole * n).astype(np.int64), n - 1)
    yield from np.split(np.arange(len(t)), np.flatnonzero(np.diff(span)) + 1)
