"""Random linkages that move although a count of their rows forbids it: one loop of hinges in space.

Their rows are redundant only where the constraints hold: at a pose that is slightly off, they contradict each other. A
joint that is declared twice (``random_mechanism``, ``repeated``) has rows that agree at every pose.

    planar     4 or 5 hinges of one direction
    spherical  4 or 5 hinges through one point
    bennett    4 hinges; opposite sides equal, sines of their twists proportional to their lengths
    sarrus     3 hinges of one direction, 3 of another
    bricard    6 hinges: three arbitrary, and the same turned by half a turn about a line (line-symmetric)

Numbers: drawn by the seed. Reference: computed.
"""

from typing import Annotated

import numpy as np
from jaxtyping import Float

from ..harness.catalogue.options import Parameter
from ..harness.catalogue.registry import problem
from ..harness.mechanics import so3
from ..harness.mechanics.consistency import project
from ..harness.mechanics.joints import Joint
from ..harness.mechanics.state import State
from ..harness.mechanics.system import GROUND, SpringDamper, assemble
from ..harness.mechanics.types import Observable, Problem, Trait
from .random_mechanism import draw_body

Loop = tuple[Float[np.ndarray, "hinges 3"], Float[np.ndarray, "hinges 3"]]  # a point and the direction of each hinge
X, Y, Z = np.eye(3)


@problem("random_linkage", tests=(Trait.REDUNDANT,))
def random_linkage(
    *,
    linkage: Annotated[
        str, Parameter("kind of loop", "", choices=("planar", "spherical", "bennett", "sarrus", "bricard"))
    ] = "bennett",
    mechanism_seed: Annotated[int, Parameter("random seed", "", at_least=0)] = 1,
    springs: Annotated[int, Parameter("spring-dampers to the ground", "", at_least=0, at_most=1000)] = 1,
    size: Annotated[float, Parameter("scale of all lengths; times grow by its root", "m", above=0.0)] = 1.0,
    mass: Annotated[float, Parameter("scale of all masses and forces", "kg", above=0.0)] = 1.0,
    offset: Annotated[float, Parameter("distance from the origin, along OX", "m")] = 0.0,
    speed: Annotated[float, Parameter("factor on the velocities of the start", "", at_least=0.0)] = 1.0,
    gravity: Annotated[float, Parameter("along -Z", "m/s2")] = 9.81,
) -> Problem:
    """Draw a closed loop of hinges in space whose rows are redundant only where the constraints hold.

    Equal seeds give equal draws, which ``size`` and ``mass`` scale. The velocities of the start are made consistent.
    """
    random = np.random.default_rng(mechanism_seed)
    points, axes = LOOPS[linkage](random)
    frame = so3.exp(random.standard_normal((1, 3)))[0]
    points, axes = points @ frame.T, axes @ frame.T
    n = len(points) - 1
    drawn = [draw_body(random) for _ in range(n)]
    r = 0.5 * (points[:-1] + points[1:]) + 0.1 * random.standard_normal((n, 3))
    R = so3.exp(random.standard_normal((n, 3)))
    v = speed * random.standard_normal((2, n, 3))
    held = [
        (int(random.integers(n)), random.standard_normal((2, 3)), random.uniform(5.0, 50.0)) for _ in range(springs)
    ]
    root, away = size**0.5, np.array([offset, 0.0, 0.0])
    joints = []
    for k, (point, axis) in enumerate(zip(points, axes, strict=True)):
        i, j = min(k, n - 1), k - 1 if 0 < k < n else GROUND
        s_i, s_j = R[i].T @ (point - r[i]), point if j == GROUND else R[j].T @ (point - r[j])
        there = away if j == GROUND else 0.0
        u = axis if j == GROUND else R[j].T @ axis
        joints.append(Joint(i, size * s_i, j, size * s_j + there, R[i].T @ axis, u, f"hinge {k + 1}"))
    system = assemble(
        [type(b)(mass * b.mass, mass * size**2 * b.inertia) for b in drawn],
        joints,
        (0.0, 0.0, -gravity),
        [
            SpringDamper(
                i, 0.3 * size * p[0], GROUND, size * (r[i] + p[1]) + away, mass / size * k, size, mass / root * 0.02 * k
            )
            for i, p, k in held
        ],
    )
    start = project(system, State(size * r + away, R, root * v[0], v[1] / root), 0)
    return Problem(
        "random_linkage",
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


def _draw_angles(random: np.random.Generator) -> Float[np.ndarray, " corners"]:
    """Draw the polar angles [rad] of the four or five corners of a polygon, anticlockwise."""
    n = int(random.integers(4, 6))
    return (np.arange(n) + random.uniform(-0.25, 0.25, n)) * 2.0 * np.pi / n


def _draw_planar(random: np.random.Generator) -> Loop:
    """Draw the loop of a planar linkage: four or five hinges along Z."""
    angle = _draw_angles(random)
    out = random.uniform(0.7, 1.3, len(angle))
    points = np.stack((out * np.cos(angle), out * np.sin(angle), random.uniform(-0.2, 0.2, len(angle))), axis=1)
    return points, np.tile(Z, (len(angle), 1))


def _draw_spherical(random: np.random.Generator) -> Loop:
    """Draw the loop of a spherical linkage: four or five hinges whose axes meet at the origin."""
    angle = _draw_angles(random)
    tilt = random.uniform(0.4, 1.1, len(angle))
    axes = np.stack((np.sin(tilt) * np.cos(angle), np.sin(tilt) * np.sin(angle), np.cos(tilt)), axis=1)
    return axes * random.uniform(0.8, 1.2, (len(angle), 1)), axes


def _draw_bennett(random: np.random.Generator) -> Loop:
    """Draw a Bennett linkage of four hinges, turned by theta_1, theta_2, -theta_1, -theta_2 about their axes.

    The product tan(theta_1 / 2) tan(theta_2 / 2) is a constant that follows from the two twists.
    """
    side_1, twist = random.uniform(0.8, 1.2), random.uniform(0.4, 0.9)
    ratio = random.uniform(0.6, 1.0 / np.sin(twist) * 0.95)
    other = np.arcsin(ratio * np.sin(twist))
    first = random.uniform(0.6, 2.4)
    second = 2.0 * np.arctan(np.sin(0.5 * (other + twist)) / np.sin(0.5 * (other - twist)) / np.tan(0.5 * first))
    points, axes, p, Q = [], [], np.zeros(3), np.eye(3)
    for side, by, turn in ((side_1, twist, first), (side_1 * ratio, other, second)) * 2:
        points.append(p)
        axes.append(Q[:, 2])
        Q = Q @ so3.exp(np.array([(turn if len(points) < 3 else -turn) * Z]))[0]
        p = p + side * Q[:, 0]
        Q = Q @ so3.exp(np.array([by * X]))[0]
    return np.array(points), np.array(axes)


def _draw_sarrus(random: np.random.Generator) -> Loop:
    """Draw a Sarrus linkage: two chains of three parallel hinges each, in directions 60 to 120 degrees apart.

    The middle hinge of each chain, its knee, lies outwards of the plane through the other two.
    """
    apart = random.uniform(np.pi / 3.0, 2.0 * np.pi / 3.0)
    height, points, axes = random.uniform(0.7, 1.1), [], []
    for angle in (0.0, apart):
        out, axis = (so3.exp(np.array([angle * Z]))[0] @ e for e in (X, Y))
        foot = random.uniform(0.2, 0.5) * out
        knee = foot + random.uniform(0.3, 0.7) * out + random.uniform(0.35, 0.65) * height * Z
        top = random.uniform(0.2, 0.5) * out + height * Z
        points += [p + random.uniform(-0.2, 0.2) * axis for p in (foot, knee, top)]
        axes += [axis] * 3
    order = [0, 1, 2, 5, 4, 3]  # up the first chain, down the second
    return np.array(points)[order], np.array(axes)[order]


def _draw_bricard(random: np.random.Generator) -> Loop:
    """Draw a line-symmetric Bricard linkage: three arbitrary hinges, and these turned by half a turn about OZ."""
    angle = (np.arange(3) + random.uniform(-0.2, 0.2, 3)) * np.pi / 3.0
    points = np.stack((np.cos(angle), np.sin(angle), 0.4 * random.standard_normal(3)), axis=1)
    axes = random.standard_normal((3, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    half = np.diag([-1.0, -1.0, 1.0])  # half a turn about OZ
    return np.concatenate((points, points @ half)), np.concatenate((axes, axes @ half))


LOOPS = {
    "planar": _draw_planar,
    "spherical": _draw_spherical,
    "bennett": _draw_bennett,
    "sarrus": _draw_sarrus,
    "bricard": _draw_bricard,
}
