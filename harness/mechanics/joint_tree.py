"""A system as a tree of joints whose other joints are cut, in frames that make constants of planar mechanisms simple.

The rule: breadth first from the ground, joints in their order; a joint of a kind in ``MOTIONS`` that reaches a new body
is a joint of the tree, any other is cut. A part that no such joint connects to the ground floats on its first body.

The base frame has z along the first hinge and y against gravity; at the start the frames of all bodies are parallel to
it. So rotations of a planar mechanism are about z, and entries that are constant there are numbers.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .fixed_order import apply, dot, product
from .joint_walk import walk_joints
from .state import State
from .system import GROUND, MultibodySystem

NOISE = 1e-12  # share of an array's size below which a constant is rounding of zero

MOTIONS = {  # directions that joints turn about and slide along: u in i, n in j; a spherical joint is a ball
    "spherical": ("", ""),
    "universal": ("nu", ""),
    "revolute": ("u", ""),
    "fixed": ("", ""),
    "cylindrical": ("u", "u"),
    "prismatic": ("", "u"),
}


class Limb(NamedTuple):
    """A body on its parent, with its point P in their joint; directions and points are in the frames at the start."""

    body: int
    parent: int  # or ``GROUND``
    joint: int  # -1: it floats
    child_is_i: bool
    turns: Float[np.ndarray, "nt 3"]  # axes of its hinges, from the parent on
    slides: Float[np.ndarray, "ns 3"]  # directions in which P moves in the parent
    ball: bool  # orientation and angular velocity are those in the base frame: nothing of the parent's is passed on
    arm: Float[np.ndarray, " 3"]  # from the parent's P to P
    point_of_i: Float[np.ndarray, " 3"]  # from P to the joint's point of i
    centre: Float[np.ndarray, " 3"]  # from P to C
    q_at: int  # first coordinate: slides, then angles or a quaternion
    u_at: int  # first velocity: slides, then turns

    @property
    def sizes(self) -> tuple[int, int]:
        """Numbers of the limb's coordinates and of its velocities."""
        n = len(self.slides) + len(self.turns)
        return (n + 4, n + 3) if self.ball else (n, n)


class Tree(NamedTuple):
    """Limbs, parents first; cut joints; the base frame, and the frames of the bodies at the start."""

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


def build_spanning_tree(system: MultibodySystem, start: State) -> Tree:
    """Return the spanning tree of a system by the module's rule, with cut joints and its coordinates at ``start``.

    Its arrays are read-only, since it serves all solves of a problem.
    """
    reached = walk_joints(system, MOTIONS).reached
    base = _find_base_frame(system, start, reached)
    frames = remove_rounding(product(base, start.R))
    all_frames = [*frames, base]  # the last one is the ground's
    points = np.zeros((system.nb + 1, 3))  # P of each body, in the base frame
    limbs: list[Limb] = []
    q_at = u_at = 0
    for body, (parent, k) in reached.items():
        limb = _make_limb(system, start, base, all_frames, points, (body, parent, k))._replace(q_at=q_at, u_at=u_at)
        limbs.append(limb)
        q_at, u_at = q_at + limb.sizes[0], u_at + limb.sizes[1]
    used = {limb.joint for limb in limbs}
    cuts = tuple(k for k in range(system.nj) if k not in used)
    tree = Tree(tuple(limbs), cuts, base, frames, np.zeros(0))
    tree = tree._replace(start=np.concatenate(_find_start_coordinates(tree, start)))
    for array in (*tree, *(part for limb in limbs for part in limb)):
        if isinstance(array, np.ndarray):
            array.setflags(write=False)
    return tree


def remove_rounding(a: np.ndarray, size: float | None = None) -> np.ndarray:
    """Return a copy of ``a`` in which numbers that differ from 0, 1 or -1 by rounding alone are set to these.

    Rounding is ``NOISE`` times ``size``, by default the largest magnitude in ``a``.
    """
    out = np.array(a, dtype=float)
    noise = NOISE * (float(np.max(np.abs(out), initial=0.0)) if size is None else size)
    out[np.abs(out) < noise] = 0.0
    for one in (-1.0, 1.0):
        out[np.abs(out - one) < noise] = one
    return out


def _find_base_frame(system: MultibodySystem, start: State, reached: dict[int, tuple[int, int]]) -> np.ndarray:
    """Return the rotation from space to the base frame: z along the first hinge or slide, y against gravity.

    y is made normal to z. Revolute and cylindrical joints are taken before universal and prismatic ones; without any, z
    is against gravity or, without gravity, along Z of space. ``reached`` has (parent, joint) by body.
    """
    up, z = -system.gravity, np.zeros(3)
    joints = [k for _, k in reached.values() if k >= 0]
    for kinds in (("revolute", "cylindrical"), ("universal", "prismatic")):
        for k in joints:
            if not np.any(z) and system.joint_kind(k) in kinds:
                z = apply(start.R[system.joint_i[k]], system.joint_u[k])
    z = z if np.any(z) else up if np.any(up) else np.eye(3)[2]
    z = z / np.sqrt(dot(z, z))
    # against gravity, unless that is along z or zero: else the axis of space that is farthest from z
    for y in (up, *np.eye(3)[np.argsort(np.abs(z), kind="stable")]):
        y = y - dot(y, z) * z
        if dot(y, y) > 1e-12 * max(1.0, dot(up, up)):
            break
    y = y / np.sqrt(dot(y, y))
    return remove_rounding(np.stack((np.cross(y, z), y, z)))


def _make_limb(
    system: MultibodySystem,
    start: State,
    base: np.ndarray,
    frames: list[np.ndarray],
    points: np.ndarray,
    connection: tuple[int, int, int],
) -> Limb:
    """Return the limb of a ``connection`` (body, parent, joint), and set its P in ``points`` [m, base frame].

    A joint of -1 lets the body float. ``frames`` take bodies and, last, the ground to the base frame. The places of the
    coordinates, ``q_at`` and ``u_at``, stay 0.
    """
    s, (body, parent, k) = system, connection
    r, none = apply(base, start.r[body]), np.zeros((0, 3))
    if k < 0:
        points[body] = r
        return Limb(body, GROUND, k, True, none, np.eye(3), True, r, np.zeros(3), np.zeros(3), 0, 0)
    i, j, kind = int(s.joint_i[k]), int(s.joint_j[k]), str(s.joint_kind(k))
    child_is_i = i == body
    ends = [
        (apply(base, start.r[e]) if e != GROUND else np.zeros(3)) + apply(frames[e], arm)
        for e, arm in ((i, s.joint_s_i[k]), (j, s.joint_s_j[k]))
    ]
    points[body] = ends[0 if child_is_i else 1]
    direction = {"u": apply(frames[i], s.joint_u[k]), "n": apply(frames[j], s.joint_n[k, 0])}
    turns, slides = (remove_rounding(np.array([direction[x] for x in xs]).reshape(-1, 3)) for xs in MOTIONS[kind])
    size = float(np.max(np.abs(np.concatenate((s.joint_s_i, s.joint_s_j, start.r))), initial=0.0))
    arm, beside, centre = (
        remove_rounding(a, size) for a in (points[body] - points[parent], ends[0] - points[body], r - points[body])
    )
    turns = turns if child_is_i else turns[::-1]
    return Limb(body, parent, k, child_is_i, turns, slides, kind == "spherical", arm, beside, centre, 0, 0)


def _find_start_coordinates(tree: Tree, start: State) -> tuple[np.ndarray, np.ndarray]:
    """Return coordinates (nq,) and velocities (nu,) of a tree at the start.

    Angles and displacements are 0, quaternions 1. Velocities are found joint by joint: of the bodies' relative motion,
    what the joint leaves free.
    """
    q, u = np.zeros(tree.nq), np.zeros(tree.nu)
    omega = np.concatenate((apply(tree.frames, start.Omega), np.zeros((1, 3))))
    v = np.concatenate((product(start.v, tree.base.T), np.zeros((1, 3))))
    centre = np.zeros((len(v), 3))
    for limb in tree.limbs:
        b, p, ns = limb.body, limb.parent, len(limb.slides)
        centre[b] = limb.centre
        v_p = v[p] + np.cross(omega[p], limb.arm - centre[p])  # velocity of the parent's point at P
        v_b = v[b] - np.cross(omega[b], limb.centre)
        own = u[limb.u_at : limb.u_at + limb.sizes[1]]
        own[:ns] = apply(limb.slides, v_b - v_p)
        if limb.ball:
            q[limb.q_at + ns], own[ns:] = 1.0, omega[b]
        elif len(limb.turns):
            own[ns:] = _find_rates_about(limb.turns, omega[b] - omega[p])
    return q, u


def _find_rates_about(turns: Float[np.ndarray, "nt 3"], omega: Float[np.ndarray, " 3"]) -> np.ndarray:
    """Return the rates [rad/s] about one or two axes whose sum is nearest to the angular velocity ``omega``."""
    first, *second = turns
    if not second:
        return np.array([dot(first, omega) / dot(first, first)])
    aa, ab, bb = dot(first, first), dot(first, second[0]), dot(second[0], second[0])
    a, b, det = dot(first, omega), dot(second[0], omega), aa * bb - ab * ab
    return np.array([(bb * a - ab * b) / det, (aa * b - ab * a) / det])
