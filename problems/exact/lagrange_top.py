"""Lagrange's top: the exact motion of a symmetric body on a pin under gravity, from any start, by theta functions.

With u = cos(theta) the height of the body axis e (O to C), energy and two angular momenta give (Whittaker, sect. 71)

    u_dot^2 = (alpha - beta u)(1 - u^2) - (b - a u)^2 = beta (u - u1)(u - u2)(u - u3),   u1 <= u <= u2 <= 1 <= u3
    u = u1 + (u2 - u1) sn^2(x),   x = lambda t + x0,   lambda^2 = beta (u3 - u1)/4,   k^2 = (u2 - u1)/(u3 - u1)

Euler angles are singular at u = +-1, which near-planar motions nearly reach. The Cayley-Klein parameters
p = cos(theta/2) exp(i (phi + psi)/2), s = sin(theta/2) exp(i (phi - psi)/2), a unit quaternion, are not:

    p = P theta1(z - i eta_p)/theta4(z) exp(i mu_p t),   z = pi x/(2 K)
    s = Q theta2(z - i eta_s)/theta4(z) exp(i mu_s t)

where theta1(z - i eta_p) vanishes with u = -1 and theta2(z - i eta_s) with u = 1 (Klein and Sommerfeld, ch. VI).
Constants are computed in 80 digits from the start as given, so that neither planar nor nearly steady motions lose any.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from mpmath import mp, mpf

from ...harness.mechanics.state import State
from .cayley_klein import CayleyKlein
from .pinned import ROUNDING, PinnedBody, PinnedMotion, frame_with
from .steady_precession import steady_precession
from .theta import log_slope, theta

DIGITS = 80
EQUAL = mpf(10) ** -30  # closer roots are one root: far below what float64 data can mean
SYMMETRIC = 1e-14  # relative difference of the transverse inertias, rounding of their computation


def lagrange_top(body: PinnedBody, start: State) -> PinnedMotion | None:
    """The motion, or None if the body is not symmetric about the line OC or approaches an unstable equilibrium."""
    c = float(np.linalg.norm(body.arm))
    e = body.arm / c
    axial = float(e @ body.inertia_O @ e)
    transverse = 0.5 * (float(np.trace(body.inertia_O)) - axial)
    symmetric = axial * np.outer(e, e) + transverse * (np.eye(3) - np.outer(e, e))
    if np.max(np.abs(body.inertia_O - symmetric)) > SYMMETRIC * transverse:
        return None
    R0, Omega = start.R[0], start.Omega[0]
    g = float(np.linalg.norm(body.gravity))
    with mp.workdps(DIGITS):
        weight = 2 * mpf(body.mass) * mpf(g) * mpf(c) / mpf(transverse)  # beta
        if weight == 0:
            return free_symmetric(body, start, e, axial, transverse)
        k = -body.gravity / g
        top = _Constants.of(
            _unit(R0.T @ k), _unit(e), [mpf(float(w)) for w in Omega], weight, mpf(axial) / mpf(transverse)
        )
        u1, u2, u3 = top.roots
        if u2 - u1 < EQUAL or (u3 - u2 < EQUAL and abs(top.u - u2) < EQUAL):
            pole = 1 - top.u**2 < EQUAL
            precession = 0.0 if pole else float((top.b - top.a * top.u) / (1 - top.u**2))
            return steady_precession(body, R0, k, precession, e, float(top.spin - top.u * precession))
        if u3 - u2 < EQUAL:
            return None
        return _by_theta(body, R0, Omega, frame_with(k), frame_with(e), top)


def free_symmetric(
    body: PinnedBody, start: State, e: Float[np.ndarray, " 3"], axial: float, transverse: float
) -> PinnedMotion:
    """Without torque: precession about the angular momentum at |L|/I_t, spin of the rest about the axis ``e``."""
    R0, Omega = start.R[0], start.Omega[0]
    spin = float(Omega @ e)
    L = R0 @ (transverse * Omega + (axial - transverse) * spin * e)
    size = float(np.linalg.norm(L))
    if size == 0.0:
        return steady_precession(body, R0, e, 0.0, e, 0.0)
    return steady_precession(body, R0, L, size / transverse, e, spin * (1.0 - axial / transverse))


@dataclass(frozen=True)
class _Constants:
    """u, u_dot of the start; a = I_a Omega_e/I_t, b = L_k/I_t, beta, Omega_e [1/s]; the roots of u_dot^2."""

    u: mpf
    u_dot: mpf
    a: mpf
    b: mpf
    beta: mpf
    spin: mpf
    roots: tuple[mpf, mpf, mpf]

    @staticmethod
    def of(k: Sequence[mpf], e: Sequence[mpf], Omega: Sequence[mpf], beta: mpf, ratio: mpf) -> "_Constants":
        """From the vertical k, the axis e and Omega, all in the body frame; ``ratio`` is I_a/I_t."""
        u, spin = _dot(k, e), _dot(Omega, e)
        u_dot = k[0] * (Omega[1] * e[2] - Omega[2] * e[1])
        u_dot += k[1] * (Omega[2] * e[0] - Omega[0] * e[2]) + k[2] * (Omega[0] * e[1] - Omega[1] * e[0])
        a = ratio * spin
        b = _dot(k, Omega) + (a - spin) * u
        alpha = _dot(Omega, Omega) - spin**2 + beta * u
        return _Constants(
            u, u_dot, a, b, beta, spin, _cubic((alpha + a**2) / beta, 2 * a * b / beta - 1, (alpha - b**2) / beta)
        )


def _cubic(sum_: mpf, p: mpf, q: mpf) -> tuple[mpf, mpf, mpf]:
    """The three real roots of u^3 - ``sum_`` u^2 + p u + q, increasing: -1 <= u1 <= u2 <= 1 <= u3."""
    third = sum_ / 3
    radius = mp.sqrt(max(third**2 - p / 3, mpf(0)))
    if radius == 0:
        return third, third, third
    cosine = (2 * third**3 - third * p - q) / (2 * radius**3)
    angle = mp.acos(min(max(cosine, mpf(-1)), mpf(1))) / 3
    u3, u1, u2 = (third + 2 * radius * mp.cos(angle - 2 * mp.pi * j / 3) for j in (0, 2, 1))
    u1, u2 = min(u1, u2), max(u1, u2)
    return max(u1, mpf(-1)), min(u2, mpf(1)), max(u3, mpf(1))


def _by_theta(
    body: PinnedBody,
    R0: Float[np.ndarray, "3 3"],
    Omega0: Float[np.ndarray, " 3"],
    S: Float[np.ndarray, "3 3"],
    B: Float[np.ndarray, "3 3"],
    top: _Constants,
) -> PinnedMotion:
    u1, u2, u3 = top.roots
    m, m1 = (u2 - u1) / (u3 - u1), (u3 - u2) / (u3 - u1)  # k^2 and its complement
    K, K1 = mp.ellipk(m), mp.ellipk(m1)
    q = mp.exp(-mp.pi * K1 / K)
    to_phase = mp.pi / (2 * K)
    rate = to_phase * mp.sqrt(top.beta * (u3 - u1)) / 2  # of z
    part = min(max((top.u - u1) / (u2 - u1), mpf(0)), mpf(1))
    z0 = to_phase * mp.ellipf(mp.asin(mp.sqrt(part)), m) * (1 if top.u_dot >= 0 else -1)
    # sn^2(i y_p) = (-1 - u1)/(u2 - u1) and sn^2(K + i y_s) = (1 - u1)/(u2 - u1); u_dot = i(a+b), i(a-b) there
    y_p = mp.ellipf(mp.atan(mp.sqrt((1 + u1) / (u2 - u1))), m1)
    inside = min((1 - u2) * (u3 - u1) / ((1 - u1) * (u3 - u2)), mpf(1))
    y_s = mp.ellipf(mp.asin(mp.sqrt(inside)), m1)
    eta_p = to_phase * y_p * _side(top.a + top.b)
    eta_s = to_phase * y_s * _side(top.b - top.a)
    # p_dot/p at u2 and s_dot/s at u1, where u_dot = 0; theta1 a quarter period on is theta2
    mu_p = (top.a + top.b) / (2 * (1 + u2)) + (top.spin - top.a) / 2 - rate * _imaginary_slope(eta_p, q)
    mu_s = (top.b - top.a) / (2 * (1 - u1)) + (top.a - top.spin) / 2 - rate * _imaginary_slope(eta_s, q)
    P = mp.sqrt((1 + u2) / 2) * abs(mp.jtheta(3, 0, q) / mp.jtheta(2, mp.mpc(0, eta_p), q))  # theta4(pi/2) = theta3(0)
    Q = mp.sqrt((1 - u1) / 2) * abs(mp.jtheta(4, 0, q) / mp.jtheta(2, mp.mpc(0, eta_s), q))
    over_p, over_s = theta(1, q, eta_p, P), theta(2, q, eta_s, Q)
    motion = CayleyKlein(over_p, over_s, theta(4, q), float(z0), float(rate), float(mu_p), float(mu_s))
    turns = motion.turns(S.T @ R0 @ B, B.T @ Omega0)

    def attitude(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        R, Omega = motion.attitude(t, *turns)
        return S @ R @ B.T, Omega @ B.T

    condition = float(m1) ** -0.5  # theta4 and the numerators fall to sqrt(k') of their largest in each period
    growth = 4.0 * ROUNDING * (float(rate) + abs(float(mu_p)) + abs(float(mu_s)))
    return PinnedMotion(
        "theta functions (Lagrange's top)", body, attitude, 64.0 * condition * ROUNDING, condition * growth
    )


def _side(x: mpf) -> int:
    """Sign of x; at 0, where u = -1 or 1 is a root, both signs give the same motion."""
    return 1 if x >= 0 else -1


def _imaginary_slope(eta: mpf, q: mpf) -> mpf:
    """Im of theta2'/theta2 at -i eta, where it is imaginary."""
    return mp.im(log_slope(2, mp.mpc(0, -eta), q))


def _unit(a: np.ndarray) -> list[mpf]:
    v = [mpf(float(x)) for x in a]
    size = mp.sqrt(_dot(v, v))
    return [x / size for x in v]


def _dot(a: Sequence[mpf], b: Sequence[mpf]) -> mpf:
    return mp.fsum(x * y for x, y in zip(a, b, strict=True))
