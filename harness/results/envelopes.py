"""Compute envelopes: the least and the largest value of a series in each of equal spans of time.

Values minus a base are kept as the upper bits of float32, rounded outwards: every value lies within, and the envelope
is wider by at most 1/1024 of the distance from the base. The base is 0 or, for values that are close together, their
middle, so that a drawing shows their differences.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

SPANS = 720  # a multiple of the 240, 180, 80 and 60 spans of curves; 1/720 of a picture's width is a pixel
FEW = SPANS // 2  # rows that need as much space as an envelope: shorter series are kept as they are
LEFT_OUT = 13  # dropped bits of the 23 bits of float32's mantissa
SIZE = np.int32(0x7FFFFFFF)  # all bits but the sign


@dataclass(frozen=True)
class Envelope:
    """Codes of the least and the largest value in equal spans of [begin, end]; NaN if a span has no finite value."""

    begin: float  # [s]
    end: float  # [s]
    codes: Int[np.ndarray, "2 spans"]
    base: float = 0.0

    @property
    def low(self) -> Float[np.ndarray, " spans"]:
        """The lower bound of each span."""
        return self.base + _decode(self.codes[0])

    @property
    def high(self) -> Float[np.ndarray, " spans"]:
        """The upper bound of each span."""
        return self.base + _decode(self.codes[1])

    @property
    def points(self) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """The times [s] and values to draw: the lower and the upper bound of each span, both at the same time."""
        t = np.linspace(self.begin, self.end, self.codes.shape[1])
        return np.repeat(t, 2), np.stack((self.low, self.high), axis=1).ravel()


def compute_envelope(t: Float[np.ndarray, " nt"], a: Float[np.ndarray, " nt"], spans: int = SPANS) -> Envelope:
    """Return the envelope of the finite values among ``a`` at ascending times ``t`` [s], over equal spans of time."""
    return compute_envelopes(t, {"": a}, spans)[""]


def compute_envelopes(
    t: Float[np.ndarray, " nt"], series: Mapping[str, Float[np.ndarray, " nt"]], spans: int = SPANS
) -> dict[str, Envelope]:
    """Return the envelope of each series, as ``compute_envelope`` does, by name.

    The spans of the times are found once, for all series that are finite throughout; NaN marks a span without values.
    """
    begin, end, out = float(t[0]), float(t[-1]), dict[str, Envelope]()
    every = _find_first_rows(t, begin, end, spans) if len(t) else None
    for name, a in series.items():
        low, high = np.full(spans, np.nan), np.full(spans, np.nan)
        finite, base = np.isfinite(a), 0.0
        whole = every is not None and bool(np.all(finite))
        good = a if whole else a[finite]
        if len(good):
            k, first = every if every is not None and whole else _find_first_rows(t[finite], begin, end, spans)
            low[k], high[k] = np.minimum.reduceat(good, first), np.maximum.reduceat(good, first)
            base = _find_base(float(np.nanmin(low)), float(np.nanmax(high)))
        codes = np.stack((_encode(low - base, up=False), _encode(high - base, up=True)))
        out[name] = Envelope(begin, end, codes, base)
    return out


def _find_first_rows(
    t: Float[np.ndarray, " n"], begin: float, end: float, spans: int
) -> tuple[Int[np.ndarray, " m"], Int[np.ndarray, " m"]]:
    """Return the indices of the spans that contain a time, and the first row of each.

    As times ascend, the rows of a span are consecutive.
    """
    k = find_spans(t, begin, end, spans)
    first = np.flatnonzero(np.diff(k, prepend=-1))
    return k[first], first


def find_spans(t: Float[np.ndarray, " n"], begin: float, end: float, spans: int) -> Int[np.ndarray, " n"]:
    """Return the index of the span in which each time lies, of equal ``spans`` between ``begin`` and ``end`` [s]."""
    whole = max(end - begin, 1e-300)
    return np.minimum((spans * ((t - begin) / whole)).astype(np.int64), spans - 1)


def _find_base(least: float, largest: float) -> float:
    """Return the base of an envelope's codes: the middle of values from ``least`` to ``largest``, or 0.

    The middle is taken if the range is less than its magnitude: differences from it are then exact.
    """
    middle = 0.5 * least + 0.5 * largest
    return middle if largest - least < abs(middle) else 0.0


def _encode(a: np.ndarray, *, up: bool) -> Int[np.ndarray, " n"]:
    """Return numbers as integer codes that sort alike: the upper bits of float32, rounded ``up`` or else down."""
    with np.errstate(over="ignore", under="ignore"):
        near = a.astype(np.float32)
        beyond = np.where(np.isnan(a), False, near.astype(float) < a if up else near.astype(float) > a)
        near = np.where(beyond, np.nextafter(near, np.float32(np.inf if up else -np.inf)), near)
    bits = near.view(np.int32)
    ordered = np.where(bits < 0, -(bits & SIZE), bits)  # floats are ordered as their bits, negative ones reversed
    return np.asarray(-(-ordered >> LEFT_OUT) if up else ordered >> LEFT_OUT, dtype=np.int32)


def _decode(codes: Int[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Return the numbers whose codes are ``codes``, to the accuracy of ``_encode``."""
    ordered = codes.astype(np.int32) << LEFT_OUT
    size = np.abs(ordered).view(np.float32).astype(float)
    return np.where(ordered < 0, -size, size)
