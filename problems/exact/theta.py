"""Jacobi theta functions as short Fourier series: coefficients in balls, values in extended precision, errors proved.

With nome q and phase z = zeta - i eta (zeta real, eta fixed)::

    theta1(z) = -i sum (-1)^n q^((n+1/2)^2) e^(i(2n+1)z)     theta3(z) = sum        q^(n^2) e^(2inz)
    theta2(z) =    sum        q^((n+1/2)^2) e^(i(2n+1)z)     theta4(z) = sum (-1)^n q^(n^2) e^(2inz)

over all integers n. They are entire: motions written by them have no singular orientation, as angles have (Whittaker,
Analytical Dynamics, ch. VI; NIST DLMF ch. 20).

Proofs rest on IEEE arithmetic with 64 bits alone: no sine of a library is used. A phase rate t loses nothing for large
t, for rate is split into two parts of 11 bits, whose products with a float64 are exact, and a small rest.
"""

from dataclasses import dataclass

import numpy as np
from flint import acb, arb
from jaxtyping import Complex, Float

from .balls import TooWide, bound, extended_complex, in_balls, to_extended

UNIT = 2.0**-64  # relative rounding of one operation
PROVABLE = np.finfo(np.longdouble).nmant >= 63  # elsewhere than on x86 and some servers it is float64
CUT = 2.0**-80  # terms below this part of the largest are dropped, and counted as error
PARTS = 64  # of a turn in the table
SPLIT = 11  # bits
TAYLOR = 14  # (2 pi/128)^14/14! < 1e-29


@dataclass(frozen=True)
class Phase:
    """exp(i (z0 + rate t)) for real t, from z0 and rate in turns."""

    offset: np.longdouble
    high: np.longdouble  # of the rate [1/s], 11 bits
    middle: np.longdouble  # 11 more
    low: np.longdouble
    radius: float  # of offset [turns]
    rate_radius: float  # of the rate [1/s]

    @staticmethod
    def of(z0: arb, rate: arb) -> "Phase":
        """From both in radians."""
        turn = 2 * arb.pi()
        z0, rate = z0 / turn, rate / turn
        z0 = z0 - round(float(z0))
        high = _leading(float(rate))
        middle = _leading(float(rate - high))
        return Phase(
            to_extended(z0), np.longdouble(high), np.longdouble(middle), to_extended(rate - high - middle),
            bound(z0 - z0.mid()), bound(rate - rate.mid()),
        )  # fmt: skip

    def __call__(self, t: Float[np.ndarray, " nt"]) -> Complex[np.ndarray, " nt"]:
        """The values."""
        t = t.astype(np.longdouble)
        turns = sum(x - np.rint(x) for x in (self.high * t, self.middle * t)) + self.low * t + self.offset
        part = np.rint(PARTS * turns)
        x = TURN * (turns - part / PARTS)
        square = x * x
        sine, cosine = np.zeros_like(x), np.zeros_like(x)
        for n in range(TAYLOR, 0, -2):
            cosine = 1.0 - square * cosine / (n * (n - 1))
            sine = 1.0 - square * sine / (n * (n + 1))
        return TABLE[part.astype(int) % PARTS] * (cosine + 1j * (x * sine))

    def error(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Proved bound on the distance of the value: 7 for turns to radians; roundings of sums, table, product."""
        rest = abs(float(self.low)) * np.abs(t)
        return 7.0 * (self.radius + self.rate_radius * np.abs(t) + 5.0 * UNIT * (1.0 + rest)) + 8.0 * UNIT


@dataclass(frozen=True)
class ThetaSeries:
    """sum over m of c_m w^m + d_m conj(w)^m, w = exp(i zeta), m all odd or all even from ``least`` in steps of 2."""

    least: int
    c: Complex[np.ndarray, " terms"]
    d: Complex[np.ndarray, " terms"]
    tail: float  # bound on the dropped terms and on the radii of the coefficients

    def __call__(self, w: Complex[np.ndarray, " nt"]) -> Complex[np.ndarray, " nt"]:
        """The value."""
        square = w * w
        return self._sum(self.c, w, square) + self._sum(self.d, w.conj(), square.conj())

    def slope(self, w: Complex[np.ndarray, " nt"]) -> Complex[np.ndarray, " nt"]:
        """The derivative with respect to zeta, in the precision of ``w``."""
        m = 1j * (self.least + 2 * np.arange(len(self.c)))
        c, d = ((m * x).astype(w.dtype) for x in (self.c, self.d))
        square = w * w
        return self._sum(c, w, square) - self._sum(d, w.conj(), square.conj())

    def error(self, phase: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Proved bound on the error of the value, from that of w: the slopes, 6 roundings a step of Horner's."""
        sizes = (np.abs(self.c) + np.abs(self.d)).astype(float)
        m = self.least + 2.0 * np.arange(len(sizes))
        return 1.2 * np.sum(m * sizes) * phase + 6.0 * UNIT * (len(m) + 4) * np.sum(sizes) + self.tail

    def _sum(self, c: np.ndarray, w: np.ndarray, square: np.ndarray) -> np.ndarray:
        value = np.zeros_like(w)
        for x in c[::-1]:
            value = value * square + x
        return value * w if self.least else value


def theta(kind: int, q: arb, eta: arb, scale: acb) -> ThetaSeries:
    """``scale`` theta_kind(zeta - i eta) as a series in zeta."""
    odd = int(kind in (1, 2))
    c: list[acb] = []
    d: list[acb] = []
    radius, largest, n = 0.0, 0.0, 0
    grown = eta.exp()
    while True:
        m = 2 * n + odd
        weight = scale * (q.log() * m * m / 4).exp() * (-1 if kind in (1, 4) and n % 2 else 1)
        up, down = weight * grown**m, weight / grown**m  # of e^(imz) and e^(-imz)
        if kind == 1:
            up, down = up * acb(0, -1), down * acb(0, 1)
        if m == 0:
            down = acb(0)
        size = bound(abs(up)) + bound(abs(down))
        if not size < np.inf:
            raise TooWide
        largest = max(largest, size)
        if n > 1 and size <= CUT * largest:
            ratio = bound((q.log() * (m + 1)).exp() * (grown**2 + grown**-2))  # of the next term to this one
            if ratio < 0.5:
                return ThetaSeries(odd, _freeze_terms(c), _freeze_terms(d), 2.0 * size + radius)
        c.append(up)
        d.append(down)
        radius += sum(bound(x.real - x.real.mid()) + bound(x.imag - x.imag.mid()) for x in (up, down))
        n += 1


def constant(value: acb) -> ThetaSeries:
    """A series of one term, the same for all phases."""
    radius = bound(value.real - value.real.mid()) + bound(value.imag - value.imag.mid())
    return ThetaSeries(0, _freeze_terms([value]), _freeze_terms([acb(0)]), radius)


def thetas(z: acb, tau: acb, derivative: int = 0) -> tuple[acb, ...]:
    """theta1 to theta4 at ``z``, or their first derivatives."""
    values = (z / arb.pi()).modular_theta(tau, derivative)
    return tuple(x / arb.pi() ** derivative for x in values)


def elliptic_argument(sn: arb, cn: arb, m: arb) -> arb:
    """The x with these sn and cn, |x| <= 2 K, from the smaller of both: no ball reaches a branch point."""
    K = acb(m).elliptic_k().real
    x = -1 if float(sn) < 0.0 else 1
    if abs(float(sn)) <= abs(float(cn)):
        x0 = acb.elliptic_f(arb.atan2(sn, cn if float(cn) > 0.0 else -cn), m).real
        return x0 if float(cn) > 0.0 else x * 2 * K - x0
    return x * (K - acb.elliptic_f(arb.atan2(cn, (1 - m).sqrt() * x * sn), m).real)  # sn (K - x) = cn x/dn x


def _leading(x: float) -> float:
    """``x`` rounded to ``SPLIT`` bits."""
    fraction, exponent = np.frexp(x)
    return float(np.ldexp(np.rint(np.ldexp(fraction, SPLIT)), exponent - SPLIT))


def _freeze_terms(values: list[acb]) -> Complex[np.ndarray, " terms"]:
    a = np.array([extended_complex(x) for x in values])
    a.flags.writeable = False
    return a


@in_balls
def _table() -> tuple[np.longdouble, Complex[np.ndarray, " parts"]]:
    angles = [2 * arb.pi() * k / PARTS for k in range(PARTS)]
    return to_extended(2 * arb.pi()), _freeze_terms([acb(x.cos(), x.sin()) for x in angles])


TURN, TABLE = _table()
