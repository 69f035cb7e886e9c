"""Solve Lagrange's top: a symmetric body on a pin under gravity, exact from any start, by theta functions.

With u = cos(theta) the height of the body axis e (O to C), energy and two angular momenta give (Whittaker, sect. 71)

    u_dot^2 = (alpha - beta u)(1 - u^2) - (b - a u)^2 = beta (u - u1)(u - u2)(u - u3),   u1 <= u <= u2 <= 1 <= u3
    u = u1 + (u2 - u1) sn^2(x),   x = lambda t + x0,   lambda^2 = beta (u3 - u1)/4,   k^2 = (u2 - u1)/(u3 - u1)

Euler angles are singular at u = +-1, which near-planar motions nearly attain. The Cayley-Klein parameters p =
cos(theta/2) exp(i (phi + psi)/2), s = sin(theta/2) exp(i (phi - psi)/2), a unit quaternion, are not:

    p = P theta1(z - i eta_p)/theta4(z) exp(i mu_p t),   z = pi x/(2 K)
    s = Q theta2(z - i eta_s)/theta4(z) exp(i mu_s t)

where theta1(z - i eta_p) vanishes with u = -1 and theta2(z - i eta_s) with u = 1 (Klein and Sommerfeld, ch. VI).
Constants are computed in balls from the start as given, so that neither planar nor nearly steady motions lose a digit;
p, s and their derivatives at t = 0 are compared with the start.
"""

from dataclasses import dataclass

import numpy as np
from flint import acb, arb

from .balls import (
    Matrix,
    Vector,
    apply_matrix,
    conjugate,
    convert_to_quaternion,
    cross,
    dot,
    find_root,
    make_frame_about,
    multiply,
    norm,
    scale_vector,
    sign,
    to_balls,
    transpose,
)
from .cayley_klein import CayleyKlein, find_cayley_klein, relative_quaternion
from .pinned_body import PinnedBody, PinnedMotion, RoundingEffect
from .steady_precession import find_steady_precession
from .theta import ThetaPhase, evaluate_thetas, find_elliptic_argument, make_theta_series

EQUAL = 1e-60  # distance of equal roots: far below the resolution of float64 data
SYMMETRIC = 1e-14  # relative difference of transverse inertias that is rounding
ROUTE = "theta functions (Lagrange's top)"


def solve_lagrange_top(body: PinnedBody, R0: Matrix, Omega0: Vector) -> PinnedMotion | None:
    """Return the exact motion from R0, Omega0 [rad/s, body] of a body that is symmetric about OC.

    A top that neither nutates nor approaches an equilibrium precesses steadily. Return None if the body is not
    symmetric, or if the motion approaches an unstable equilibrium.
    """
    e = body.arm / np.linalg.norm(body.arm)
    across = np.diag(body.inertia_C)[body.arm == 0.0]
    diagonal = np.array_equal(body.inertia_C, np.diag(np.diag(body.inertia_C)))
    exact = diagonal and len(across) == 2 and across[0] == across[1]
    float_axial = float(e @ body.inertia_C @ e)
    float_transverse = float(across[0]) if exact else 0.5 * (float(np.trace(body.inertia_C)) - float_axial)
    symmetric = float_axial * np.outer(e, e) + float_transverse * (np.eye(3) - np.outer(e, e))
    if np.max(np.abs(body.inertia_C - symmetric)) > SYMMETRIC * np.max(np.abs(body.inertia_O)):
        return None
    arm, weight = to_balls(body.arm), to_balls(body.gravity)
    c, g, m = norm(arm), norm(weight), arb(body.mass)
    axial, transverse = arb(float_axial), arb(float_transverse) + m * dot(arm, arm)
    k, axis = scale_vector(weight, -1 / g), scale_vector(arm, 1 / c)
    top = _Constants.compute(
        apply_matrix(transpose(R0), k), axis, Omega0, 2 * m * g * c / transverse, axial / transverse
    )
    u1, u2, u3 = top.roots
    rates = abs(float(top.spin)) + abs(float(top.b)) + float(find_root(top.beta * (u3 - u1)))
    upper = bool(u3 - u2 > EQUAL)
    if not u2 - u1 > EQUAL or (not upper and not abs(top.u - u2) > EQUAL):
        pole = not 1 - top.u * top.u > EQUAL
        precession = arb(0) if pole else (top.b - top.a * top.u) / (1 - top.u * top.u)
        rounded = RoundingEffect.compute_unless(False, rates)
        return find_steady_precession(body, R0, k, precession, axis, top.spin - top.u * precession, rounded)
    if not upper:
        return None
    return _solve_by_theta(
        body, R0, Omega0, make_frame_about(k), make_frame_about(axis), top, RoundingEffect.compute_unless(exact, rates)
    )


def solve_free_symmetric(
    body: PinnedBody, R0: Matrix, Omega0: Vector, e: Vector, axial: arb, transverse: arb, rounded: RoundingEffect
) -> PinnedMotion:
    """Return the motion without torque, from R0 and Omega0, of a body symmetric about ``e``: a steady precession.

    The body turns about the angular momentum at |L|/I_t, with the remaining spin about e. ``axial`` and ``transverse``
    are its inertias [kg m2]; ``rounded`` is the effect of rounded data on the attitude.
    """
    spin = dot(Omega0, e)
    L = apply_matrix(R0, [transverse * w + (axial - transverse) * spin * x for w, x in zip(Omega0, e, strict=True)])
    size = norm(L)
    if not size > 0:
        return find_steady_precession(body, R0, e, arb(0), e, arb(0), rounded)
    return find_steady_precession(body, R0, L, size / transverse, e, spin * (1 - axial / transverse), rounded)


@dataclass(frozen=True)
class _Constants:
    """The values u, u_dot at the start; a = I_a Omega_e/I_t, b = L_k/I_t, beta, Omega_e [1/s]; roots of u_dot^2."""

    u: arb
    u_dot: arb
    a: arb
    b: arb
    beta: arb
    spin: arb
    roots: tuple[arb, arb, arb]

    @staticmethod
    def compute(k: Vector, e: Vector, Omega: Vector, beta: arb, ratio: arb) -> "_Constants":
        """Compute the constants from the vertical k, the axis e and Omega [rad/s], all in the body frame.

        ``beta`` is 2 m g c/I_t [1/s2], with c the distance of C from O, and ``ratio`` is I_a/I_t.
        """
        u, spin = dot(k, e), dot(Omega, e)
        u_dot = dot(k, cross(Omega, e))
        a = ratio * spin
        b = dot(k, Omega) + (a - spin) * u
        alpha = dot(Omega, Omega) - spin * spin + beta * u
        return _Constants(
            u,
            u_dot,
            a,
            b,
            beta,
            spin,
            _solve_cubic((alpha + a * a) / beta, 2 * a * b / beta - 1, (alpha - b * b) / beta),
        )


def _solve_cubic(sum_: arb, p: arb, q: arb) -> tuple[arb, arb, arb]:
    """Return the three real roots of u^3 - ``sum_`` u^2 + p u + q, increasing and cut to -1 <= u1 <= u2 <= 1 <= u3.

    Viete's formula is used, with ``sum_`` the sum of the roots.
    """
    third = sum_ / 3
    radius = find_root(third * third - p / 3)
    if not radius > 0:
        return third, third, third
    cosine = (2 * third * third * third - third * p - q) / (2 * radius * radius * radius)
    angle = arb.atan2(find_root((1 - cosine) * (1 + cosine)), cosine) / 3
    u3, u1, u2 = (third + 2 * radius * (angle - 2 * arb.pi() * j / 3).cos() for j in (0, 2, 1))
    u1, u2 = u1.min(u2), u1.max(u2)
    return u1.max(arb(-1)), u2.min(arb(1)), u3.max(arb(1))


def _solve_by_theta(
    body: PinnedBody, R0: Matrix, Omega0: Vector, S: Matrix, B: Matrix, top: _Constants, rounded: RoundingEffect
) -> PinnedMotion:
    """Return the motion of a nutating top from R0, Omega0 [rad/s, body] by theta functions, as in the module's text.

    ``S`` has the direction against gravity [space] as its third column, ``B`` the axis of the body [body]; ``top`` has
    the constants. Raise ArithmeticError if the formula does not fit the start.
    """
    u1, u2, u3 = top.roots
    m, m1 = (u2 - u1) / (u3 - u1), (u3 - u2) / (u3 - u1)  # k^2 and its complement
    K, K1 = (acb(x).elliptic_k().real for x in (m, m1))
    tau, to_phase = acb(0, K1 / K), arb.pi() / (2 * K)
    q = (-arb.pi() * K1 / K).exp()
    rate = to_phase * find_root(top.beta * (u3 - u1)) / 2  # of z
    z0 = to_phase * _find_argument(top, m)
    # sn^2(i y_p) = (-1 - u1)/(u2 - u1) and sn^2(K + i y_s) = (1 - u1)/(u2 - u1); u_dot = i(a+b), i(a-b) there
    y_p = find_elliptic_argument(find_root((1 + u1) / (1 + u2)), find_root((u2 - u1) / (1 + u2)), m1)
    inside = (1 - u2) * (u3 - u1) / ((1 - u1) * (u3 - u2))
    y_s = find_elliptic_argument(find_root(inside), find_root(1 - inside), m1)
    eta_p, eta_s = to_phase * _copy_sign(y_p, top.a + top.b, K1), to_phase * _copy_sign(y_s, top.b - top.a, K1)
    at_p, at_s, zero = (evaluate_thetas(acb(0, -eta), tau) for eta in (eta_p, eta_s, arb(0)))
    slope_p, slope_s = (
        (evaluate_thetas(acb(0, -eta), tau, 1)[1] / at[1]).imag for eta, at in ((eta_p, at_p), (eta_s, at_s))
    )  # theta2'/theta2 at -i eta is imaginary
    # p_dot/p at u2 and s_dot/s at u1, where u_dot = 0; theta1 a quarter period on is theta2
    mu_p = (top.a + top.b) / (2 * (1 + u2)) + (top.spin - top.a) / 2 - rate * slope_p
    mu_s = (top.b - top.a) / (2 * (1 - u1)) + (top.a - top.spin) / 2 - rate * slope_s
    P = find_root((1 + u2) / 2) * abs(zero[2] / at_p[1])  # theta4(pi/2) = theta3(0)
    Q = find_root((1 - u1) / 2) * abs(zero[3] / at_s[1])
    q0 = relative_quaternion(S, R0, B)
    q_dot = scale_vector(multiply(q0, [arb(0), *apply_matrix(transpose(B), Omega0)]), arb(1) / 2)
    factors = []
    for kind, eta, mu, size, start, start_dot in zip(
        (0, 1), (eta_p, eta_s), (mu_p, mu_s), (P, Q), find_cayley_klein(q0), find_cayley_klein(q_dot), strict=True
    ):
        N, N_dot = (evaluate_thetas(acb(z0, -eta), tau, d)[kind] for d in (0, 1))
        D, D_dot = (evaluate_thetas(acb(z0), tau, d)[3] for d in (0, 1))
        value, slope = size * N / D, size * rate * (N_dot - N * D_dot / D) / D
        slope += acb(0, mu) * value
        turn = start / value if abs(start) > 1e-9 else start_dot / slope
        if not ((turn * value).overlaps(start) and (turn * slope).overlaps(start_dot) and abs(turn).overlaps(arb(1))):
            raise ArithmeticError("the formula of Lagrange's top does not start where the motion does")
        factors.append(size * turn)
    least = 0.999 * float(zero[3].real)  # theta4 is smallest at 0
    motion = CayleyKlein(
        make_theta_series(1, q, eta_p, factors[0]),
        make_theta_series(2, q, eta_s, factors[1]),
        make_theta_series(4, q, arb(0), acb(1)),
        least,
        ThetaPhase.from_radians(z0, rate),
        ThetaPhase.from_radians(arb(0), mu_p),
        ThetaPhase.from_radians(arb(0), mu_s),
        (float(rate), float(mu_p), float(mu_s)),
        convert_to_quaternion(S),
        conjugate(convert_to_quaternion(B)),
    )
    return PinnedMotion(ROUTE, body, motion, rounded)


def _find_argument(top: _Constants, m: arb) -> arb:
    """Return x0, the argument of sn at the start, from u = u1 + (u2 - u1) sn^2 x and the sign of u_dot there.

    If the sign is unknown, x0 is a ball about 0 or about K. ``m`` is k^2.
    """
    u1, u2, _ = top.roots
    sn, cn = find_root((top.u - u1) / (u2 - u1)), find_root((u2 - top.u) / (u2 - u1))
    side = sign(top.u_dot)
    if side:
        sn = side * sn
    elif float(sn) < float(cn):
        sn = sn * arb(0, 1)
    else:
        cn = cn * arb(0, 1)
    return find_elliptic_argument(sn, cn, m)


def _copy_sign(y: arb, x: arb, K1: arb) -> arb:
    """Return ``y`` with the sign of ``x``.

    If the sign is unknown, y is about 0 or about K1, and both signs of y, or y and 2 K1 - y, give the same motion: a
    ball that contains both is returned.
    """
    if sign(x):
        return sign(x) * y
    return y * arb(0, 1) if 2 * float(y) < float(K1) else y.union(2 * K1 - y)
