"""Systems without symmetry, and states far from any special one, for tests of formulas."""

import numpy as np
from jaxtyping import Float

from mbsbench import Joint, MultibodySystem, RigidBody, SpringDamper, State, UserForce, assemble, so3
from mbsbench.harness.mechanics.consistency import project

Rows = Float[np.ndarray, "2 ..."]
SPRINGS = (
    SpringDamper(0, (0.2, 0.1, -0.1), 2, (0.0, 0.3, 0.1), stiffness=30.0, rest_length=0.4, damping=2.0),
    SpringDamper(1, (-0.1, 0.2, 0.0), stiffness=12.0, rest_length=0.2, damping=0.7, p_j=(1.0, 2.0, -1.0)),
)


def linkage(*, springs: bool) -> MultibodySystem:
    """Ground - spherical - body 0 - revolute - body 1 - spherical - body 2 - revolute - ground."""
    random = np.random.default_rng(7)
    bodies = []
    for mass in (1.3, 0.7, 2.1):
        Q = so3.exp(random.standard_normal(3))
        bodies.append(RigidBody(mass, Q @ np.diag([0.04, 0.07, 0.09]) @ Q.T))
    joints = [
        Joint(0, (0.3, 0.1, 0.0), s_j=(0.1, -0.2, 0.3)),
        Joint(1, (0.2, 0.0, -0.3), 0, (-0.4, 0.1, 0.2), axis_i=(1.0, 2.0, 3.0), axis_j=(0.5, -1.0, 0.2)),
        Joint(2, (0.1, 0.2, 0.3), 1, (-0.3, 0.2, 0.0)),
        Joint(2, (-0.2, 0.0, 0.1), s_j=(0.4, 0.5, -0.6), axis_i=(0.0, 1.0, 1.0), axis_j=(1.0, 0.2, 0.0)),
    ]
    return assemble(bodies, joints, (1.1, -2.3, -9.5), SPRINGS if springs else ())


def law(t: float, r: Rows, R: Rows, v: Rows, Omega: Rows, F: Rows, T: Rows) -> None:
    """A user's law: all arguments, no symmetry, no action = reaction."""
    for a in range(3):
        F[0, a] = -3.0 * r[0, 0] * (r[0, a] - r[1, a]) - 0.4 * v[0, a] * v[1, a] + np.sin(2.0 * t + a)
        F[1, a] = 2.0 * R[0, a, 0] - v[1, a]
        T[0, a] = -0.2 * Omega[0, a] + 0.3 * R[1, a, 2] * np.cos(t)
        T[1, a] = 0.5 * Omega[0, a] * Omega[1, 0] - 0.1 * R[1, a, 0] * R[0, 2, a]


def with_user_forces() -> MultibodySystem:
    """The law between two bodies, and between one and the ground."""
    joints = [Joint(0, (0.3, 0.1, 0.0), s_j=(0.1, -0.2, 0.3)), Joint(1, (0.1, 0.2, 0.3), 0, (-0.3, 0.2, 0.0))]
    bodies = [RigidBody(1.3, np.diag([0.04, 0.07, 0.09])), RigidBody(0.7, np.diag([0.03, 0.05, 0.06]))]
    return assemble(bodies, joints, (1.1, -2.3, -9.5), user_forces=[UserForce(law, 0, 1), UserForce(law, 1)])


def arbitrary(system: MultibodySystem, seed: int) -> State:
    """Poses and velocities of order one; the constraints do not hold."""
    random = np.random.default_rng(seed)
    nb = system.nb
    v = random.standard_normal((2, nb, 3))
    return State(random.standard_normal((nb, 3)), so3.exp(random.standard_normal((nb, 3))), v[0], v[1])


def consistent(system: MultibodySystem, seed: int) -> State:
    """An arbitrary state projected onto phi = phi_dot = 0."""
    return project(system, arbitrary(system, seed), iterations=200)  # from far away some seeds take a hundred
