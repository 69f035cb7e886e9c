"""Torque-free body of any inertia: Euler's motion by theta functions, exact from any start.

Axes 1, 2, 3 are principal, 2 the middle inertia, 3 the one that the angular momentum L circles (Whittaker, sect. 69):

    L1 = A cn x,  L2 = +-B sn x,  L3 = C dn x,   x = lambda t + x0
    A^2 = I1 (2 T I3 - L^2)/(I3 - I1),  B^2 = I2 (2 T I3 - L^2)/(I3 - I2),  C^2 = I3 (L^2 - 2 T I1)/(I3 - I1)
    lambda^2 = (I3 - I2)(L^2 - 2 T I1)/(I1 I2 I3),   k^2 = (I2 - I1)(2 T I3 - L^2)/((I3 - I2)(L^2 - 2 T I1))

The angle about L has phi_dot = |L| (L1^2/I1 + L2^2/I2)/(L1^2 + L2^2), whose integral is the phase of a theta function
beside an even turn: exp(i phi) = exp(i n t) theta1(z -+ i eta)/|theta1(z -+ i eta)|, z = pi x/(2 K), theta1 of i eta
vanishing with L1^2 + L2^2.
"""

import numpy as np
from jaxtyping import Float
from mpmath import mp, mpf

from ...harness.mechanics.state import State
from .lagrange_top import DIGITS, EQUAL, free_symmetric
from .pinned import ROUNDING, PinnedBody, PinnedMotion, frame_with, turn_z
from .steady_precession import steady_precession
from .theta import log_slope, theta

SAME_INERTIA = 1e-14  # relative: rounding of computed data


def euler_top(body: PinnedBody, start: State) -> PinnedMotion | None:
    """The motion without torque, or None on the separatrix (which approaches the intermediate axis)."""
    R0, Omega0 = start.R[0], start.Omega[0]
    inertia, P = np.linalg.eigh(body.inertia_O)
    P[:, 2] = np.cross(P[:, 0], P[:, 1])
    for j, (i, k) in enumerate(((1, 2), (0, 2), (0, 1))):
        if abs(inertia[k] - inertia[i]) <= SAME_INERTIA * inertia[k]:
            return free_symmetric(body, start, P[:, j], float(inertia[j]), float(0.5 * (inertia[i] + inertia[k])))
    W = P.T @ Omega0
    if np.count_nonzero(W) <= 1:
        return steady_precession(body, R0, R0[:, 0], 0.0, Omega0 if W.any() else P[:, 0], float(np.linalg.norm(Omega0)))
    with mp.workdps(DIGITS):
        I, w = [mpf(float(x)) for x in inertia], [mpf(float(x)) for x in W]
        L2, T2 = (
            mp.fsum((a * b) ** 2 for a, b in zip(I, w, strict=True)),
            mp.fsum(a * b**2 for a, b in zip(I, w, strict=True)),
        )
        if abs(L2 - T2 * I[1]) < EQUAL * L2:
            return None
        if T2 * I[1] > L2:  # L circles the axis of the least inertia: call that one 3, keep the frame right-handed
            I, w, P = [I[2], I[1], I[0]], [w[2], -w[1], w[0]], P[:, [2, 1, 0]] * np.array([1.0, -1.0, 1.0])
        return _by_theta(body, R0, P, I, w)


def _by_theta(
    body: PinnedBody, R0: Float[np.ndarray, "3 3"], P: Float[np.ndarray, "3 3"], I: list[mpf], w: list[mpf]
) -> PinnedMotion:
    I1, I2, I3 = I
    L = [a * b for a, b in zip(I, w, strict=True)]
    LL, TT = mp.fsum(x**2 for x in L), mp.fsum(a * b**2 for a, b in zip(I, w, strict=True))  # L^2, 2 T
    size, up = mp.sqrt(LL), mp.sign(L[2])
    A, B = mp.sqrt(I1 * (TT * I3 - LL) / (I3 - I1)), mp.sqrt(I2 * (TT * I3 - LL) / (I3 - I2))
    C = mp.sqrt(I3 * (LL - TT * I1) / (I3 - I1))
    lam = mp.sqrt((I3 - I2) * (LL - TT * I1) / (I1 * I2 * I3))
    m = (I2 - I1) * (TT * I3 - LL) / ((I3 - I2) * (LL - TT * I1))
    K, K1 = mp.ellipk(m), mp.ellipk(1 - m)
    q, to_phase = mp.exp(-mp.pi * K1 / K), mp.pi / (2 * K)
    side = mp.sign(I3 - I2)
    B2 = up * side * B  # L2 = B2 sn x, from L1_dot = L2 L3 (1/I3 - 1/I2)
    z0 = to_phase * mp.ellipf(mp.atan2(L[1] / B2, L[0] / A), m)
    eta = to_phase * mp.ellipf(mp.atan(A / mp.sqrt(B**2 - A**2)), 1 - m)
    rate = to_phase * lam
    n = size / I1 - side * rate * mp.im(log_slope(1, mp.mpc(0, -eta), q))
    # sn, cn, dn as quotients of theta1, theta2, theta3 by theta4, scaled to the components of L/|L|
    t2, t3, t4 = (mp.jtheta(j, 0, q) for j in (2, 3, 4))
    series = (
        theta(2, q, scale=A / size * t4 / t2),
        theta(1, q, scale=B2 / size * t3 / t2),
        theta(3, q, scale=up * C / size * t4 / t3),
    )
    under, turning = theta(4, q), theta(1, q, side * eta)
    z0_, rate_, n_ = float(z0), float(rate), float(n)
    to_rate = float(size) / np.array([float(I1), float(I2), float(I3)])

    def relative(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """R from the principal frame to one with Z along L, and L/|L| in the principal frame."""
        zeta = z0_ + rate_ * t
        below = under(zeta)[0].real
        l = np.stack([over(zeta)[0].real / below for over in series], axis=-1)
        l /= np.linalg.norm(l, axis=-1, keepdims=True)
        phi = np.angle(turning(zeta)[0]) + n_ * t
        across = np.stack((l[:, 1], -l[:, 0], np.zeros(len(t))), axis=-1)  # line of nodes: R_X(theta) R_Z(psi)
        across /= np.linalg.norm(across, axis=-1, keepdims=True)
        rows = np.stack((across, np.cross(l, across), l), axis=1)
        return turn_z(phi) @ rows, l

    S = frame_with(R0 @ P @ np.array([float(x / size) for x in L]))
    first = S.T @ R0 @ P @ relative(np.zeros(1))[0][0].T
    S = S @ turn_z(np.arctan2(first[1, 0] - first[0, 1], first[0, 0] + first[1, 1]))

    def attitude(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        R, l = relative(t)
        return S @ R @ P.T, (to_rate * l) @ P.T

    condition = float(1 / mp.sqrt(1 - m) * B / A)
    growth = 4.0 * ROUNDING * (float(rate) + abs(float(n)))
    return PinnedMotion(
        "theta functions (Euler's top)", body, attitude, 64.0 * condition * ROUNDING, condition * growth
    )
