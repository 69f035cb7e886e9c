"""Mechanisms without an exact motion, as a plugin would define them."""

import numpy as np

from mbsbench import Problem, State, States, so3
from mbsbench.harness.mechanics.system import GROUND, Joint, RigidBody, SpringDamper, assemble

Z = (0.0, 0.0, 1.0)
CRANK, ROD = 0.2, 0.5  # [m]
BALLAST_AT = np.array([50.0, 30.0, 0.0])


def slider_crank(
    rocker: float = 20.0, rate: float = 3.0, t_end: float = 3.0, *, hinged: bool = False, ballast: bool = False
) -> Problem:
    """A small motion in a large geometry: crank about O, rod, and a slider that a long weightless rocker guides.

    It starts with the crank upright, at ``rate`` [rad/s], and the rod in translation. Revolute joints at O and at the
    rocker's pivot, spherical ones at the rod, whose roll is free; hinged, four revolute ones: 20 rows of rank 17.
    The ballast is a fourth body, of ten tonnes, which two joints weld to the ground.
    """
    bar = [np.diag([1e-4, n**2 / 12.0, n**2 / 12.0]) for n in (CRANK, ROD)]
    inertias = {"crank": bar[0], "rod": bar[1], "slider": np.eye(3) * 1e-3}
    bodies, pin = [RigidBody(1.0, J, name) for name, J in inertias.items()], (Z, Z) if hinged else ()
    x = np.sqrt(ROD**2 - CRANK**2)
    joints = [
        Joint(0, (-CRANK / 2, 0, 0), GROUND, (0, 0, 0), Z, Z), Joint(0, (CRANK / 2, 0, 0), 1, (-ROD / 2, 0, 0), *pin),
        Joint(1, (ROD / 2, 0, 0), 2, (0, 0, 0), *pin), Joint(2, (0, rocker, 0), GROUND, (x, rocker, 0), Z, Z),
    ]  # fmt: skip
    if ballast:
        bodies.append(RigidBody(1e4, np.eye(3) * 4e3, "ballast"))
        joints += [Joint(3, (0, 0, 0), GROUND, BALLAST_AT, a, a) for a in (Z, (1.0, 0.0, 0.0))]
    system = assemble(bodies, joints, (0.0, -9.81, 0.0))
    u = -CRANK * rate
    r = np.array([[0, CRANK / 2, 0], [x / 2, CRANK / 2, 0], [x, 0, 0]])
    R = so3.exp(np.outer((np.pi / 2, -np.arcsin(CRANK / ROD), 0.0), Z))
    v, Omega = np.array([[u / 2, 0, 0], [u, 0, 0], [u, 0, 0]]), np.array([[0, 0, rate], [0, 0, 0], [0, 0, u / rocker]])
    start = State(r, R, v, Omega)
    start = beside_ballast(States.one(start))[0] if ballast else start
    return Problem("slider_crank", system, start, t_end, 1e-3, "", "made up")


def beside_ballast(s: States) -> States:
    """The same motion of three bodies beside the ballast."""
    still = zip((s.r, s.R, s.v, s.Omega), (BALLAST_AT, np.eye(3), np.zeros(3), np.zeros(3)), strict=True)
    return States(*(np.concatenate((a, np.broadcast_to(x, (len(a), 1, *x.shape))), axis=1) for a, x in still))


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
