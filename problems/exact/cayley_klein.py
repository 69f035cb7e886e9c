"""Represent the attitude by Cayley-Klein parameters, which have no singular orientation.

With 3-1-3 angles: p = cos(theta/2) exp(i (phi + psi)/2), s = sin(theta/2) exp(i (phi - psi)/2). They are the unit
quaternion (Re p, Re s, Im s, Im p). Each is a quotient of theta series times a uniform rotation: ``over(z)/under(z)
exp(i mu t)``, z = z0 + rate t.
"""

from dataclasses import dataclass

import numpy as np
from flint import acb, arb
from jaxtyping import Complex, Float

from .balls import Matrix, Quaternion, conjugate, convert_to_quaternion, largest_radius, multiply, to_extended
from .theta import UNIT, ThetaPhase, ThetaSeries, make_constant_series

Four = tuple[Float[np.ndarray, "*nt"], ...]  # w, x, y, z


@dataclass(frozen=True)
class CayleyKlein:
    """The functions p and s of time, between the constant rotations ``left`` (space) and ``right`` (body)."""

    over_p: ThetaSeries  # numerator of p
    over_s: ThetaSeries  # numerator of s
    under: ThetaSeries  # their common denominator
    least: float  # lower bound of |under|
    z: ThetaPhase  # exp(i z) at a time
    turn_p: ThetaPhase  # exp(i mu_p t)
    turn_s: ThetaPhase
    rates: tuple[float, float, float]  # rate of z, mu_p and mu_s [rad/s]
    left: Quaternion
    right: Quaternion

    def attitude(self, t: Float[np.ndarray, " nt"]) -> tuple[Float[np.ndarray, "nt 3 3"], Float[np.ndarray, "nt 3"]]:
        """Return R in extended precision, and Omega = 2 vec(q* q_dot) in float64 [rad/s, body frame], at ``t`` [s].

        q is the quaternion of p and s, which is multiplied by the constant ``left`` and ``right``.
        """
        w = self.z(t)
        D = self.under(w).real
        turn_p, turn_s = self.turn_p(t), self.turn_s(t)
        p, s = (over(w) / D * turn for over, turn in ((self.over_p, turn_p), (self.over_s, turn_s)))
        left, right = (tuple(np.asarray(to_extended(x)) for x in q) for q in (self.left, self.right))
        R = find_rotation(_multiply_quaternions(_multiply_quaternions(left, _find_quaternion(p, s)), right))
        rate, mu_p, mu_s = self.rates
        w, p, s, D = (x.astype(y) for x, y in ((w, complex), (p, complex), (s, complex), (D, float)))
        log = self.under.slope(w).real / D
        p_dot = rate * (self.over_p.slope(w) / D * turn_p.astype(complex) - p * log) + 1j * mu_p * p
        s_dot = rate * (self.over_s.slope(w) / D * turn_s.astype(complex) - s * log) + 1j * mu_s * s
        back = (p.real, -s.real, -s.imag, -p.imag)
        Omega = 2.0 * np.stack(_multiply_quaternions(back, _find_quaternion(p_dot, s_dot))[1:], axis=-1)
        B = find_rotation((right[0], -right[1], -right[2], -right[3]))
        return R, Omega @ B.astype(float).T

    def error(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Return a proved bound on the Frobenius norm of R's error at ``t`` [s].

        It is 3 times the bound on the quaternion's error, and 100 roundings.
        """
        phase = self.z.error(t)
        under = self.under.error(phase)
        quotients = sum(over.error(phase) + under for over in (self.over_p, self.over_s))
        q = 1.1 * quotients / (self.least - under) + self.turn_p.error(t) + self.turn_s.error(t)
        return 3.0 * (q + 4.0 * largest_radius([*self.left, *self.right])) + 100.0 * UNIT


def rotate_uniformly(q0: Quaternion, left: Matrix, right: Matrix, mu_p: arb, mu_s: arb) -> CayleyKlein:
    """Return the attitude that starts as ``q0`` and whose parameters rotate uniformly, p at ``mu_p``, s at ``mu_s``.

    The rates are in rad/s. R is the rotation of p and s between the constant rotations ``left`` (space) and ``right``
    (body), of which the latter is transposed.
    """
    one, still = make_constant_series(acb(1)), ThetaPhase.from_radians(arb(0), arb(0))
    p, s = find_cayley_klein(q0)
    turns = ThetaPhase.from_radians(arb(0), mu_p), ThetaPhase.from_radians(arb(0), mu_s)
    rates = (0.0, float(mu_p), float(mu_s))
    return CayleyKlein(
        make_constant_series(p),
        make_constant_series(s),
        one,
        1.0,
        still,
        *turns,
        rates,
        convert_to_quaternion(left),
        conjugate(convert_to_quaternion(right)),
    )


def relative_quaternion(left: Matrix, R: Matrix, right: Matrix) -> Quaternion:
    """Return the quaternion of left^T R right."""
    return multiply(
        multiply(conjugate(convert_to_quaternion(left)), convert_to_quaternion(R)), convert_to_quaternion(right)
    )


def find_cayley_klein(q: Quaternion) -> tuple[acb, acb]:
    """Return the Cayley-Klein parameters p and s of a quaternion."""
    return acb(q[0], q[3]), acb(q[1], q[2])


def find_rotation(q: Four) -> Float[np.ndarray, "*nt 3 3"]:
    """Return R (..., 3, 3) of quaternions (w, x, y, z), which need not have unit length."""
    w, x, y, z = q
    rows = (
        (w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z),
    )
    size = w * w + x * x + y * y + z * z
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2) / np.asarray(size)[..., None, None]


def _find_quaternion(p: Complex[np.ndarray, " nt"], s: Complex[np.ndarray, " nt"]) -> Four:
    """Return the quaternion (w, x, y, z) of Cayley-Klein parameters."""
    return p.real, s.real, s.imag, p.imag


def _multiply_quaternions(a: Four, b: Four) -> Four:
    """Return the products a b of quaternions (w, x, y, z), component by component as arrays over time."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] + a[2] * b[0] + a[3] * b[1] - a[1] * b[3],
        a[0] * b[3] + a[3] * b[0] + a[1] * b[2] - a[2] * b[1],
    )
