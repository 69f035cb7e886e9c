"""Turn bodies with a nearly massless axis to principal axes, so that rounding of large inertias does not affect it.

In other frames the small inertia is a difference of large ones: one of 1e-9 of them keeps seven digits, and different
ones at each evaluation. Both routes use the same rotated system, whose data equal the given ones up to one rounding.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from ..mechanics.system import GROUND, MultibodySystem

LIGHT = 1e-5  # share of the largest principal inertia, below which an axis counts as nearly massless
SAME = 1e-15  # share of the largest principal inertia: smaller differences are rounding


def is_light(system: MultibodySystem) -> np.ndarray:
    """Return for each body (nb,) whether its least principal inertia is below ``LIGHT`` times the largest."""
    sizes = np.linalg.eigvalsh(system.regular_inertia)
    out: np.ndarray = sizes[:, 0] < LIGHT * sizes[:, 2]
    return out


def rotate_to_principal_axes(system: MultibodySystem) -> tuple[MultibodySystem, Float[np.ndarray, "nb 3 3"]]:
    """Return the system with the frames of light bodies rotated to principal axes, and these axes in the old frames.

    The axes are columns (nb, 3, 3), the identity for bodies that are not light. Without light bodies the system is
    returned as it is.
    """
    light = is_light(system)
    if not np.any(light):
        return system, np.tile(np.eye(3), (system.nb, 1, 1))
    sizes, axes = np.linalg.eigh(system.regular_inertia)
    axes[:, :, 2] *= np.linalg.det(axes)[:, None]  # right-handed
    equal = sizes[:, 2] - sizes[:, 1] < SAME * sizes[:, 2]
    sizes[equal, 1:] = sizes[equal, 2:]
    inertia = np.where(light[:, None, None], sizes[:, :, None] * np.eye(3), system.regular_inertia)
    axes = np.where(light[:, None, None], axes, np.eye(3))
    with_ground = np.concatenate((axes, np.eye(3)[None]))

    def transform(a: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Return vectors ``a`` (n, ..., 3) transformed to the new frames of the bodies ``ends``; -1 is the ground."""
        return np.einsum("n...a,nab->n...b", a, with_ground[ends])

    own = np.where(system.load_follows, system.load_i, GROUND)
    s = system
    turned = dataclasses.replace(
        s,
        inertia=inertia,
        joint_s_i=transform(s.joint_s_i, s.joint_i),
        joint_s_j=transform(s.joint_s_j, s.joint_j),
        joint_u=transform(s.joint_u, s.joint_i),
        joint_w=transform(s.joint_w, s.joint_i),
        joint_n=transform(s.joint_n, s.joint_j),
        spring_p_i=transform(s.spring_p_i, s.spring_i),
        spring_p_j=transform(s.spring_p_j, s.spring_j),
        torsion_u=transform(s.torsion_u, s.torsion_i),
        torsion_n=transform(s.torsion_n, s.torsion_j),
        load_p=transform(s.load_p, s.load_i),
        load_force=transform(s.load_force, own),
        load_torque=transform(s.load_torque, own),
    )
    return turned, axes
