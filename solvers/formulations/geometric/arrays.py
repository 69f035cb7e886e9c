"""What the compiled kernels pass around: named tuples of arrays, and the symbols that stand for them in every kernel.

Equation numbers are the paper's. The suffix 0 is the start t_m of a step, 1 its end t_{m+1}; ``half`` is dt/2.

==================  ==================  ====================================================================  ==========
symbol              shape               meaning                                                               unit
==================  ==================  ====================================================================  ==========
t                   (1,)                time                                                                  s
r, R                (nb, 3) (nb, 3, 3)  position of C in space; rotation, body to space                       m, -
v, Omega            (nb, 6), its 3:     (r_dot in space, Omega in the body frame)                             m/s, rad/s
s, arm, arm_dot     (nj, 2, 3)          joint point from C in the body; in space, R s; its rate               m, m/s
u, u_dot            (nj, 3, 3)          of axis row k the vector fixed in body i; its rate                    -, 1/s
n, n_dot            (nj, 3, 3)          and the one fixed in body j; its rate                                 -, 1/s
a, a_dot            (nj, 3, 3)          u_k x n_k, torque of a unit multiplier of axis row k (or of           -, 1/s
                                        moving row k); its rate
gap, gap_dot        (nj, 3)             of a joint with line rows: point of i less that of j; its rate        m, m/s
f, f_dot            (nj, 3, 3)          force of a unit multiplier of line or moving row k; its rate          -, 1/s
phi, phi_dot        (nrows,)            constraints and their rates, Eq. (12); point, line [m], axis rows [-]
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

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ....harness.mechanics.joints import KINDS, MovingKind
from ....harness.mechanics.system import MultibodySystem
from ....harness.mechanics.user_forces import NUMBERS as NUMBERS_READ
from .moving import ANGLE, DISTANCE, KNIFE, POSITION, ROLLING

NUMBERS = {
    MovingKind.DRIVEN_POSITION: POSITION, MovingKind.DRIVEN_ANGLE: ANGLE, MovingKind.KNIFE_EDGE: KNIFE,
    MovingKind.ROLLING: ROLLING, MovingKind.DRIVEN_DISTANCE: DISTANCE,
}  # fmt: skip


class Model(NamedTuple):
    """A ``MultibodySystem`` for the kernels. Ends are [i, j]; body -1 is the ground.

    A joint here is spherical or revolute, or has line rows, moving rows or axis rows alone: others are split.
    """

    mass: np.ndarray  # (nb,)
    J: np.ndarray  # (nb, 3, 3)
    J_inv: np.ndarray  # (nb, 3, 3) with all inertia that is lent
    coupled: np.ndarray  # (nb, 3, 3) what is to be taken back of it; (0, 3, 3) where nothing is
    gravity: np.ndarray  # (3,)
    body: np.ndarray  # (nj, 2) bodies that a joint connects
    s: np.ndarray  # (nj, 2, 3)
    pins: np.ndarray  # (nj,) 1 for a joint with point rows
    lines: np.ndarray  # (nj,) number of line rows, or of moving rows
    kind: np.ndarray  # (nj,) of moving rows, as in ``moving``; 0: none
    axes: np.ndarray  # (nj,) number of axis rows, behind the point rows
    u: np.ndarray  # (nj, 3, 3) in body i, of each axis row
    n: np.ndarray  # (nj, 3, 3) in body j
    normal: np.ndarray  # (nj, 3, 3) in body j, of each line row
    length: np.ndarray  # (nj,) of a distance, or of a disc's radius, else 0
    motion: np.ndarray  # (nj, 7) the function of time of moving rows
    row: np.ndarray  # (nj + 1,) first row of each joint
    spring_body: np.ndarray  # (ns + nr + nu, 2) of springs, of torsional ones, of user forces
    p: np.ndarray  # (ns, 2, 3) ends of a spring from C, in the body
    stiffness: np.ndarray  # (ns,)
    free_length: np.ndarray  # (ns,)
    damping: np.ndarray  # (ns,)
    torsion_body: np.ndarray  # (nr, 2)
    torsion_u: np.ndarray  # (nr, 3) in body i
    torsion_n: np.ndarray  # (nr, 2, 3) in body j
    torsion_stiffness: np.ndarray  # (nr,)
    torsion_rest: np.ndarray  # (nr,)
    torsion_damping: np.ndarray  # (nr,)
    load_body: np.ndarray  # (nl,)
    load_p: np.ndarray  # (nl, 3)
    load_force: np.ndarray  # (nl, 3)
    load_torque: np.ndarray  # (nl, 3)
    load_follows: np.ndarray  # (nl,) 1: they turn with the body
    load_factor: np.ndarray  # (nl, 7) function of time
    user_body: np.ndarray  # (nu, 2)
    user_law: np.ndarray  # (nu,) addresses of ``mechanics.user_forces.Law.entry``
    user_state: np.ndarray  # (36,) room for what they read
    user_load: np.ndarray  # (4, 3) and write


class Motion(NamedTuple):
    """Pose and velocity of all bodies and what follows from them at one instant."""

    t: np.ndarray
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
    gap: np.ndarray
    gap_dot: np.ndarray
    f: np.ndarray
    f_dot: np.ndarray
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
    parts = np.array(list(_parts(system)), dtype=np.int64).reshape(-1, 4)
    joint, pins, lines, axes = parts.T
    springs = np.stack((system.spring_i, system.spring_j), axis=1).astype(np.int64)
    torsions = np.stack((system.torsion_i, system.torsion_j), axis=1).astype(np.int64)
    users = np.stack((system.user_i, system.user_j), axis=1).astype(np.int64)
    both = np.minimum(np.arange(3), 1)  # rows (u, n_1), (u, n_2), (w, n_2)
    model = Model(
        mass=system.mass,
        J=system.solved_inertia,
        J_inv=np.linalg.inv(system.regular_inertia) if system.nb else np.zeros((0, 3, 3)),
        coupled=system.taken_back if np.any(system.taken_back) else np.zeros((0, 3, 3)),
        gravity=system.gravity,
        body=np.stack((system.joint_i, system.joint_j), axis=1).astype(np.int64)[joint],
        s=np.stack((system.joint_s_i, system.joint_s_j), axis=1)[joint],
        pins=pins,
        lines=lines,
        kind=np.array([NUMBERS.get(KINDS[k], 0) for k in system.joint_sort[joint]], dtype=np.int64),
        axes=axes,
        u=np.stack((system.joint_u, system.joint_u, system.joint_w), axis=1)[joint],
        n=system.joint_n[joint][:, both],
        normal=system.joint_n[joint],
        length=system.joint_length[joint],
        motion=system.joint_motion[joint],
        row=np.concatenate(([0], np.cumsum(3 * pins + lines + axes))).astype(np.int64),
        spring_body=np.concatenate((springs, torsions, users)),
        p=np.stack((system.spring_p_i, system.spring_p_j), axis=1),
        stiffness=system.spring_k,
        free_length=system.spring_d0,
        damping=system.spring_c,
        torsion_body=torsions,
        torsion_u=system.torsion_u,
        torsion_n=system.torsion_n,
        torsion_stiffness=system.torsion_k,
        torsion_rest=system.torsion_rest,
        torsion_damping=system.torsion_c,
        load_body=system.load_i,
        load_p=system.load_p,
        load_force=system.load_force,
        load_torque=system.load_torque,
        load_follows=system.load_follows.astype(np.int64),
        load_factor=system.load_factor,
        user_body=users,
        user_law=np.array([law.entry.address for law in system.user_law], dtype=np.int64),
        user_state=np.zeros(NUMBERS_READ),
        user_load=np.zeros((4, 3)),
    )
    return Model._make(np.array(a, order="C") for a in model)  # one layout, so one compilation for all systems


def _parts(system: MultibodySystem) -> Iterator[tuple[int, int, int, int]]:
    """(joint, 1 with point rows, numbers of line or moving rows and of axis rows) of the joints of the kernels."""
    counts = zip(system.joint_points // 3, system.joint_lines + system.joint_moving, system.joint_axes, strict=True)
    for j, (pins, lines, axes) in enumerate(counts):
        if pins and axes in (0, 2):
            yield j, 1, 0, int(axes)
            continue
        if pins or lines:
            yield j, int(pins), int(lines), 0
        if axes:
            yield j, 0, 0, int(axes)


def empty_motion(model: Model) -> Motion:
    """Room for one instant."""
    nb, nj, nrows = len(model.mass), len(model.body), int(model.row[-1])
    point, axis, row = (nj, 2, 3), (nj, 3, 3), (nrows,)
    shapes = {
        "r": (nb, 3), "R": (nb, 3, 3), "v": (nb, 6), "wrench": (nb, 6), "arm": point, "arm_dot": point, "u": axis,
        "u_dot": axis, "n": axis, "n_dot": axis, "a": axis, "a_dot": axis, "c": (nrows, 2, 6),
        "gap": (nj, 3), "gap_dot": (nj, 3), "f": axis, "f_dot": axis, "t": (1,),
    }  # fmt: skip
    return Motion(**{name: np.zeros(shapes.get(name, row)) for name in Motion._fields})


def empty_step(model: Model) -> Step:
    """Room for a step, of length zero."""
    rows = Rows._make(np.zeros(int(model.row[-1])) for _ in Rows._fields)
    return Step(empty_motion(model), empty_motion(model), rows, 0.0)
