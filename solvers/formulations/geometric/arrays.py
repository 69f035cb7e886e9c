"""What the compiled kernels pass around: named tuples of arrays, and the symbols that stand for them in every kernel.

Equation numbers are the paper's. The suffix 0 is the start t_m of a step, 1 its end t_{m+1}; ``half`` is dt/2.

==================  ==================  ====================================================================  ==========
symbol              shape               meaning                                                               unit
==================  ==================  ====================================================================  ==========
r, R                (nb, 3) (nb, 3, 3)  position of C in space; rotation, body to space                       m, -
v, Omega            (nb, 6), its 3:     (r_dot in space, Omega in the body frame)                             m/s, rad/s
s, arm, arm_dot     (nj, 2, 3)          joint point from C in the body; in space, R s; its rate               m, m/s
u, u_dot            (nj, 3)             axis of a revolute joint (fixed in body i); its rate                  -, 1/s
n, n_dot            (nj, 2, 3)          its normals (fixed in body j); their rates                            -, 1/s
a, a_dot            (nj, 2, 3)          u x n_k, torque of a unit multiplier of axis row k; its rate          -, 1/s
phi, phi_dot        (nrows,)            constraints and their rates, Eq. (12): point rows [m], axis rows [-]
wrench              (nb, 6)             applied force, and torque about C, in space: f of Eq. (71)            N, N m
c                   (nrows, 2, 6)       c_R of Eq. (31) on both ends (translation space, rotation body)
m_bar, f_bar        (nrows,)            Eq. (30)
c_bar, k_bar        (nrows,)            Eq. (32)
mu, lam             (nrows,)            multipliers and their integral, Eqs. (53), (67)
nu                  (nrows,)            M_bar mu; its increments are impulses of the reactions                N s
sigma               (nrows,)            M_bar phi_dot, Eq. (62)
G                   (nrows,)            C_bar mu + K_bar lam - f_bar, of Eq. (71)                             N
B                   scalar              dt/2, the factor of D_dot nu (B of Eq. 71); 0 where it is left out    s
R_v, R_mu           (nb, 6) (nrows,)    residuals of Eq. (74), and of Eq. (75) over M_bar
theta               (3,)                change of a pose: dR1 = R1 hat(theta), theta = T dOmega1              rad
T                   (nb, 3, 3)          dt/2 dexp(dt/2 (Omega0 + Omega1))                                     s
blocks              (npairs, 6, 6)      Jacobian of Eq. (79), the saddle
xi                  (1,)                penalty, Eq. (84)
==================  ==================  ====================================================================  ==========

Indices: body ``b``, joint ``j``, its end ``e`` (0: body i, sign +; 1: body j, sign -), ``k`` its row or a component.
"""

from typing import NamedTuple

import numpy as np

from ....harness.mechanics.system import MultibodySystem


class Model(NamedTuple):
    """A ``MultibodySystem`` for the kernels. Ends are [i, j]; body -1 is the ground."""

    mass: np.ndarray  # (nb,)
    J: np.ndarray  # (nb, 3, 3)
    J_inv: np.ndarray  # (nb, 3, 3)
    gravity: np.ndarray  # (3,)
    body: np.ndarray  # (nj, 2) bodies that a joint connects
    s: np.ndarray  # (nj, 2, 3)
    hinged: np.ndarray  # (nj,) 1 for a revolute joint
    u: np.ndarray  # (nj, 3) in body i
    n: np.ndarray  # (nj, 2, 3) in body j
    row: np.ndarray  # (nj + 1,) first row of each joint
    spring_body: np.ndarray  # (ns, 2)
    p: np.ndarray  # (ns, 2, 3) ends of a spring from C, in the body
    stiffness: np.ndarray  # (ns,)
    free_length: np.ndarray  # (ns,)
    damping: np.ndarray  # (ns,)


class Motion(NamedTuple):
    """Pose and velocity of all bodies and what follows from them at one instant."""

    r: np.ndarray
    R: np.ndarray
    v: np.ndarray
    arm: np.ndarray
    arm_dot: np.ndarray
    u: np.ndarray
    u_dot: np.ndarray
    n: np.ndarray
    n_dot: np.ndarray
    a: np.ndarray
    a_dot: np.ndarray
    phi: np.ndarray
    phi_dot: np.ndarray
    wrench: np.ndarray
    c: np.ndarray
    m_bar: np.ndarray
    f_bar: np.ndarray
    c_bar: np.ndarray
    k_bar: np.ndarray


class Rows(NamedTuple):
    """Multipliers of all constraint rows: the unknown nu1, and what the step starts from."""

    nu1: np.ndarray
    nu_start: np.ndarray  # nu0 = gauge nu1 + nu_start
    lam0: np.ndarray
    mu0: np.ndarray
    sigma0: np.ndarray
    G0: np.ndarray
    G1: np.ndarray
    dG: np.ndarray  # dG1/dnu1
    on_rate: np.ndarray  # factor of phi_dot1 in R_mu
    on_phi: np.ndarray  # factor of phi1 in R_mu


class Step(NamedTuple):
    """One step: the motion at its start, the estimate of its end, the multipliers, and its length [s]."""

    start: Motion
    end: Motion
    rows: Rows
    dt: float


def model_of(system: MultibodySystem) -> Model:
    """The kernels' arrays of a system."""
    return Model(
        mass=np.array(system.mass),
        J=np.array(system.inertia),
        J_inv=np.linalg.inv(system.inertia).copy() if system.nb else np.zeros((0, 3, 3)),
        gravity=np.array(system.gravity),
        body=np.stack((system.joint_i, system.joint_j), axis=1).astype(np.int64),
        s=np.stack((system.joint_s_i, system.joint_s_j), axis=1).copy(),
        hinged=system.joint_revolute.astype(np.int64),
        u=np.array(system.joint_u),
        n=np.array(system.joint_n),
        row=system.row_start.copy(),
        spring_body=np.stack((system.spring_i, system.spring_j), axis=1).astype(np.int64),
        p=np.stack((system.spring_p_i, system.spring_p_j), axis=1).copy(),
        stiffness=np.array(system.spring_k),
        free_length=np.array(system.spring_d0),
        damping=np.array(system.spring_c),
    )


def empty_motion(model: Model) -> Motion:
    """Room for one instant."""
    nb, nj, nrows = len(model.mass), len(model.body), int(model.row[-1])
    point, axis, row = (nj, 2, 3), (nj, 3), (nrows,)
    shapes = {
        "r": (nb, 3), "R": (nb, 3, 3), "v": (nb, 6), "wrench": (nb, 6), "arm": point, "arm_dot": point, "u": axis,
        "u_dot": axis, "n": point, "n_dot": point, "a": point, "a_dot": point, "c": (nrows, 2, 6),
    }  # fmt: skip
    return Motion(**{name: np.zeros(shapes.get(name, row)) for name in Motion._fields})


def empty_step(model: Model) -> Step:
    """Room for a step, of length zero."""
    rows = Rows._make(np.zeros(int(model.row[-1])) for _ in Rows._fields)
    return Step(empty_motion(model), empty_motion(model), rows, 0.0)
