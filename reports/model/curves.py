"""Series made small enough to draw, with every peak kept, and the limits of their axes."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

SPANS_UPPER = 240  # a panel is about 3 in wide: more spans than that are not seen
SPANS_SIGNED = 320
CAP = 1e4  # a motion that blew up is cut at so many times the problem's own scale, or others could not be seen
SELDOM = 0.05  # of a line may lie below the lower edge: all errors begin at zero
ROUNDING = 1e-17  # of that scale: what is below is drawn at the lower edge


@dataclass(frozen=True)
class Curve:
    """Points of a line; with ``low`` it is the upper edge of a band."""

    t: Float[np.ndarray, " n"]
    y: Float[np.ndarray, " n"]
    low: Float[np.ndarray, " n"] | None = None
    high: Float[np.ndarray, " n"] | None = None

    def __len__(self) -> int:
        return len(self.t)


def upper(t: Float[np.ndarray, " nt"], a: Float[np.ndarray, " nt"], t_end: float, spans: int = SPANS_UPPER) -> Curve:
    """The largest |a| in each span of time: what a bound must not be below. Values that are no numbers are left out."""
    t, a = _finite(t, np.abs(a))
    at = _rows_of(np.maximum, a, _spans(t, t_end, spans))
    return Curve(t[at], a[at])


def signed_curve(
    t: Float[np.ndarray, " nt"], a: Float[np.ndarray, " nt"], t_end: float, spans: int = SPANS_SIGNED
) -> Curve:
    """Smallest and largest value in each span, in their order of time, and the ends."""
    t, a = _finite(t, a)
    starts = _spans(t, t_end, spans)
    ends = [0, len(t) - 1] if len(t) else []
    at = np.unique(np.concatenate([ends, *(_rows_of(f, a, starts) for f in (np.minimum, np.maximum))])).astype(int)
    return Curve(t[at], a[at])


def band(t: Float[np.ndarray, " nt"], a: Float[np.ndarray, " nt"], t_end: float, spans: int = SPANS_UPPER) -> Curve:
    """Median, smallest and largest value in each span, at its end."""
    t, a = _finite(t, a)
    starts = _spans(t, t_end, spans)
    lengths = _lengths(starts, a)
    ordered = a[np.lexsort((a, np.repeat(np.arange(len(starts)), lengths)))]
    median = 0.5 * (ordered[starts + (lengths - 1) // 2] + ordered[starts + lengths // 2])
    last = starts + lengths - 1
    return Curve(t[last], median, ordered[starts], ordered[last])


def level(curve: Curve) -> Curve:
    """Without the points inside stretches where nothing changes: a constant step needs two points."""
    rows = [e for e in (curve.y, curve.low, curve.high) if e is not None]
    if len(curve) < 3:
        return curve
    same = np.all([(e[1:-1] == e[:-2]) & (e[1:-1] == e[2:]) for e in rows], axis=0)
    keep = np.flatnonzero(np.concatenate([[True], ~same, [True]]))
    edges = [None if e is None else e[keep] for e in (curve.low, curve.high)]
    return Curve(curve.t[keep], curve.y[keep], *edges)


def log_limits(curves: Iterable[Curve | None], scale: float) -> tuple[float, float]:
    """Limits for a logarithmic axis: from rounding (of ``scale``) at the lowest to a cap at the highest."""
    size = scale if np.isfinite(scale) and scale > 0.0 else 1.0
    floor = size * ROUNDING
    seen = [ends for c in curves if c is not None and (ends := reach(c, floor))]
    if not seen:
        return floor, floor * 1e3
    top = min(max(high for _, high in seen), size * CAP)
    return max(min(*(low for low, _ in seen), top) / 2.0, floor), top * 3.0


def reach(curve: Curve, floor: float) -> tuple[float, float] | None:
    """From where to where a line goes on a logarithmic axis, first errors left out; None if below ``floor``."""
    rows = [e[e > floor] for e in (curve.y, curve.low, curve.high) if e is not None]
    rows = [e for e in rows if len(e)]
    return (min(float(np.quantile(e, SELDOM)) for e in rows), max(float(e.max()) for e in rows)) if rows else None


def span(curve: Curve, limits: tuple[float, float]) -> tuple[float, float]:
    """From where to where a line goes inside of the limits of a linear axis."""
    low, high = np.clip((curve.y.min(), curve.y.max()), *limits)
    return float(low), float(high)


def _finite(t: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    n = min(len(t), len(a))
    with np.errstate(invalid="ignore"):
        good = np.isfinite(t[:n]) & np.isfinite(a[:n])
    return t[:n][good].astype(float), a[:n][good].astype(float)


def _spans(t: np.ndarray, t_end: float, n: int) -> Int[np.ndarray, " m"]:
    """The first row of each span: [0, t_end] in ``n`` equal ones, so that curves of one figure have the same spans."""
    whole = max(t_end if t_end > 0.0 else 0.0, *t[-1:], 1e-300)
    at = np.minimum((t / whole * n).astype(np.int64), n - 1)
    return np.flatnonzero(np.diff(at, prepend=at[:1] - 1))


def _lengths(starts: Int[np.ndarray, " m"], a: np.ndarray) -> Int[np.ndarray, " m"]:
    return np.diff(np.append(starts, len(a)))


def _rows_of(f: np.ufunc, a: np.ndarray, starts: Int[np.ndarray, " m"]) -> Int[np.ndarray, " m"]:
    """The first row of each span that has the largest or smallest value in it, as ``f`` is maximum or minimum."""
    lengths = _lengths(starts, a)
    rows = np.flatnonzero(a == np.repeat(f.reduceat(a, starts), lengths))
    _, first = np.unique(np.repeat(np.arange(len(starts)), lengths)[rows], return_index=True)
    return rows[first]
