"""Points and directions fixed in bodies or in the ground, in space, of many joints at once."""

import numpy as np

from . import so3
from .state import States
from .system import MultibodySystem


def with_ground(a: np.ndarray, ground: np.ndarray) -> np.ndarray:
    """``a`` with the ground as its last body, where index -1 finds it."""
    return np.concatenate((a, np.broadcast_to(ground, (len(a), 1, *ground.shape))), axis=1)


def turn_vectors(s: States, body: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Vectors ``x`` (m, 3) fixed in bodies, in space (nt, m, 3)."""
    if not len(body):
        return np.zeros((len(s.r), 0, 3))
    return times(with_ground(s.R, np.eye(3))[:, body], x)


def times(A: np.ndarray, x: np.ndarray) -> np.ndarray:
    """A x of vectors in the last axis."""
    return np.matmul(A, x[..., None])[..., 0]


def turn_rates(s: States, body: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Their rates."""
    if not len(body):
        return np.zeros((len(s.r), 0, 3))
    return turn_vectors(s, body, so3.cross(with_ground(s.Omega, np.zeros(3))[:, body], x))


def points(system: MultibodySystem, s: States, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points of i and of j in space (nt, m, 3)."""
    r, i, j = with_ground(s.r, np.zeros(3)), system.joint_i[joints], system.joint_j[joints]
    x_i = r[:, i] + turn_vectors(s, i, system.joint_s_i[joints])
    return x_i, r[:, j] + turn_vectors(s, j, system.joint_s_j[joints])


def gaps(system: MultibodySystem, s: States, joints: np.ndarray, *, velocity: bool) -> np.ndarray:
    """d or its rate (nt, m, 3)."""
    if not velocity:
        x_i, x_j = points(system, s, joints)
        return x_i - x_j
    v, i, j = with_ground(s.v, np.zeros(3)), system.joint_i[joints], system.joint_j[joints]
    moving = v[:, i] + turn_rates(s, i, system.joint_s_i[joints])
    return moving - v[:, j] - turn_rates(s, j, system.joint_s_j[joints])
