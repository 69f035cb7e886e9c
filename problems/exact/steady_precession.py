"""Steady precession: the body rotates uniformly about a fixed direction of space and about a body-fixed axis.

    R(t) = Rot_k(p t) R(0) Rot_e(s t)

This is the exact motion of any symmetric body without torque (k along the angular momentum), of a body turning about a
principal axis, and of a top whose axis rests or keeps its height.
"""

import numpy as np
from jaxtyping import Float

from .pinned import ROUNDING, PinnedBody, PinnedMotion, frame_with, turn_z


def steady_precession(
    body: PinnedBody,
    R0: Float[np.ndarray, "3 3"],
    k: Float[np.ndarray, " 3"],
    precession: float,
    e: Float[np.ndarray, " 3"],
    spin: float,
) -> PinnedMotion:
    """Precession [rad/s] about ``k`` (space) and spin [rad/s] about ``e`` (body)."""
    S, B = frame_with(k), frame_with(e)
    R0 = S.T @ R0 @ B

    def attitude(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        R = turn_z(precession * t) @ R0 @ turn_z(spin * t)
        Omega = precession * R[:, 2] + spin * np.array([0.0, 0.0, 1.0])
        return S @ R @ B.T, Omega @ B.T

    growth = 4.0 * ROUNDING * (abs(precession) + abs(spin))
    return PinnedMotion("closed form: steady precession", body, attitude, 16.0 * ROUNDING, growth)
