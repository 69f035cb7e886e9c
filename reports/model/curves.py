"""Reduce series to few points that keep every peak, and find the limits of their axes."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

SPANS_UPPER = 240  # a panel is about 3 in wide: more spans than that are not seen
SPANS_SIGNED = 320
CAP = 1e4  # cut of a diverging motion, in units of the problem's scale, so that other curves stay visible
SELDOM = 0.05  # fraction of a line below the lower edge: all errors begin at zero
ROUNDING = 1e-17  # fraction of that scale; smaller values are drawn at the lower edge


@dataclass(frozen=True)
class Curve:
    """The points of a line; with ``low`` and ``high`` the line is the median of a band between them."""

    t: Float[np.ndarray, " n"]  # [s]
    y: Float[np.ndarray, " n"]
    low: Float[np.ndarray, " n"] | None = None
    high: Float[np.ndarray, " n"] | None = None

    def __len__(self) -> int:
        return len(self.t)


def find_maxima(
    t: Float[np.ndarray, " nt"], a: Float[np.ndarray, " nt"], t_end: float, spans: int = SPANS_UPPER
) -> Curve:
    """Return the curve through the largest finite |a| in each of ``spans`` equal spans of [0, t_end] [s]."""
    t, a = _select_finite(t, np.abs(a))
    at = _find_extreme_rows(np.maximum, a, _find_span_starts(t, t_end, spans))
    return Curve(t[at], a[at])


def find_extrema(
    t: Float[np.ndarray, " nt"], a: Float[np.ndarray, " nt"], t_end: float, spans: int = SPANS_SIGNED
) -> Curve:
    """Return the curve of the least and largest value in each of ``spans`` spans of [0, t_end] [s] and of both ends."""
    t, a = _select_finite(t, a)
    starts = _find_span_starts(t, t_end, spans)
    ends = [0, len(t) - 1] if len(t) else []
    at = np.unique(
        np.concatenate([ends, *(_find_extreme_rows(f, a, starts) for f in (np.minimum, np.maximum))])
    ).astype(int)
    return Curve(t[at], a[at])


def find_band(
    t: Float[np.ndarray, " nt"], a: Float[np.ndarray, " nt"], t_end: float, spans: int = SPANS_UPPER
) -> Curve:
    """Return the median of each of ``spans`` spans of [0, t_end] [s], in a band from its least to its largest value.

    The time of each point is the last one of its span.
    """
    t, a = _select_finite(t, a)
    starts = _find_span_starts(t, t_end, spans)
    lengths = _count_points(starts, a)
    ordered = a[np.lexsort((a, np.repeat(np.arange(len(starts)), lengths)))]  # ascending within each span
    median = 0.5 * (ordered[starts + (lengths - 1) // 2] + ordered[starts + lengths // 2])
    last = starts + lengths - 1
    return Curve(t[last], median, ordered[starts], ordered[last])


def drop_repeated(curve: Curve) -> Curve:
    """Return the curve without points whose neighbours have the same values: a constant step needs two points."""
    rows = [e for e in (curve.y, curve.low, curve.high) if e is not None]
    if len(curve) < 3:
        return curve
    same = np.all([(e[1:-1] == e[:-2]) & (e[1:-1] == e[2:]) for e in rows], axis=0)
    keep = np.flatnonzero(np.concatenate([[True], ~same, [True]]))
    edges = [None if e is None else e[keep] for e in (curve.low, curve.high)]
    return Curve(curve.t[keep], curve.y[keep], *edges)


def find_log_limits(curves: Iterable[Curve | None], scale: float) -> tuple[float, float]:
    """Return the limits of a logarithmic axis for the curves, within ``ROUNDING`` and ``CAP`` times ``scale``.

    ``scale`` is the problem's; 1 is used if it is not positive. Without values above rounding the axis has three
    decades.
    """
    size = scale if np.isfinite(scale) and scale > 0.0 else 1.0
    floor = size * ROUNDING
    seen = [ends for c in curves if c is not None and (ends := find_log_range(c, floor))]
    if not seen:
        return floor, floor * 1e3
    top = min(max(high for _, high in seen), size * CAP)
    return max(min(*(low for low, _ in seen), top) / 2.0, floor), top * 3.0


def find_log_range(curve: Curve, floor: float) -> tuple[float, float] | None:
    """Return the range of a line on a logarithmic axis, from its values above ``floor``; None if there are none.

    The lower end leaves out the smallest twentieth of the values: all errors begin at zero.
    """
    rows = [e[e > floor] for e in (curve.y, curve.low, curve.high) if e is not None]
    rows = [e for e in rows if len(e)]
    return (min(float(np.quantile(e, SELDOM)) for e in rows), max(float(e.max()) for e in rows)) if rows else None


def find_range(curve: Curve, limits: tuple[float, float]) -> tuple[float, float]:
    """Return the lowest and highest value of a line on a linear axis, clipped to the axis's ``limits``."""
    low, high = np.clip((curve.y.min(), curve.y.max()), *limits)
    return float(low), float(high)


def _select_finite(t: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the points of which time and value are finite, as floats; the longer array is cut to the shorter."""
    n = min(len(t), len(a))
    with np.errstate(invalid="ignore"):
        good = np.isfinite(t[:n]) & np.isfinite(a[:n])
    return t[:n][good].astype(float), a[:n][good].astype(float)


def _find_span_starts(t: np.ndarray, t_end: float, n: int) -> Int[np.ndarray, " m"]:
    """Return the first row of each of ``n`` equal spans of [0, t_end] that has a point, for ascending times ``t``.

    The spans are the same for all curves of a figure; they extend to the last time if that is later than ``t_end``.
    """
    whole = max(t_end if t_end > 0.0 else 0.0, *t[-1:], 1e-300)
    span = np.minimum((t / whole * n).astype(np.int64), n - 1)  # of each point
    return np.flatnonzero(np.diff(span, prepend=span[:1] - 1))


def _count_points(starts: Int[np.ndarray, " m"], a: np.ndarray) -> Int[np.ndarray, " m"]:
    """Return the number of points in each span of ``a`` that begins at ``starts``."""
    return np.diff(np.append(starts, len(a)))


def _find_extreme_rows(f: np.ufunc, a: np.ndarray, starts: Int[np.ndarray, " m"]) -> Int[np.ndarray, " m"]:
    """Return the first row of each span with its largest or smallest value, for ``f`` np.maximum or np.minimum."""
    lengths = _count_points(starts, a)
    rows = np.flatnonzero(a == np.repeat(f.reduceat(a, starts), lengths))  # several in a span if a value repeats
    _, first = np.unique(np.repeat(np.arange(len(starts)), lengths)[rows], return_index=True)
    return rows[first]
