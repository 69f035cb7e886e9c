"""Steady precession: the body rotates uniformly about a fixed direction of space and about a body-fixed axis.

    R(t) = Rot_k(p t) R(0) Rot_e(s t)

This is the exact motion of any symmetric body without torque (k along the angular momentum), of a body turning about a
principal axis, and of a top whose axis rests or keeps its height.
"""

from flint import arb

from .balls import Matrix, Vector, frame_about
from .cayley_klein import even_turns, relative_quaternion
from .pinned_body import PinnedBody, PinnedMotion, Rounded


def steady_precession(
    body: PinnedBody, R0: Matrix, k: Vector, precession: arb, e: Vector, spin: arb, rounded: Rounded
) -> PinnedMotion:
    """Precession [rad/s] about ``k`` (space) and spin [rad/s] about ``e`` (body)."""
    S, B = frame_about(k), frame_about(e)
    motion = even_turns(relative_quaternion(S, R0, B), S, B, (precession + spin) / 2, (precession - spin) / 2)
    return PinnedMotion("closed form: steady precession", body, motion, rounded)
