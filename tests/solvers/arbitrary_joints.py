"""One joint of each kind, without symmetry, and a system with all of them."""

import numpy as np

from mbsbench.harness.mechanics import so3
from mbsbench.harness.mechanics.consistency import project
from mbsbench.harness.mechanics.joints import JointKind
from mbsbench.harness.mechanics.state import State
from mbsbench.harness.mechanics.system import GROUND, Load, MultibodySystem, SpringDamper, assemble
from mbsbench.problems.random_mechanism import arbitrary_body, closed_joint

KINDS = tuple(JointKind)
SPRING = SpringDamper(0, (0.1, 0.2, 0.3), GROUND, (2.0, 2.0, 1.0), 20.0, 1.0, 0.3)
LOADS = (
    Load(0, (1.0, 2.0, -1.0), (0.3, 0.1, -0.2), (0.1, -0.2, 0.3)),
    Load(0, (0.5, -0.4, 0.3), (-0.2, 0.3, 0.5), (0.2, 0.1, 0.0), follows=True),
)


def _poses(random: np.random.Generator, nb: int) -> tuple[np.ndarray, np.ndarray]:
    """Of all bodies, then of the ground."""
    r, R = random.standard_normal((nb, 3)), so3.exp(random.standard_normal((nb, 3)))
    return np.concatenate((r, np.zeros((1, 3)))), np.concatenate((R, np.eye(3)[None]))


def one_joint(kind: JointKind, *, ground: bool, seed: int = 3) -> tuple[MultibodySystem, State]:
    """Two bodies, or one and the ground, with a spring-damper and two loads; a consistent state."""
    random, nb = np.random.default_rng(seed), 1 if ground else 2
    r, R = poses = _poses(random, nb)
    joint = closed_joint(kind, 0, GROUND if ground else 1, poses, random)
    system = assemble([arbitrary_body(random) for _ in range(nb)], [joint], (0.3, -9.81, 0.2), [SPRING], LOADS)
    v = random.standard_normal((2, nb, 3))
    return system, project(system, State(r[:-1], R[:-1], v[0], v[1]))


def all_joints() -> MultibodySystem:
    """A row of bodies, from the ground on, with a joint of each kind between two neighbours."""
    random, nb = np.random.default_rng(11), len(KINDS)
    poses = _poses(random, nb)
    joints = [closed_joint(kind, k, k - 1, poses, random) for k, kind in enumerate(KINDS)]
    return assemble([arbitrary_body(random) for _ in range(nb)], joints, (1.1, -2.3, -9.5), [SPRING], LOADS)
