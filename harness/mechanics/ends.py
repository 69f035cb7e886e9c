"""Compute points and directions fixed in bodies or in the ground, in space, for many joints at once."""

import numpy as np

from . import so3
from .state import States
from .system import MultibodySystem


def append_ground(a: np.ndarray, ground: np.ndarray) -> np.ndarray:
    """Append values of the ``ground`` to an array of bodies (nt, nb, ...), last, so that index -1 is the ground."""
    return np.concatenate((a, np.broadcast_to(ground, (len(a), 1, *ground.shape))), axis=1)


def turn_vectors(s: States, body: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return vectors ``x`` (m, 3), fixed in the frames of ``body``, in space (nt, m, 3); -1 is the ground."""
    if not len(body):
        return np.zeros((len(s.r), 0, 3))
    return apply_matrices(append_ground(s.R, np.eye(3))[:, body], x)


def apply_matrices(A: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return A x for matrices A and vectors in the last axis of x."""
    return np.matmul(A, x[..., None])[..., 0]


def find_vector_rates(s: States, body: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the rates in space (nt, m, 3) of vectors ``x`` fixed in the frames of ``body``: R (Omega x x)."""
    if not len(body):
        return np.zeros((len(s.r), 0, 3))
    return turn_vectors(s, body, so3.cross(append_ground(s.Omega, np.zeros(3))[:, body], x))


def find_points(system: MultibodySystem, s: States, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the points of body i and of body j of the ``joints`` with these numbers, in space (nt, m, 3) [m]."""
    r, i, j = append_ground(s.r, np.zeros(3)), system.joint_i[joints], system.joint_j[joints]
    x_i = r[:, i] + turn_vectors(s, i, system.joint_s_i[joints])
    return x_i, r[:, j] + turn_vectors(s, j, system.joint_s_j[joints])


def find_gap_vectors(system: MultibodySystem, s: States, joints: np.ndarray, *, velocity: bool) -> np.ndarray:
    """Return d = x_i - x_j of the ``joints`` with these numbers, or d_dot if ``velocity``, in space (nt, m, 3).

    The unit is m, of rates m/s.
    """
    if not velocity:
        x_i, x_j = find_points(system, s, joints)
        return x_i - x_j
    v, i, j = append_ground(s.v, np.zeros(3)), system.joint_i[joints], system.joint_j[joints]
    moving = v[:, i] + find_vector_rates(s, i, system.joint_s_i[joints])
    return moving - v[:, j] - find_vector_rates(s, j, system.joint_s_j[joints])
