"""Sum Jacobi theta functions as short Fourier series: ball coefficients, values in extended precision, proved errors.

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

from .balls import BallTooWide, bound_above, round_to_extended, run_in_balls, to_extended

UNIT = 2.0**-64  # relative rounding of one operation
PROVABLE = np.finfo(np.longdouble).nmant >= 63  # long double is float64 except on x86 and some servers
CUT = 2.0**-80  # terms below this fraction of the largest are dropped and counted as error
PARTS = 64  # parts of a turn in the table
SPLIT = 11  # bits of each leading part of a rate
TAYLOR = 14  # highest power; (2 pi/128)^14/14! < 1e-29


@dataclass(frozen=True)
class ThetaPhase:
    """The function exp(i (z0 + rate t)) of real t, with z0 and rate in turns."""

    offset: np.longdouble
    high: np.longdouble  # leading 11 bits of the rate [1/s]
    middle: np.longdouble  # the next 11 bits
    low: np.longdouble
    radius: float  # radius of the offset [turns]
    rate_radius: float  # radius of the rate [1/s]

    @staticmethod
    def from_radians(z0: arb, rate: arb) -> "ThetaPhase":
        """Return the function exp(i (z0 + rate t)) of ``z0`` [rad] and ``rate`` [rad/s], the rate split into parts."""
        turn = 2 * arb.pi()
        z0, rate = z0 / turn, rate / turn
        z0 = z0 - round(float(z0))
        high = _round_to_split(float(rate))
        middle = _round_to_split(float(rate - high))
        return ThetaPhase(
            to_extended(z0),
            np.longdouble(high),
            np.longdouble(middle),
            to_extended(rate - high - middle),
            bound_above(z0 - z0.mid()),
            bound_above(rate - rate.mid()),
        )

    def __call__(self, t: Float[np.ndarray, " nt"]) -> Complex[np.ndarray, " nt"]:
        """Return exp(i (z0 + rate t)) at ``t`` [s], in extended precision."""
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
        """Return a proved bound on the error of the value at ``t`` [s].

        The factor 7 > 2 pi converts turns to radians; the other terms are roundings of sums, table and product.
        """
        rest = abs(float(self.low)) * np.abs(t)
        return 7.0 * (self.radius + self.rate_radius * np.abs(t) + 5.0 * UNIT * (1.0 + rest)) + 8.0 * UNIT


@dataclass(frozen=True)
class ThetaSeries:
    """The sum over m of c_m w^m + d_m conj(w)^m, w = exp(i zeta), m from ``least`` (0 or 1) in steps of 2."""

    least: int
    c: Complex[np.ndarray, " terms"]
    d: Complex[np.ndarray, " terms"]
    tail: float  # bound on the dropped terms and on the radii of the coefficients

    def __call__(self, w: Complex[np.ndarray, " nt"]) -> Complex[np.ndarray, " nt"]:
        """Return the sum of the series at ``w``."""
        square = w * w
        return self._sum(self.c, w, square) + self._sum(self.d, w.conj(), square.conj())

    def slope(self, w: Complex[np.ndarray, " nt"]) -> Complex[np.ndarray, " nt"]:
        """Return the derivative of the sum with respect to zeta at w = exp(i zeta), in the precision of ``w``."""
        m = 1j * (self.least + 2 * np.arange(len(self.c)))
        c, d = ((m * x).astype(w.dtype) for x in (self.c, self.d))
        square = w * w
        return self._sum(c, w, square) - self._sum(d, w.conj(), square.conj())

    def error(self, phase: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Return a proved bound on the error of the sum; ``phase`` is a bound on the error of w.

        It adds up the slopes times that, 6 roundings per step of Horner's rule, and the dropped terms.
        """
        sizes = (np.abs(self.c) + np.abs(self.d)).astype(float)
        m = self.least + 2.0 * np.arange(len(sizes))
        return 1.2 * np.sum(m * sizes) * phase + 6.0 * UNIT * (len(m) + 4) * np.sum(sizes) + self.tail

    def _sum(self, c: np.ndarray, w: np.ndarray, square: np.ndarray) -> np.ndarray:
        """Return the sum over m of c_m w^m by Horner's rule; ``square`` is w^2."""
        value = np.zeros_like(w)
        for x in c[::-1]:
            value = value * square + x
        return value * w if self.least else value


def make_theta_series(kind: int, q: arb, eta: arb, scale: acb) -> ThetaSeries:
    """Return ``scale`` times theta_kind(zeta - i eta), of ``kind`` 1 to 4 and nome ``q``, as a series in zeta.

    Terms are added until they are below ``CUT`` of the largest and fall at least by half each; the bound ``tail``
    covers the rest and the radii of the coefficients. Raise BallTooWide if a coefficient has no bound.
    """
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
        size = bound_above(abs(up)) + bound_above(abs(down))
        if not size < np.inf:
            raise BallTooWide
        largest = max(largest, size)
        if n > 1 and size <= CUT * largest:
            ratio = bound_above((q.log() * (m + 1)).exp() * (grown**2 + grown**-2))  # of the next term to this one
            if ratio < 0.5:
                return ThetaSeries(odd, _freeze_terms(c), _freeze_terms(d), 2.0 * size + radius)
        c.append(up)
        d.append(down)
        radius += sum(bound_above(x.real - x.real.mid()) + bound_above(x.imag - x.imag.mid()) for x in (up, down))
        n += 1


def make_constant_series(value: acb) -> ThetaSeries:
    """Return a series of one term, constant in the phase."""
    radius = bound_above(value.real - value.real.mid()) + bound_above(value.imag - value.imag.mid())
    return ThetaSeries(0, _freeze_terms([value]), _freeze_terms([acb(0)]), radius)


def evaluate_thetas(z: acb, tau: acb, derivative: int = 0) -> tuple[acb, ...]:
    """Return theta1 to theta4 at ``z`` for the half-period ratio ``tau``; with ``derivative`` 1 their derivatives."""
    values = (z / arb.pi()).modular_theta(tau, derivative)
    return tuple(x / arb.pi() ** derivative for x in values)


def find_elliptic_argument(sn: arb, cn: arb, m: arb) -> arb:
    """Return the x with sn x = ``sn`` and cn x = ``cn``, parameter ``m``, |x| <= 2 K.

    It is computed from the smaller of the two, away from branch points.
    """
    K = acb(m).elliptic_k().real
    side = -1 if float(sn) < 0.0 else 1
    if abs(float(sn)) <= abs(float(cn)):
        x0 = acb.elliptic_f(arb.atan2(sn, cn if float(cn) > 0.0 else -cn), m).real
        return x0 if float(cn) > 0.0 else side * 2 * K - x0
    return side * (K - acb.elliptic_f(arb.atan2(cn, (1 - m).sqrt() * side * sn), m).real)  # sn (K - x) = cn x/dn x


def _round_to_split(x: float) -> float:
    """Return ``x`` rounded to ``SPLIT`` bits."""
    fraction, exponent = np.frexp(x)
    return float(np.ldexp(np.rint(np.ldexp(fraction, SPLIT)), exponent - SPLIT))


def _freeze_terms(values: list[acb]) -> Complex[np.ndarray, " terms"]:
    """Return the midpoints of balls as a read-only array."""
    a = np.array([round_to_extended(x) for x in values])
    a.flags.writeable = False
    return a


@run_in_balls
def _make_table() -> tuple[np.longdouble, Complex[np.ndarray, " parts"]]:
    """Return 2 pi, and exp(2 pi i k / ``PARTS``) for all k, in extended precision."""
    angles = [2 * arb.pi() * k / PARTS for k in range(PARTS)]
    return to_extended(2 * arb.pi()), _freeze_terms([acb(x.cos(), x.sin()) for x in angles])


TURN, TABLE = _make_table()
