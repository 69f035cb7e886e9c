"""Envelopes: the least and the largest value of a series in each of equal spans of time.

Values less a base are kept as the upper bits of float32, rounded outwards: every value lies within, and the envelope is
wider by 1/1024 of the distance from the base at most. The base is 0, or the middle of values that lie close together,
of which a drawing shows the differences.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

SPANS = 720  # a multiple of the 240, 180, 80 and 60 spans that curves have; 1/720 of a picture's width is a pixel
FEW = SPANS // 2  # rows that take no more room than the envelope of as many spans
LEFT_OUT = 13  # of the 23 bits of mantissa that float32 has
SIZE = np.int32(0x7FFFFFFF)  # all bits but the sign


@dataclass(frozen=True)
class Envelope:
    """Codes of the least and the largest value in spans of [begin, end]; of NaN where a span has no finite value."""

    begin: float  # [s]
    end: float  # [s]
    codes: Int[np.ndarray, "2 spans"]
    base: float = 0.0

    @property
    def low(self) -> Float[np.ndarray, " spans"]:
        """No value of a span is below."""
        return self.base + _decode(self.codes[0])

    @property
    def high(self) -> Float[np.ndarray, " spans"]:
        """No value of a span is above."""
        return self.base + _decode(self.codes[1])

    @property
    def points(self) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Times and values to draw: both of each span, at a time within it."""
        t = np.linspace(self.begin, self.end, self.codes.shape[1])
        return np.repeat(t, 2), np.stack((self.low, self.high), axis=1).ravel()


def envelope_of(t: Float[np.ndarray, " nt"], a: Float[np.ndarray, " nt"], spans: int = SPANS) -> Envelope:
    """The envelope of all finite values; ``t`` ascends."""
    begin, end = float(t[0]), float(t[-1])
    low, high = np.full(spans, np.nan), np.full(spans, np.nan)
    good, base = np.flatnonzero(np.isfinite(a)), 0.0
    if len(good):
        k = span_of(t[good], begin, end, spans)
        first = np.flatnonzero(np.diff(k, prepend=-1))  # rows of a span follow each other
        low[k[first]], high[k[first]] = np.minimum.reduceat(a[good], first), np.maximum.reduceat(a[good], first)
        base = _find_base(float(np.nanmin(low)), float(np.nanmax(high)))
    return Envelope(begin, end, np.stack((_encode(low - base, up=False), _encode(high - base, up=True))), base)


def span_of(t: Float[np.ndarray, " n"], begin: float, end: float, spans: int) -> Int[np.ndarray, " n"]:
    """The span in which each time lies."""
    whole = max(end - begin, 1e-300)
    return np.minimum((spans * ((t - begin) / whole)).astype(np.int64), spans - 1)


def _find_base(least: float, largest: float) -> float:
    """The middle where all values are within half of it, so that differences from it are exact; else 0."""
    middle = 0.5 * least + 0.5 * largest
    return middle if largest - least < abs(middle) else 0.0


def _encode(a: np.ndarray, *, up: bool) -> Int[np.ndarray, " n"]:
    """Codes in the order of the numbers, rounded up or down."""
    with np.errstate(over="ignore", under="ignore"):
        near = a.astype(np.float32)
        beyond = np.where(np.isnan(a), False, near.astype(float) < a if up else near.astype(float) > a)
        near = np.where(beyond, np.nextafter(near, np.float32(np.inf if up else -np.inf)), near)
    bits = near.view(np.int32)
    ordered = np.where(bits < 0, -(bits & SIZE), bits)  # floats ascend as their bits do, negative ones turned round
    return np.asarray(-(-ordered >> LEFT_OUT) if up else ordered >> LEFT_OUT, dtype=np.int32)


def _decode(codes: Int[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    ordered = codes.astype(np.int32) << LEFT_OUT
    size = np.abs(ordered).view(np.float32).astype(float)
    return np.where(ordered < 0, -size, size)
