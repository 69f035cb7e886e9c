"""The exact motion of one body on one pin, whichever of the integrable cases it is."""

import numpy as np

from ...harness.mechanics.state import State
from ...harness.mechanics.system import MultibodySystem
from .balls import Matrix, TooWide, Vector, in_balls, nearest_rotation, vector
from .euler_top import euler_top
from .lagrange_top import lagrange_top
from .pinned_body import PinnedBody, PinnedMotion


@in_balls
def one_body_motion(system: MultibodySystem, start: State) -> PinnedMotion | None:
    """Euler's case without torque, Lagrange's for a symmetric body; None for any other system: no formula exists."""
    body = PinnedBody.of(system)
    return None if body is None else pinned_motion(body, nearest_rotation(start.R[0]), vector(start.Omega[0]))


def pinned_motion(body: PinnedBody, R0: Matrix, Omega0: Vector) -> PinnedMotion | None:
    """From a start in balls."""
    try:
        if not np.any(body.arm) or not np.any(body.gravity):
            return euler_top(body, R0, Omega0)
        return lagrange_top(body, R0, Omega0)
    except TooWide:
        return None
