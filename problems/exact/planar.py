"""Describe bars that move in the plane OXY: body x along the bar, body y along OZ.

Their 3-1-3 angles are (angle, pi/2, 0), far from the singularity of that chart.
"""

import numpy as np
from jaxtyping import Float

from ...harness.mechanics import so3
from ...harness.mechanics.state import States
from ...harness.mechanics.system import RigidBody

AXIS = (0.0, 1.0, 0.0)  # OZ in such a body
OZ = (0.0, 0.0, 1.0)


def make_bar_frames(angle: Float[np.ndarray, "*nt nb"]) -> Float[np.ndarray, "*nt nb 3 3"]:
    """Return R of bars at ``angle`` to OX [rad]."""
    turn = np.zeros((*angle.shape, 3))
    turn[..., 2] = angle
    return so3.exp(turn) @ np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def make_planar_states(
    centre: Float[np.ndarray, "nt nb 2"],
    angle: Float[np.ndarray, "nt nb"],
    velocity: Float[np.ndarray, "nt nb 2"],
    rate: Float[np.ndarray, "nt nb"],
) -> States:
    """Return the states of bars in the plane OXY from their centres (X, Y) [m] and velocities [m/s].

    ``angle`` is that of each bar to OX [rad], ``rate`` its derivative [rad/s].
    """
    flat = np.zeros((*angle.shape, 1))
    r, v = (np.concatenate((a, flat), axis=-1) for a in (centre, velocity))
    return States(r, make_bar_frames(angle), v, rate[..., None] * np.array(AXIS))


def make_slender_bar(mass: float, length: float, axial: float, name: str) -> RigidBody:
    """Return a bar with its axis along body x; ``axial`` is its inertia about that axis [kg m2]."""
    across = mass * length**2 / 12.0
    return RigidBody(mass, np.diag([axial, across, across]), name)
