"""Systems without symmetry, and states far from any special one, for tests of formulas."""

from dataclasses import replace

import numpy as np
import pytest
from jaxtyping import Float

from mbsbench import Joint, MultibodySystem, RigidBody, SpringDamper, State, States, UserForce, assemble, so3
from mbsbench.harness.mechanics import motion
from mbsbench.harness.mechanics.consistency import project
from mbsbench.harness.mechanics.index1 import solve_index_1
from mbsbench.harness.mechanics.jacobian import constraint_jacobian

Rows = Float[np.ndarray, "2 ..."]
STRIDE, MANY = 0.1, 500  # [m, rad] of a step, about a tenth of an arm or of a turn; the longest ways take 60
NEAR = 1e-6  # [m]: from here each full step squares what is left
ROUNDED = 20 * np.finfo(float).eps  # of the size of a row: of either body r and nine products of R s, each rounded
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


def consistent(system: MultibodySystem, seed: int, t: float = 0.0) -> State:
    """An arbitrary state moved onto phi = phi_dot = 0 at time ``t``."""
    return settle(system, replace(arbitrary(system, seed), t=t))


def settle(system: MultibodySystem, s: State) -> State:
    """A consistent state that depends on ``s`` alone, not on rounding: by short steps of least change, then projected.

    Full steps of Newton's method from far away go where rounding sends them: to other solutions, kilometres away, or to
    none. Short ones follow the curve along which phi falls exponentially, and rounding moves them by as much as ``s``.
    """
    r, R = s.r.copy(), s.R.copy()
    for _ in range(MANY):
        here = replace(s, r=r, R=R)
        phi = motion.constraint(system, States.one(here))[0]
        if np.max(np.abs(phi), initial=0.0) < NEAR:
            return project(system, here)
        change = np.linalg.lstsq(constraint_jacobian(system, here).toarray(), -phi, rcond=NEAR)[0].reshape(-1, 6)
        change *= min(1.0, STRIDE / float(np.max(np.abs(change))))
        r, R = r + change[:, :3], R @ so3.exp(change[:, 3:])
    raise AssertionError(f"the start of {system.nb} bodies does not come near its constraints")


def rounding_of_rows(s: State) -> tuple[float, float]:
    """What rounding leaves of phi [m] and of phi_dot [m/s], whose rows have twice as many products, at this state."""
    size, speed = (max(1.0, float(np.max(np.abs(a)))) for a in (s.r, (s.v, s.Omega)))
    return ROUNDED * size, 2.0 * ROUNDED * size * speed


def judge_accelerations(system: MultibodySystem, s: State) -> list[tuple[np.ndarray, float]]:
    """The judge's accelerations (nb, 6) and load of the reactions (nb, 6), each with the error of its differences.

    By these it takes A_dot v. Over half their reach their error is a 64th: the change is the error of the first.
    """
    judge = solve_index_1(system, States.one(s))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(motion, "REACH", 0.5 * motion.REACH)
        nearer = solve_index_1(system, States.one(s))
    pairs = ((judge.a[0], nearer.a[0]), (judge.load[0], nearer.load[0]))
    return [(one, 1.1 * float(np.max(np.abs(other - one)))) for one, other in pairs]
