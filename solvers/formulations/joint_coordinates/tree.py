"""A system as a tree of joints whose other joints are cut, in frames that let planar mechanisms fold.

The rule: breadth first from the ground, joints in their order; a joint of a kind in ``MOTIONS`` that reaches a new body
is a joint of the tree, any other is cut. A part that none joins to the ground floats on its first body.

The base frame has z along the first hinge, y against gravity; at the start the frames of all bodies are parallel to it.
So rotations of a planar mechanism are about z, and what is constant there is a number.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ....harness.mechanics.state import State
from ....harness.mechanics.system import GROUND, MultibodySystem

NOISE = 1e-12  # of an array's size: a constant that is zero but for rounding

MOTIONS = {  # directions that joints turn about, and slide along: u in i, n in j; a spherical one is a ball
    "spherical": ("", ""), "universal": ("nu", ""), "revolute": ("u", ""), "fixed": ("", ""), "cylindrical": ("u", "u"),
    "prismatic": ("", "u"),
}  # fmt: skip


class Limb(NamedTuple):
    """A body on its parent, by its point P in the joint. Directions and points in the frames at the start."""

    body: int
    parent: int  # or ``GROUND``
    joint: int  # -1: it floats
    child_is_i: bool
    turns: Float[np.ndarray, "nt 3"]  # axes of its hinges, from the parent on
    slides: Float[np.ndarray, "ns 3"]  # directions in which P moves in the parent
    ball: bool  # orientation and angular velocity are those in the base frame: nothing of the parent's is passed on
    arm: Float[np.ndarray, " 3"]  # from the parent's P to P
    beside: Float[np.ndarray, " 3"]  # from P to the joint's point of i
    centre: Float[np.ndarray, " 3"]  # from P to C
    q_at: int  # first coordinate: slides, then angles or a quaternion
    u_at: int  # first velocity: slides, then turns

    @property
    def sizes(self) -> tuple[int, int]:
        """Numbers of coordinates and of velocities."""
        n = len(self.slides) + len(self.turns)
        return (n + 4, n + 3) if self.ball else (n, n)


class Tree(NamedTuple):
    """Limbs, parents first; cut joints; the base frame, and its frames of the bodies at the start."""

    limbs: tuple[Limb, ...]
    cuts: tuple[int, ...]
    base: Float[np.ndarray, "3 3"]  # space to base
    frames: Float[np.ndarray, "nb 3 3"]  # body to base, at the start
    start: Float[np.ndarray, " ny"]  # coordinates, then velocities

    @property
    def nq(self) -> int:
        """Number of coordinates."""
        return sum(limb.sizes[0] for limb in self.limbs)

    @property
    def nu(self) -> int:
        """Number of velocities."""
        return sum(limb.sizes[1] for limb in self.limbs)


def spanning_tree(system: MultibodySystem, start: State) -> Tree:
    """The tree and its cut joints, by the rule above."""
    reached = _breadth_first(system)
    base = _base(system, start, reached)
    frames = snap(base @ start.R)
    ground = [*frames, base]  # the last one is the ground's
    points = np.zeros((system.nb + 1, 3))  # P of each body, in the base frame
    limbs: list[Limb] = []
    q_at = u_at = 0
    for body, (parent, k) in reached.items():
        limb = _limb(system, start, base, ground, points, (body, parent, k))._replace(q_at=q_at, u_at=u_at)
        limbs.append(limb)
        q_at, u_at = q_at + limb.sizes[0], u_at + limb.sizes[1]
    used = {limb.joint for limb in limbs}
    cuts = tuple(k for k in range(system.nj) if k not in used)
    tree = Tree(tuple(limbs), cuts, base, frames, np.zeros(0))
    return tree._replace(start=np.concatenate(_coordinates(tree, start)))


def snap(a: np.ndarray, size: float | None = None) -> np.ndarray:
    """``a`` without what is rounding beside ``size``, or beside its largest number."""
    out = np.array(a, dtype=float)
    noise = NOISE * (float(np.max(np.abs(out), initial=0.0)) if size is None else size)
    out[np.abs(out) < noise] = 0.0
    for one in (-1.0, 1.0):
        out[np.abs(out - one) < noise] = one
    return out


def _breadth_first(system: MultibodySystem) -> dict[int, tuple[int, int]]:
    """(parent, joint) by body, joint -1 for a body that floats."""
    reached: dict[int, tuple[int, int]] = {}
    held: dict[int, list[tuple[int, int]]] = {b: [] for b in range(GROUND, system.nb)}
    for k, (i, j) in enumerate(zip(system.joint_i.tolist(), system.joint_j.tolist(), strict=True)):
        if system.joint_kind(k) in MOTIONS:
            held[i].append((j, k))
            held[j].append((i, k))

    def spread(queue: list[int]) -> None:
        for parent in queue:  # grows meanwhile
            for other, k in held[parent]:
                if other != GROUND and other not in reached:
                    reached[other] = (parent, k)
                    queue.append(other)

    spread([GROUND])
    for b in range(system.nb):
        if b not in reached:
            reached[b] = (GROUND, -1)
            spread([b])
    return reached


def _base(system: MultibodySystem, start: State, reached: dict[int, tuple[int, int]]) -> np.ndarray:
    """z along the first hinge, or slide, or against gravity; y against gravity as far as it is normal to that."""
    up, z = -system.gravity, np.zeros(3)
    joints = [k for _, k in reached.values() if k >= 0]
    for kinds in (("revolute", "cylindrical"), ("universal", "prismatic")):
        for k in joints:
            if not np.any(z) and system.joint_kind(k) in kinds:
                z = start.R[system.joint_i[k]] @ system.joint_u[k]
    z = z if np.any(z) else up if np.any(up) else np.eye(3)[2]
    z = z / np.linalg.norm(z)
    for y in (up, *np.eye(3)[np.argsort(np.abs(z), kind="stable")]):
        y = y - (y @ z) * z
        if np.linalg.norm(y) > 1e-6 * max(1.0, float(np.linalg.norm(up))):
            break
    y = y / np.linalg.norm(y)
    return snap(np.stack((np.cross(y, z), y, z)))


def _limb(
    system: MultibodySystem, start: State, base: np.ndarray, frames: list[np.ndarray], points: np.ndarray,
    of: tuple[int, int, int],
) -> Limb:  # fmt: skip
    """``points`` gets P of the body."""
    s, (body, parent, k) = system, of
    r, none = base @ start.r[body], np.zeros((0, 3))
    if k < 0:
        points[body] = r
        return Limb(body, GROUND, k, True, none, np.eye(3), True, r, np.zeros(3), np.zeros(3), 0, 0)
    i, j, kind = int(s.joint_i[k]), int(s.joint_j[k]), str(s.joint_kind(k))
    child_is_i = i == body
    ends = [(base @ start.r[e] if e != GROUND else np.zeros(3)) + frames[e] @ arm
            for e, arm in ((i, s.joint_s_i[k]), (j, s.joint_s_j[k]))]  # fmt: skip
    points[body] = ends[0 if child_is_i else 1]
    direction = {"u": frames[i] @ s.joint_u[k], "n": frames[j] @ s.joint_n[k, 0]}
    turns, slides = (snap(np.array([direction[x] for x in xs]).reshape(-1, 3)) for xs in MOTIONS[kind])
    size = float(np.max(np.abs(np.concatenate((s.joint_s_i, s.joint_s_j, start.r))), initial=0.0))
    arm, beside, centre = (
        snap(a, size) for a in (points[body] - points[parent], ends[0] - points[body], r - points[body])
    )  # fmt: skip
    turns = turns if child_is_i else turns[::-1]
    return Limb(body, parent, k, child_is_i, turns, slides, kind == "spherical", arm, beside, centre, 0, 0)


def _coordinates(tree: Tree, start: State) -> tuple[np.ndarray, np.ndarray]:
    """At the start all angles are 0; velocities by joints, those of its bodies as far as it lets them."""
    q, u = np.zeros(tree.nq), np.zeros(tree.nu)
    omega = np.concatenate((np.einsum("bij,bj->bi", tree.frames, start.Omega), np.zeros((1, 3))))
    v = np.concatenate((start.v @ tree.base.T, np.zeros((1, 3))))
    centre = np.zeros((len(v), 3))
    for limb in tree.limbs:
        b, p, ns = limb.body, limb.parent, len(limb.slides)
        centre[b] = limb.centre
        v_p = v[p] + np.cross(omega[p], limb.arm - centre[p])  # of the point of the parent at P
        v_b = v[b] - np.cross(omega[b], limb.centre)
        own = u[limb.u_at : limb.u_at + limb.sizes[1]]
        own[:ns] = limb.slides @ (v_b - v_p)
        if limb.ball:
            q[limb.q_at + ns], own[ns:] = 1.0, omega[b]
        elif len(limb.turns):
            own[ns:] = _components(limb.turns, omega[b] - omega[p])
    return q, u


def _components(axes: np.ndarray, w: np.ndarray) -> list[float]:
    """Return the components of w along one axis, or two, by least squares; no linear algebra of a library decides."""
    along = [_product(a, w) for a in axes]
    if len(axes) == 1:
        return [along[0] / _product(axes[0], axes[0])]
    p, q, both = _product(axes[0], axes[0]), _product(axes[1], axes[1]), _product(axes[0], axes[1])
    size = p * q - both * both
    return [(q * along[0] - both * along[1]) / size, (p * along[1] - both * along[0]) / size]


def _product(a: np.ndarray, b: np.ndarray) -> float:
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])
