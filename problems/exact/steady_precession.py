"""Compute steady precession: uniform rotation about a direction fixed in space and about an axis fixed in the body.

    R(t) = Rot_k(p t) R(0) Rot_e(s t)

This is the exact motion of any symmetric body without torque (k along the angular momentum), of a body turning about a
principal axis, and of a top whose axis rests or keeps its height.
"""

from flint import arb

from .balls import Matrix, Vector, make_frame_about
from .cayley_klein import relative_quaternion, rotate_uniformly
from .pinned_body import PinnedBody, PinnedMotion, RoundingEffect


def find_steady_precession(
    body: PinnedBody, R0: Matrix, k: Vector, precession: arb, e: Vector, spin: arb, rounded: RoundingEffect
) -> PinnedMotion:
    """Return the motion from R0 that turns about ``k`` at ``precession`` [rad/s] and about ``e`` at ``spin`` [rad/s].

    ``k`` is a direction fixed in space, ``e`` one fixed in the body, of any length; ``rounded`` is the effect of
    rounded data on the attitude.
    """
    S, B = make_frame_about(k), make_frame_about(e)
    motion = rotate_uniformly(relative_quaternion(S, R0, B), S, B, (precession + spin) / 2, (precession - spin) / 2)
    return PinnedMotion("closed form: steady precession", body, motion, rounded)
