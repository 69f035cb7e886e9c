"""One joint of each kind, without symmetry, and a system with all of them."""

import dataclasses

import numpy as np

from mbsbench import State, TimeFunction, so3
from mbsbench.harness.mechanics.consistency import project
from mbsbench.harness.mechanics.joints import DECLARED, Joint, JointKind, MovingKind
from mbsbench.harness.mechanics.system import GROUND, Load, MultibodySystem, SpringDamper, TorsionSpring, assemble
from mbsbench.problems.random_mechanism import draw_body, draw_closed_joint

KINDS = tuple(JointKind)
MOVING = (*MovingKind, *(name for name, one in DECLARED.items() if one.count.moving and name not in set(MovingKind)))
SPRING = SpringDamper(0, (0.1, 0.2, 0.3), GROUND, (2.0, 2.0, 1.0), 20.0, 1.0, 0.3)
LOADS = (
    Load(0, (1.0, 2.0, -1.0), (0.3, 0.1, -0.2), (0.1, -0.2, 0.3)),
    Load(0, (0.5, -0.4, 0.3), (-0.2, 0.3, 0.5), (0.2, 0.1, 0.0), follows=True),
)
SWAY = TimeFunction((0.3, 0.4, -0.2, 0.1), 0.2, 5.0, 0.7)
TIMED = tuple(dataclasses.replace(load, factor=SWAY) for load in LOADS)


def _poses(random: np.random.Generator, nb: int) -> tuple[np.ndarray, np.ndarray]:
    """Of all bodies, then of the ground."""
    r, R = random.standard_normal((nb, 3)), so3.exp(random.standard_normal((nb, 3)))
    return np.concatenate((r, np.zeros((1, 3)))), np.concatenate((R, np.eye(3)[None]))


def one_joint(
    kind: JointKind, *, ground: bool, seed: int = 3, times: int = 1, timed: bool = False
) -> tuple[MultibodySystem, State]:
    """Two bodies, or one and the ground, with a spring-damper and two loads; a consistent state.

    The joint is declared as many ``times``: all rows of a copy depend on those of the first. Loads that are ``timed``
    are functions of time.
    """
    random, nb = np.random.default_rng(seed), 1 if ground else 2
    r, R = poses = _poses(random, nb)
    joint = draw_closed_joint(kind, 0, GROUND if ground else 1, poses, random)
    bodies = [draw_body(random) for _ in range(nb)]
    system = assemble(bodies, [joint] * times, (0.3, -9.81, 0.2), [SPRING], TIMED if timed else LOADS)
    v = random.standard_normal((2, nb, 3))
    return system, project(system, State(r[:-1], R[:-1], v[0], v[1]))


def all_joints() -> MultibodySystem:
    """A row of bodies, from the ground on, with a joint of each kind between two neighbours."""
    random, nb = np.random.default_rng(11), len(KINDS)
    poses = _poses(random, nb)
    joints = [draw_closed_joint(kind, k, k - 1, poses, random) for k, kind in enumerate(KINDS)]
    return assemble([draw_body(random) for _ in range(nb)], joints, (1.1, -2.3, -9.5), [SPRING], LOADS)


def moving_row(kind: str, i: int, j: int, random: np.random.Generator) -> Joint:
    """Moving rows of a kind between two bodies, at arbitrary points and in arbitrary directions."""
    s_i, s_j = 0.3 * random.standard_normal((2, 3))
    axis_i, axis_j, across_i, across_j = random.standard_normal((4, 3))
    given = DECLARED[kind]
    return Joint(
        i,
        s_i,
        j,
        s_j,
        axis_i if "i" in given.axes else None,
        axis_j if "j" in given.axes else None,
        "",
        kind,
        across_i if given.across else None,
        across_j if given.across else None,
        0.4 if given.length else 0.0,
        SWAY if given.motion else None,
    )


def moving_rows(kind: str | None, *, ground: bool = False, seed: int = 5) -> MultibodySystem:
    """One kind, or all, between neighbours of a row of bodies, with springs, dampers, timed loads and gravity.

    The driven pairs also have the joint along whose freedom they are driven.
    """
    random = np.random.default_rng(seed)
    kinds = MOVING if kind is None else (kind,)
    joints = []
    for k, one in enumerate(kinds):
        row = moving_row(one, k, k - 1 if kind is None or ground else k + 1, random)
        guide = {"driven position": JointKind.PRISMATIC, "driven angle": JointKind.REVOLUTE}.get(one)
        if guide == JointKind.REVOLUTE:
            joints.append(Joint(row.i, row.s_i, row.j, row.s_j, row.axis_i, row.axis_j, kind=guide))
        elif guide is not None:
            joints.append(
                Joint(row.i, row.s_i, row.j, row.s_j, (0, 1, 1), row.axis_j, "", guide, (1, 2, 0.3), (0.3, -1, 2))
            )
        joints.append(row)
    nb = len(kinds) if kind is None or ground else 2
    bodies = [draw_body(random) for _ in range(nb)]
    twist = TorsionSpring(0, (0.3, 1.0, 0.2), nb - 1 if nb > 1 else GROUND, (1, 2, 3), (1, 0, 0.5), 3.0, 0.4, 0.5)
    return assemble(bodies, joints, (0.3, -9.81, 0.2), [SPRING], TIMED, [twist])
