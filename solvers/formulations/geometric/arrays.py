"""The arrays that the compiled kernels pass around, as named tuples (numba reads their fields by name)."""

from typing import NamedTuple

import numpy as np

from ....harness.mechanics.system import MultibodySystem


class Model(NamedTuple):
    """A ``MultibodySystem`` for the kernels. A joint's ends are [i, j]; body -1 is the ground."""

    mass: np.ndarray  # (nb,)
    J: np.ndarray  # (nb, 3, 3)
    J_inv: np.ndarray  # (nb, 3, 3)
    gravity: np.ndarray  # (3,)
    end: np.ndarray  # (nj, 2) bodies
    s: np.ndarray  # (nj, 2, 3) points
    hinged: np.ndarray  # (nj,) 1 for a revolute joint
    u: np.ndarray  # (nj, 3) axis in i
    n: np.ndarray  # (nj, 2, 3) normals in j
    row: np.ndarray  # (nj + 1,) first row of each joint
    spring_end: np.ndarray  # (ns, 2)
    p: np.ndarray  # (ns, 2, 3)
    k: np.ndarray  # (ns,)
    d0: np.ndarray
    c: np.ndarray


class Motion(NamedTuple):
    """Pose and velocity of all bodies and what follows from them at one instant."""

    r: np.ndarray  # (nb, 3)
    R: np.ndarray  # (nb, 3, 3)
    v: np.ndarray  # (nb, 6): r_dot [space], Omega [body]
    arm: np.ndarray  # (nj, 2, 3): R s, space (for the ground the point itself)
    arm_dot: np.ndarray  # (nj, 2, 3)
    u: np.ndarray  # (nj, 3) axis in space
    u_dot: np.ndarray
    n: np.ndarray  # (nj, 2, 3) normals in space
    n_dot: np.ndarray
    phi: np.ndarray  # (nrows,)
    phi_dot: np.ndarray
    force: np.ndarray  # (nb, 6): applied force [space], torque about C [space]
    c: np.ndarray  # (nrows, 2, 6): direction c_R of Eq. (30) on both ends (translation space, rotation body)
    m_bar: np.ndarray  # (nrows,) Eq. (30)
    f_bar: np.ndarray
    c_bar: np.ndarray  # (nrows,) Eq. (32)
    k_bar: np.ndarray


def model_of(system: MultibodySystem) -> Model:
    """The kernels' arrays of a system."""
    return Model(
        mass=np.array(system.mass),
        J=np.array(system.inertia),
        J_inv=np.linalg.inv(system.inertia).copy() if system.nb else np.zeros((0, 3, 3)),
        gravity=np.array(system.gravity),
        end=np.stack((system.joint_i, system.joint_j), axis=1).astype(np.int64),
        s=np.stack((system.joint_s_i, system.joint_s_j), axis=1).copy(),
        hinged=system.joint_revolute.astype(np.int64),
        u=np.array(system.joint_u),
        n=np.array(system.joint_n),
        row=system.row_start.copy(),
        spring_end=np.stack((system.spring_i, system.spring_j), axis=1).astype(np.int64),
        p=np.stack((system.spring_p_i, system.spring_p_j), axis=1).copy(),
        k=np.array(system.spring_k),
        d0=np.array(system.spring_d0),
        c=np.array(system.spring_c),
    )


def empty_motion(model: Model) -> Motion:
    """Room for one instant."""
    nb, nj, nr = len(model.mass), len(model.end), int(model.row[-1])
    return Motion(
        r=np.zeros((nb, 3)), R=np.zeros((nb, 3, 3)), v=np.zeros((nb, 6)), arm=np.zeros((nj, 2, 3)),
        arm_dot=np.zeros((nj, 2, 3)), u=np.zeros((nj, 3)), u_dot=np.zeros((nj, 3)), n=np.zeros((nj, 2, 3)),
        n_dot=np.zeros((nj, 2, 3)), phi=np.zeros(nr), phi_dot=np.zeros(nr), force=np.zeros((nb, 6)),
        c=np.zeros((nr, 2, 6)), m_bar=np.zeros(nr), f_bar=np.zeros(nr), c_bar=np.zeros(nr), k_bar=np.zeros(nr),
    )  # fmt: skip
