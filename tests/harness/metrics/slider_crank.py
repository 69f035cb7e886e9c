"""A slider-crank whose slider is guided by a long rocker: a small motion in a large geometry.

Crank 0.2 m about O, rod 0.5 m, slider on a weightless rocker. It starts with the crank upright and the rod in
translation. Revolute joints at O and at the rocker's pivot, spherical ones at the rod: the rod's roll is free.
"""

import numpy as np

from mbsbench import Problem, State, States
from mbsbench.harness.mechanics.system import GROUND, Joint, MultibodySystem, RigidBody, assemble

CRANK, ROD = 0.2, 0.5  # [m]
Z = (0.0, 0.0, 1.0)
BALLAST = RigidBody(1e4, np.eye(3) * 4e3, "ballast")


def slider_crank(rocker: float = 20.0, rate: float = 3.0, t_end: float = 3.0) -> Problem:
    """Three bodies of 1 kg; ``rate`` [rad/s] of the crank at the start."""
    bar = [np.diag([1e-4, n**2 / 12.0, n**2 / 12.0]) for n in (CRANK, ROD)]
    bodies = [
        RigidBody(1.0, bar[0], "crank"),
        RigidBody(1.0, bar[1], "rod"),
        RigidBody(1.0, np.eye(3) * 1e-3, "slider"),
    ]
    x = np.sqrt(ROD**2 - CRANK**2)
    joints = [
        Joint(0, (-CRANK / 2, 0, 0), GROUND, (0, 0, 0), Z, Z), Joint(0, (CRANK / 2, 0, 0), 1, (-ROD / 2, 0, 0)),
        Joint(1, (ROD / 2, 0, 0), 2, (0, 0, 0)), Joint(2, (0, rocker, 0), GROUND, (x, rocker, 0), Z, Z),
    ]  # fmt: skip
    system = assemble(bodies, joints, (0.0, -9.81, 0.0))
    u = -CRANK * rate
    r = np.array([[0, CRANK / 2, 0], [x / 2, CRANK / 2, 0], [x, 0, 0]])
    R = np.array([_about_z(np.pi / 2), _about_z(-np.arcsin(CRANK / ROD)), np.eye(3)])
    v, Omega = np.array([[u / 2, 0, 0], [u, 0, 0], [u, 0, 0]]), np.array([[0, 0, rate], [0, 0, 0], [0, 0, u / rocker]])
    return Problem("slider_crank", system, State(r, R, v, Omega), t_end, 1e-3, "", "made up")


def with_ballast(system: MultibodySystem, s: States) -> tuple[MultibodySystem, States]:
    """The same motion beside a body of ten tonnes welded to the ground, 50 m away."""
    bodies = [*(RigidBody(m, J) for m, J in zip(system.mass, system.inertia, strict=True)), BALLAST]
    joints: list[Joint] = [
        Joint(int(i), si, int(j), sj, *((None, None) if not hinged else (u, np.cross(*n))))
        for i, si, j, sj, hinged, u, n in zip(
            system.joint_i, system.joint_s_i, system.joint_j, system.joint_s_j, system.joint_revolute, system.joint_u,
            system.joint_n[:, :2], strict=True,
        )
    ]  # fmt: skip
    place, k = np.array([50.0, 30.0, 0.0]), len(bodies) - 1
    joints += [Joint(k, (0, 0, 0), GROUND, place, a, a) for a in (Z, (1.0, 0.0, 0.0))]

    def beside(a: np.ndarray, one: np.ndarray) -> np.ndarray:
        return np.concatenate((a, np.broadcast_to(one, (len(a), 1, *one.shape))), axis=1)

    rest = np.zeros(3)
    moved = States(beside(s.r, place), beside(s.R, np.eye(3)), beside(s.v, rest), beside(s.Omega, rest))
    return assemble(bodies, joints, system.gravity), moved


def _about_z(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
