"""Mechanisms without an exact motion, as a plugin would define them."""

import numpy as np

from mbsbench import Problem, State, so3
from mbsbench.harness.mechanics.consistency import project
from mbsbench.harness.mechanics.system import GROUND, Joint, RigidBody, SpringDamper, assemble

Z = (0.0, 0.0, 1.0)


def slider_crank(t_end: float = 1.0) -> Problem:
    """Crank 0.2 m, rod 0.5 m, its end guided by a rocker of 20 m: four revolute joints, 20 rows of rank 17."""
    crank, rod, rocker = 0.2, 0.5, 20.0
    angle, end = 0.6, 0.0
    tip = crank * np.array([np.cos(angle), np.sin(angle), 0.0])
    end = np.array([tip[0] + np.sqrt(rod**2 - tip[1] ** 2), 0.0, 0.0])
    above = end + np.array([0.0, rocker, 0.0])

    def bar(mass: float, length: float) -> RigidBody:
        return RigidBody(mass, np.diag([1e-4, 1.0, 1.0]) * mass * length**2 / 12.0 + np.eye(3) * 1e-4)

    def along(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return so3.exp(np.array([0.0, 0.0, np.arctan2(b[1] - a[1], b[0] - a[0])]))

    joints = [
        Joint(0, (-crank / 2, 0.0, 0.0), GROUND, (0.0, 0.0, 0.0), Z, Z),
        Joint(1, (-rod / 2, 0.0, 0.0), 0, (crank / 2, 0.0, 0.0), Z, Z),
        Joint(2, (-rocker / 2, 0.0, 0.0), 1, (rod / 2, 0.0, 0.0), Z, Z),
        Joint(2, (rocker / 2, 0.0, 0.0), GROUND, tuple(above), Z, Z),
    ]
    system = assemble([bar(1.0, crank), bar(2.0, rod), bar(0.1, rocker)], joints, (0.0, -9.81, 0.0))
    r = np.array([tip / 2, (tip + end) / 2, (end + above) / 2])
    R = np.array([along(0 * tip, tip), along(tip, end), along(end, above)])
    rest = np.zeros((3, 3))
    return problem("slider_crank", system, project(system, State(r, R, rest, rest)), t_end)


def sprung(damping: float, t_end: float = 1.0) -> Problem:
    """Two bodies of unequal inertias, one on a skew hinge, tied to each other and to the ground by springs."""
    bodies = [RigidBody(1.0, np.diag([0.02, 0.05, 0.06])), RigidBody(0.7, np.diag([0.03, 0.01, 0.025]))]
    axis = np.array([0.3, 0.5, 0.8])
    joints = [Joint(0, (-0.3, 0.0, 0.1), GROUND, (0.0, 0.0, 0.0), axis, axis)]
    springs = [
        SpringDamper(0, (0.3, 0.1, 0.0), 1, (-0.1, 0.05, 0.02), stiffness=40.0, rest_length=0.3, damping=damping),
        SpringDamper(1, (0.1, 0.0, 0.0), GROUND, (0.4, 0.9, 0.2), stiffness=60.0, rest_length=0.4, damping=damping),
    ]
    system = assemble(bodies, joints, (0.0, -9.81, 0.0), springs)
    start = State(
        np.array([[0.3, 0.0, -0.1], [0.9, 0.2, 0.0]]), np.stack([np.eye(3)] * 2),
        np.array([[0.0, 0.0, 0.0], [0.3, -0.2, 0.5]]), np.array([[0.0, 0.0, 0.0], [3.0, 4.0, -5.0]]),
    )  # fmt: skip
    return problem("sprung", system, start, t_end)


def problem(name: str, system, start: State, t_end: float) -> Problem:
    return Problem(name, system, start, t_end, 1e-3, "", "test")
