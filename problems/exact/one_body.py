"""Compute the exact motion of one body on one pin, for each integrable case."""

import numpy as np

from ...harness.mechanics.state import State
from ...harness.mechanics.system import MultibodySystem
from .balls import BallTooWide, Matrix, Vector, find_nearest_rotation, run_in_balls, to_balls
from .euler_top import solve_euler_top
from .lagrange_top import solve_lagrange_top
from .pinned_body import PinnedBody, PinnedMotion


@run_in_balls
def find_one_body_motion(system: MultibodySystem, start: State) -> PinnedMotion | None:
    """Return the exact motion of one body on a spherical joint to the ground, from ``start``.

    It is known in Euler's case, without torque, and in Lagrange's, for a symmetric body. Return None in any other case
    and for any other system.
    """
    body = PinnedBody.from_system(system)
    return (
        None if body is None else find_pinned_motion(body, find_nearest_rotation(start.R[0]), to_balls(start.Omega[0]))
    )


def find_pinned_motion(body: PinnedBody, R0: Matrix, Omega0: Vector) -> PinnedMotion | None:
    """Return the exact motion of a pinned body from R0 and Omega0 [rad/s, body], in balls; None without a formula."""
    try:
        if not np.any(body.arm) or not np.any(body.gravity):
            return solve_euler_top(body, R0, Omega0)
        return solve_lagrange_top(body, R0, Omega0)
    except BallTooWide:
        return None
