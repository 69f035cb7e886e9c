"""Mechanisms drawn at random: trees with loops, redundant joints, springs and loads, for stress and for fuzzing.

Bodies of 1 to 2 kg in arbitrary poses hang in a tree on joints of arbitrary kinds; ``loops`` closes it by links of a
fixed length, ``repeated`` declares joints a second time. All joints are closed at the start, so that every draw is a
valid problem.

``size`` and ``mass`` scale a draw by Froude's law: lengths by size, times by sqrt(size), forces by mass, so that the
motion under gravity is similar. A solver that is right at one size is right at all.

Numbers: drawn by the seed. Reference: computed.
"""

from dataclasses import replace
from typing import Annotated

import numpy as np
from jaxtyping import Float

from ..harness.catalogue.options import Parameter
from ..harness.catalogue.registry import problem
from ..harness.mechanics import so3
from ..harness.mechanics.consistency import project
from ..harness.mechanics.joints import Joint, JointKind
from ..harness.mechanics.state import State
from ..harness.mechanics.system import GROUND, Load, RigidBody, SpringDamper, assemble
from ..harness.mechanics.types import Observable, Problem

KINDS = tuple(k for k in JointKind if k not in (JointKind.FIXED, JointKind.NORMAL))
APART = 0.3  # [m] between the points of joints that slide, and what a link is longer than its bodies' C are apart
SPREAD = 0.3  # [m] standard deviation of a joint's point from the middle of its bodies, and of a spring's end from C
Poses = tuple[Float[np.ndarray, "places 3"], Float[np.ndarray, "places 3 3"]]  # poses of all bodies, then of the ground


@problem("random_mechanism")
def random_mechanism(
    *,
    bodies: Annotated[int, Parameter("number of bodies", "", at_least=1, at_most=1000)] = 6,
    loops: Annotated[int, Parameter("links that close the tree", "", at_least=0, at_most=1000)] = 1,
    repeated: Annotated[
        int, Parameter("joints that are declared twice: redundant rows", "", at_least=0, at_most=1000)
    ] = 0,
    springs: Annotated[
        int, Parameter("spring-dampers between bodies or to the ground", "", at_least=0, at_most=1000)
    ] = 2,
    loads: Annotated[int, Parameter("constant forces and torques", "", at_least=0, at_most=1000)] = 1,
    mechanism_seed: Annotated[int, Parameter("random seed", "", at_least=0)] = 1,
    size: Annotated[float, Parameter("scale of all lengths; times grow by its root", "m", above=0.0)] = 1.0,
    mass: Annotated[float, Parameter("scale of all masses and forces", "kg", above=0.0)] = 1.0,
    contrast: Annotated[float, Parameter("decades between the masses of bodies", "", at_least=0.0)] = 0.0,
    offset: Annotated[float, Parameter("distance from the origin, along OX", "m")] = 0.0,
    speed: Annotated[float, Parameter("factor on the velocities of the start", "", at_least=0.0)] = 1.0,
    damping: Annotated[float, Parameter("damping over stiffness", "s", at_least=0.0)] = 0.02,
    gravity: Annotated[float, Parameter("along -Z", "m/s2")] = 9.81,
) -> Problem:
    """Draw a tree of bodies on joints of random kinds, with loops, redundant joints, springs and loads.

    Equal seeds give equal draws, which ``size`` and ``mass`` scale. The velocities of the start are made consistent.
    """
    random = np.random.default_rng(mechanism_seed)
    if repeated > bodies:
        raise ValueError(f"repeated must be <= bodies = {bodies} (got {repeated})")
    r = np.concatenate((random.standard_normal((bodies, 3)) * bodies ** (1 / 3), np.zeros((1, 3))))
    R = np.concatenate((so3.exp(random.standard_normal((bodies, 3))), np.eye(3)[None]))
    joints = []
    for k in range(bodies):
        parent = int(random.integers(-1, k)) if k else GROUND
        joints.append(draw_closed_joint(KINDS[random.integers(len(KINDS))], k, parent, (r, R), random))
    for _ in range(loops):
        i = int(random.integers(bodies))
        j = GROUND if bodies == 1 else int(random.choice([b for b in range(-1, bodies) if b != i]))
        joints.append(draw_closed_joint(JointKind.DISTANCE, i, j, (r, R), random))
    joints += joints[:repeated]
    ends = [
        (int(random.integers(bodies)), random.standard_normal((2, 3)), random.uniform(5.0, 50.0))
        for _ in range(springs)
    ]
    pushes = []
    for k in range(loads):
        force, torque, point = random.standard_normal((3, 3))
        pushes.append(Load(int(random.integers(bodies)), force, 0.1 * torque, 0.1 * point, follows=bool(k % 2)))
    drawn = [draw_body(random) for _ in range(bodies)]
    v = speed * random.standard_normal((2, bodies, 3))
    weight = mass * 10.0 ** (contrast * np.random.default_rng((mechanism_seed, 1)).uniform(-0.5, 0.5, bodies))
    root, away = size**0.5, np.array([offset, 0.0, 0.0])
    system = assemble(
        [RigidBody(w * b.mass, w * size**2 * b.inertia) for w, b in zip(weight, drawn, strict=True)],
        [_place_joint(joint, size, away) for joint in joints],
        (0.0, 0.0, -gravity),
        [
            SpringDamper(
                i,
                size * SPREAD * p[0],
                GROUND,
                size * (r[i] + p[1]) + away,
                weight[i] / size * k,
                size,
                weight[i] / root * damping * k,
            )
            for i, p, k in ends
        ],
        [
            replace(
                f,
                force=weight[f.i] * np.asarray(f.force),
                torque=weight[f.i] * size * np.asarray(f.torque),
                point=size * np.asarray(f.point),
            )
            for f in pushes
        ],
    )
    start = project(system, State(size * r[:-1] + away, R[:-1], root * v[0], v[1] / root), 0)
    return Problem(
        "random_mechanism",
        system,
        start,
        t_end=root,
        dt=1e-3 * root,
        section="",
        source="drawn",
        observables=(
            Observable("last_x", "X_N", "m", lambda s: s.r[:, -1, 0]),
            Observable("last_z", "Z_N", "m", lambda s: s.r[:, -1, 2]),
        ),
    )


def _place_joint(joint: Joint, size: float, away: Float[np.ndarray, " 3"]) -> Joint:
    """Return ``joint`` with lengths scaled by ``size``, and a point on the ground moved by ``away`` [m]."""
    s_j = size * np.asarray(joint.s_j) + (away if joint.j == GROUND else 0.0)
    return replace(joint, s_i=size * np.asarray(joint.s_i), s_j=s_j, length=size * joint.length)


def draw_body(random: np.random.Generator) -> RigidBody:
    """Draw a body of 1 to 2 kg with a full inertia matrix."""
    a, Q = random.uniform(0.05, 0.1, 3), so3.exp(random.standard_normal(3))
    J = Q @ np.diag([a[1] + a[2], a[0] + a[2], a[0] + a[1]]) @ Q.T
    return RigidBody(random.uniform(1.0, 2.0), 0.5 * (J + J.T))


def draw_closed_joint(kind: JointKind, i: int, j: int, poses: Poses, random: np.random.Generator) -> Joint:
    """Draw a joint of this kind between bodies i and j, at a random point, that is closed in these poses.

    ``poses`` has the ground last, as ``GROUND`` is -1. A point [m], a unit axis, and a unit vector ``across`` it are
    drawn in space and then expressed in the frames of the bodies. Spherical joints and links have no axis. A point on a
    line or on a plane has one in j alone. A universal joint and normal axes have one in each body, normal to each
    other. All others have one axis in common; fixed and prismatic joints have the direction ``across`` as well.
    """
    r, R = poses
    axis = so3.exp(random.standard_normal(3))[0]
    point_j = 0.5 * (r[i] + r[j]) + SPREAD * random.standard_normal(3)
    across = np.cross(axis, random.standard_normal(3))
    across /= np.linalg.norm(across)
    length = float(np.linalg.norm(r[i] - r[j])) + APART if kind == JointKind.DISTANCE else 0.0
    offset = {  # [m] of the point of i from that of j
        JointKind.CYLINDRICAL: APART * axis,
        JointKind.PRISMATIC: APART * axis,
        JointKind.ON_LINE: APART * axis,
        JointKind.ON_PLANE: APART * across,
        JointKind.DISTANCE: length * axis,
    }.get(kind, np.zeros(3))
    s_i, s_j = R[i].T @ (point_j + offset - r[i]), R[j].T @ (point_j - r[j])
    axis_j = None if kind in (JointKind.SPHERICAL, JointKind.DISTANCE) else R[j].T @ axis
    has_none_in_i = axis_j is None or kind in (JointKind.ON_LINE, JointKind.ON_PLANE)
    axis_i = None if has_none_in_i else R[i].T @ (across if kind in (JointKind.UNIVERSAL, JointKind.NORMAL) else axis)
    has_across = kind in (JointKind.FIXED, JointKind.PRISMATIC)
    across_i, across_j = (R[i].T @ across, R[j].T @ across) if has_across else (None, None)
    return Joint(i, s_i, j, s_j, axis_i, axis_j, f"{kind} {i + 1}", kind, across_i, across_j, length)
