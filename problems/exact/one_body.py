"""The exact motion of one body on one pin, whichever of the integrable cases it is."""

import numpy as np

from ...harness.mechanics.state import State
from ...harness.mechanics.system import MultibodySystem
from .euler_top import euler_top
from .lagrange_top import lagrange_top
from .pinned import PinnedBody, PinnedMotion


def one_body_motion(system: MultibodySystem, start: State) -> PinnedMotion | None:
    """Euler's case without torque, Lagrange's for a symmetric body; None for any other system: no formula exists."""
    body = PinnedBody.of(system)
    if body is None:
        return None
    if not np.any(body.arm) or not np.any(body.gravity):
        return euler_top(body, start)
    return lagrange_top(body, start)
