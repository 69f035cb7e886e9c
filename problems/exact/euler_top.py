"""Solve the torque-free body of any inertia: Euler's motion by theta functions, exact from any start.

Axes 1, 2, 3 are principal, 2 has the middle inertia, 3 is circled by the angular momentum L (Whittaker, sect. 69):

    L1 = A cn x,  L2 = +-B sn x,  L3 = C dn x,   x = lambda t + x0
    A^2 = I1 (2 T I3 - L^2)/(I3 - I1),  B^2 = I2 (2 T I3 - L^2)/(I3 - I2),  C^2 = I3 (L^2 - 2 T I1)/(I3 - I1)
    lambda^2 = (I3 - I2)(L^2 - 2 T I1)/(I1 I2 I3),   k^2 = (I2 - I1)(2 T I3 - L^2)/((I3 - I2)(L^2 - 2 T I1))

With OZ along L, the third row of R is L/|L|; the first plus i times the second, U, is a quotient of theta functions too
(Jacobi), times a uniform rotation, with z = pi x/(2 K) and theta1 of i eta vanishing with L1^2 + L2^2:

    U1 = c1 theta4(z -+ i eta)/theta4(z) exp(i n t),  U2 = c2 theta3(..)/..,  U3 = c3 theta1(..)/..

The start gives c; U_dot = U x Omega gives n three times, and the values must agree.
"""

from dataclasses import dataclass

import numpy as np
from flint import acb, arb
from jaxtyping import Float

from .balls import (
    Matrix,
    Vector,
    apply_matrix,
    cross,
    dot,
    find_root,
    largest_radius,
    make_frame_about,
    norm,
    product,
    to_balls,
    to_extended,
    transpose,
)
from .lagrange_top import solve_free_symmetric
from .pinned_body import PinnedBody, PinnedMotion, RoundingEffect
from .steady_precession import find_steady_precession
from .theta import UNIT, ThetaPhase, ThetaSeries, evaluate_thetas, find_elliptic_argument, make_theta_series

SAME_INERTIA = 1e-14  # relative difference: rounding of computed data


def solve_euler_top(body: PinnedBody, R0: Matrix, Omega0: Vector) -> PinnedMotion | None:
    """Return the exact motion without torque from R0, Omega0 [rad/s, body].

    A symmetric body, or rotation about a principal axis, gives a steady precession, other motions theta functions.
    Return None on the separatrix, where the motion approaches rotation about the intermediate axis.
    """
    exact = not np.any(body.inertia_O - np.diag(np.diag(body.inertia_O)))
    inertia, axes = np.linalg.eigh(body.inertia_O)
    if exact:
        order = np.argsort(np.diag(body.inertia_O), kind="stable")
        inertia, axes = np.diag(body.inertia_O)[order], np.eye(3)[:, order]
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    P, I = [to_balls(row) for row in axes], to_balls(inertia)
    speed = float(norm(Omega0))
    for j, (i, k) in enumerate(((1, 2), (0, 2), (0, 1))):
        if abs(inertia[k] - inertia[i]) <= SAME_INERTIA * inertia[k]:
            rounded = RoundingEffect.compute_unless(exact and inertia[i] == inertia[k], speed)
            return solve_free_symmetric(body, R0, Omega0, transpose(P)[j], I[j], (I[i] + I[k]) / 2, rounded)
    w = apply_matrix(transpose(P), Omega0)
    rounded = RoundingEffect.compute_unless(exact, speed)
    if sum(not x.is_zero() for x in w) <= 1:
        axis = Omega0 if speed else transpose(P)[0]
        return find_steady_precession(body, R0, transpose(R0)[0], arb(0), axis, norm(Omega0), rounded)
    LL = dot([a * b for a, b in zip(I, w, strict=True)], [a * b for a, b in zip(I, w, strict=True)])
    between = dot(I, [x * x for x in w]) * I[1] - LL
    if between.contains(0):
        return None
    if between > 0:  # L circles the axis of the least inertia: call that one 3, keep the frame right-handed
        I, w = I[::-1], [w[2], -w[1], w[0]]
        P = [[row[2], -row[1], row[0]] for row in P]
    return _solve_by_theta(body, R0, P, I, w, rounded)


@dataclass(frozen=True)
class JacobiMatrix:
    """The attitude R = ``left`` (real part of U; imaginary part of U; L/|L|) ``axes``^T."""

    U: tuple[ThetaSeries, ...]  # numerators of U1, U2, U3
    l: tuple[ThetaSeries, ...]  # numerators of L/|L| in principal axes
    under: ThetaSeries  # their common denominator
    least: float  # lower bound of |under|
    z: ThetaPhase  # exp(i z) at a time
    turn: ThetaPhase  # exp(i n t)
    left: Matrix
    axes: Matrix  # principal axes in the body frame
    rates: Float[np.ndarray, " 3"]  # |L| over the inertias [rad/s]

    def attitude(self, t: Float[np.ndarray, " nt"]) -> tuple[Float[np.ndarray, "nt 3 3"], Float[np.ndarray, "nt 3"]]:
        """Return R in extended precision, and Omega in float64 [rad/s, body frame], at ``t`` [s]."""
        w, turn = self.z(t), self.turn(t)
        D = self.under(w).real
        U = np.stack([over(w) / D * turn for over in self.U], axis=-1)
        l = np.stack([over(w).real / D for over in self.l], axis=-1)
        left, axes = (np.array([[to_extended(x) for x in row] for row in A]) for A in (self.left, self.axes))
        R = left @ np.stack((U.real, U.imag, l), axis=1) @ axes.T
        return R, self.rates * l.astype(float) @ axes.astype(float).T

    def error(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Return a proved bound on the Frobenius norm of R's error at ``t`` [s].

        It is the sum of those on the errors of its rows, of the constant rotations, and of 100 roundings.
        """
        phase = self.z.error(t)
        under = self.under.error(phase)
        quotients = sum(over.error(phase) + under for over in (*self.U, *self.l))
        constant = largest_radius([x for row in (*self.left, *self.axes) for x in row])
        return 1.1 * quotients / (self.least - under) + 3.0 * self.turn.error(t) + 20.0 * constant + 100.0 * UNIT


def _solve_by_theta(
    body: PinnedBody, R0: Matrix, P: Matrix, I: Vector, w: Vector, rounded: RoundingEffect
) -> PinnedMotion:
    """Return the motion of an asymmetric body by theta functions, as in the module's text.

    ``P`` has the principal axes [body] as columns, ``I`` the inertias [kg m2] and ``w`` the components of Omega [rad/s]
    about them, numbered such that L circles axis 3. Raise ArithmeticError if the formula and its rate do not fit the
    start.
    """
    I1, I2, I3 = I
    L = [a * b for a, b in zip(I, w, strict=True)]
    LL, TT = dot(L, L), dot(L, w)  # L^2, 2 T
    size, up = LL.sqrt(), 1 if float(L[2]) > 0.0 else -1
    A, B = find_root(I1 * (TT * I3 - LL) / (I3 - I1)), find_root(I2 * (TT * I3 - LL) / (I3 - I2))
    C = find_root(I3 * (LL - TT * I1) / (I3 - I1))
    lam = find_root((I3 - I2) * (LL - TT * I1) / (I1 * I2 * I3))
    m = (I2 - I1) * (TT * I3 - LL) / ((I3 - I2) * (LL - TT * I1))
    K, K1 = (acb(x).elliptic_k().real for x in (m, 1 - m))
    tau, to_phase = acb(0, K1 / K), arb.pi() / (2 * K)
    q = (-arb.pi() * K1 / K).exp()
    side = 1 if I3 > I2 else -1
    B2 = up * side * B  # L2 = B2 sn x, from L1_dot = L2 L3 (1/I3 - 1/I2)
    z0 = to_phase * find_elliptic_argument(L[1] / B2, L[0] / A, m)
    root_height = find_root(B * B - A * A)
    eta = side * to_phase * find_elliptic_argument(A / B, root_height / B, 1 - m)
    rate = to_phase * lam
    # sn, cn, dn as quotients of theta1, theta2, theta3 by theta4, scaled to the components of L/|L|
    _, t2, t3, t4 = evaluate_thetas(acb(0), tau)
    scales = (A / size * t4 / t2, B2 / size * t3 / t2, up * C / size * t4 / t3)
    l = tuple(make_theta_series(kind, q, arb(0), scale) for kind, scale in zip((2, 1, 3), scales, strict=True))
    S = make_frame_about(apply_matrix(R0, apply_matrix(P, L)))
    rows = product(product(transpose(S), R0), P)
    U0, U0_dot = (
        [acb(x, y) for x, y in zip(*pair, strict=True)] for pair in (rows[:2], [cross(a, w) for a in rows[:2]])
    )
    at, slope = (evaluate_thetas(acb(z0, -eta), tau, d) for d in (0, 1))
    D, D_dot = (evaluate_thetas(acb(z0), tau, d)[3] for d in (0, 1))
    kinds = (3, 2, 0)
    # n from each of U1, U2, U3: they must agree
    turning = [U_dot / U - rate * (slope[k] / at[k] - D_dot / D) for U, U_dot, k in zip(U0, U0_dot, kinds, strict=True)]
    l0 = [s * evaluate_thetas(acb(z0), tau)[k] / D for s, k in zip(scales, (1, 0, 2), strict=True)]
    known = zip(l0, rows[2], strict=True)
    if not all(x.overlaps(acb(0, turning[0].imag)) for x in turning) or not all(x.overlaps(acb(y)) for x, y in known):
        raise ArithmeticError("the formula of Euler's top does not start where the motion does")
    n = turning[0].imag
    U = tuple(make_theta_series(k + 1, q, eta, x * D / at[k]) for x, k in zip(U0, kinds, strict=True))
    rates = float(size) / np.array([float(x) for x in I])
    least = 0.999 * float(t4.real)  # theta4 is smallest at 0
    motion = JacobiMatrix(
        U,
        l,
        make_theta_series(4, q, arb(0), acb(1)),
        least,
        ThetaPhase.from_radians(z0, rate),
        ThetaPhase.from_radians(arb(0), n),
        S,
        P,
        rates,
    )
    return PinnedMotion("theta functions (Euler's top)", body, motion, rounded)
