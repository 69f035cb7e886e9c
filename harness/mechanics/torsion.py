"""Torsional springs and dampers: the angle from a direction of j to one of i about an axis of j, and their torque.

    theta = atan2(u . b, u . e),  e = across_j, b = axis x e in j, u = across_i in i
    m = (p u x b - q u x e) / (p^2 + q^2),  p = u . e, q = u . b:   theta_dot = m . (omega_i - omega_j)

The torque on i is -(k (theta - theta_0) + c theta_dot) m, the opposite on j; m is the axis where u is normal to it. The
angle is taken within half a turn of theta_0: beyond it a spring would jump.
"""

import numpy as np
from jaxtyping import Float

from .ends import times, turn_vectors, with_ground
from .state import States
from .system import MultibodySystem


def torsion(
    system: MultibodySystem, s: States
) -> tuple[Float[np.ndarray, "nt m"], Float[np.ndarray, "nt m"], Float[np.ndarray, "nt m 3"]]:
    """theta - theta_0, theta_dot and m of all torsional springs."""
    i, j = system.torsion_i, system.torsion_j
    u = turn_vectors(s, i, system.torsion_u)
    e, b = (turn_vectors(s, j, system.torsion_n[:, k]) for k in range(2))
    p, q = np.sum(u * e, axis=-1), np.sum(u * b, axis=-1)
    m = (p[..., None] * np.cross(u, b) - q[..., None] * np.cross(u, e)) / (p * p + q * q)[..., None]
    omega = with_ground(times(s.R, s.Omega), np.zeros(3))
    angle = np.arctan2(q, p) - system.torsion_rest
    wound = angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi))
    return wound, np.sum(m * (omega[:, i] - omega[:, j]), axis=-1), m
