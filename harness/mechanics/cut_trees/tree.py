"""A system as a tree in joint coordinates with cut joints: the form of engines that have joint coordinates.

The rule: breadth first from the ground, joints in their order; a joint that reaches a new body is a joint of the tree,
any other is cut. Only spherical and revolute joints can be cut: the others at a new body are followed at once. A part
that nothing joins to the ground floats on its first body. Coordinates follow the tree depth first, children in the
order in which they were reached::

    hinge      1: angle from the start                      velocity 1
    slide      1: displacement from the start               velocity 1
    cylinder   2: displacement, angle                       velocity 2
    universal  2: angle about axis_parent, about axis       velocity 2
    ball       4: quaternion (w, x, y, z) from the start    velocity 3: relative angular velocity, frame of the child
    free       7: r, quaternion of R                        velocity 6: r_dot, Omega
    fixed      0                                            velocity 0

    R_child = R_parent rot(first) R_0 rot(last)
    r_child = r_parent + R_parent (s_parent + displacement) - R_child s_child

A drive is no joint of its own: it makes the coordinate of a hinge or slide a function of time.

A cut joint is points of two bodies that coincide: one for a spherical joint, and for a revolute joint a second one on
the axis, left out where its rows depend on the others at the start. A joint declared twice is part of the tree once.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from .. import so3
from ..joint_walk import walk_joints
from ..joints import JointKind, MovingKind
from ..motion import point_velocity
from ..naming import name_joint
from ..state import State, States
from ..system import GROUND, MultibodySystem


class Kind(Enum):
    """Kinds of connection of a body to its parent, with the sizes of their coordinates and velocities."""

    HINGE = ("hinge", 1, 1)
    SLIDE = ("slide", 1, 1)
    CYLINDER = ("cylinder", 2, 2)
    UNIVERSAL = ("universal", 2, 2)
    BALL = ("ball", 4, 3)
    FREE = ("free", 7, 6)
    FIXED = ("fixed", 0, 0)

    @property
    def nq(self) -> int:
        """Number of coordinates."""
        return self.value[1]

    @property
    def nu(self) -> int:
        """Number of velocities."""
        return self.value[2]

    @property
    def has_quaternion(self) -> bool:
        """Flag of a connection that has a quaternion."""
        return self in (Kind.BALL, Kind.FREE)

    @property
    def slides(self) -> bool:
        """Flag of a connection whose first coordinate is a displacement along ``axis_parent``."""
        return self in (Kind.SLIDE, Kind.CYLINDER)


DRIVES = (MovingKind.DRIVEN_ANGLE, MovingKind.DRIVEN_POSITION)
PARALLEL = 1e-9  # tolerance on two parallel axes
DEPENDENT = 1e-9  # share of the largest singular value of constraint rows
CUTTABLE = (JointKind.SPHERICAL, JointKind.REVOLUTE)
LINKS = (JointKind.DISTANCE, JointKind.ON_LINE)
KINDS = {
    JointKind.SPHERICAL: Kind.BALL,
    JointKind.REVOLUTE: Kind.HINGE,
    JointKind.PRISMATIC: Kind.SLIDE,
    JointKind.CYLINDRICAL: Kind.CYLINDER,
    JointKind.UNIVERSAL: Kind.UNIVERSAL,
    JointKind.FIXED: Kind.FIXED,
}


@dataclass(frozen=True)
class EngineLimb:
    """A body and its connection to its parent."""

    body: int
    parent: int  # or ``GROUND``
    kind: Kind
    s_parent: Float[np.ndarray, " 3"]
    s_child: Float[np.ndarray, " 3"]
    axis: Float[np.ndarray, " 3"]  # axis of the last angle, frame of the child; zero where there is none
    # axis of the displacement or the first angle, frame of the parent; zero likewise
    axis_parent: Float[np.ndarray, " 3"]
    R_0: Float[np.ndarray, "3 3"]  # from the parent to the child at the start; free: from space
    q_at: int  # first coordinate
    u_at: int  # first velocity

    def list_moves(self) -> tuple[tuple[bool, Float[np.ndarray, " 3"]], ...]:
        """Return the one-axis joints that the connection consists of, from the parent to the child.

        Each is a pair: whether it slides, and its axis in the frame of the child at the start. Balls, free and fixed
        bodies have none.
        """
        first, last = self.R_0.T @ self.axis_parent, self.axis
        return {
            Kind.HINGE: ((False, last),),
            Kind.SLIDE: ((True, first),),
            Kind.CYLINDER: ((True, first), (False, last)),
            Kind.UNIVERSAL: ((False, first), (False, last)),
        }.get(self.kind, ())


@dataclass(frozen=True)
class Points:
    """Point ``s_i`` of body i, and point ``s_j`` of body j or the ground."""

    i: int
    s_i: Float[np.ndarray, " 3"]
    j: int
    s_j: Float[np.ndarray, " 3"]


@dataclass(frozen=True)
class Coincidence(Points):
    """Two points that have to coincide."""


@dataclass(frozen=True)
class PointLink(Points):
    """Two points ``length`` apart; if that is 0, the first lies on the line of j along ``axis`` through the second."""

    axis: Float[np.ndarray, " 3"]
    length: float


@dataclass(frozen=True)
class Drive:
    """The coordinate of the hinge or slide of ``body`` as a function of time, 0 at the start."""

    name: str
    body: int
    u_at: int
    motion: Float[np.ndarray, " 7"]  # numbers of a ``TimeFunction``


@dataclass(frozen=True)
class EngineTree:
    """A spanning tree: limbs in the order of their coordinates, points of cut joints, the start, drives and links."""

    limbs: tuple[EngineLimb, ...]
    cuts: tuple[Coincidence, ...]
    start: Float[np.ndarray, " nq"]
    start_velocity: Float[np.ndarray, " nu"]
    drives: tuple[Drive, ...] = ()
    links: tuple[PointLink, ...] = ()

    def states(self, q: Float[np.ndarray, "nt nq"], u: Float[np.ndarray, "nt nu"]) -> States:
        """Return poses and velocities of all bodies at coordinates ``q`` and velocities ``u``, one row per instant."""
        nt, nb = len(q), len(self.limbs)
        r, v, Omega = np.zeros((3, nt, nb + 1, 3))  # the last body is the ground
        R = np.broadcast_to(np.eye(3), (nt, nb + 1, 3, 3)).copy()
        for limb in self.limbs:
            b, p = limb.body, limb.parent
            own_q = q[:, limb.q_at : limb.q_at + limb.kind.nq]
            own_u = u[:, limb.u_at : limb.u_at + limb.kind.nu]
            if limb.kind is Kind.FREE:
                r[:, b], R[:, b] = own_q[:, :3], make_matrices(own_q[:, 3:])
                v[:, b], Omega[:, b] = own_u[:, :3], own_u[:, 3:]
                continue
            slides, turns_first = limb.kind.slides, limb.kind is Kind.UNIVERSAL
            first, angle = (own_q[:, :1], own_q[:, -1:]) if len(own_q.T) else np.zeros((2, nt, 1))
            first_rate, rate = (own_u[:, :1], own_u[:, -1:]) if len(own_u.T) else np.zeros((2, nt, 1))
            shift, shift_rate = (x * limb.axis_parent * slides for x in (first, first_rate))
            last = make_matrices(own_q) if limb.kind is Kind.BALL else so3.exp(angle * limb.axis)
            turn = so3.exp(first * limb.axis_parent * turns_first) @ limb.R_0 @ last
            R[:, b] = R[:, p] @ turn
            relative = own_u if limb.kind is Kind.BALL else rate * limb.axis
            carried = Omega[:, p] + first_rate * limb.axis_parent * turns_first
            Omega[:, b] = np.einsum("tji,tj->ti", turn, carried) + relative
            r[:, b] = r[:, p] + _rotate(R[:, p], limb.s_parent + shift) - R[:, b] @ limb.s_child
            v[:, b] = v[:, p] + _rotate(R[:, p], np.cross(Omega[:, p], limb.s_parent + shift) + shift_rate)
            v[:, b] -= _rotate(R[:, b], np.cross(Omega[:, b], limb.s_child))
        return States(r[:, :nb], R[:, :nb], v[:, :nb], Omega[:, :nb])

    @property
    def levels(self) -> int:
        """Number of bodies on the longest path from the ground."""
        depth = {GROUND: 0}
        for limb in self.limbs:
            depth[limb.body] = depth[limb.parent] + 1
        return max(depth.values())

    def jacobian(self) -> Float[np.ndarray, "twists nu"]:
        """Return T (6 nb, nu) of (r_dot [space], Omega [body]) = T u at the start, six rows per body."""
        s = self._unit_motions()
        return np.concatenate((s.v, s.Omega), axis=-1).reshape(len(s), -1).T

    def loop_jacobian(self) -> Float[np.ndarray, "nl nu"]:
        """Return G with G u the rates of the gaps of cut joints, then of driven coordinates, at the start."""
        driven = np.eye(len(self.start_velocity))[[drive.u_at for drive in self.drives]]
        return np.concatenate((_make_gap_jacobian(self._unit_motions(), self.cuts), driven))

    def bias(self, start: State) -> Float[np.ndarray, "nb 6"]:
        """Return the bodies' accelerations (r_ddot [space], Omega_dot [body]) at the tree's ``start`` if u_dot = 0."""
        s, nb = start, len(self.limbs)
        R, Omega = np.concatenate((s.R, np.eye(3)[None])), np.concatenate((s.Omega, np.zeros((1, 3))))
        a, alpha = np.zeros((2, nb + 1, 3))
        for limb in self.limbs:
            if limb.kind is Kind.FREE:
                continue
            b, p = limb.body, limb.parent
            back = R[b].T @ R[p]
            carried = back @ Omega[p]
            alpha[b] = back @ alpha[p] + np.cross(carried, Omega[b] - carried)
            at_parent = np.cross(alpha[p], limb.s_parent) + np.cross(Omega[p], np.cross(Omega[p], limb.s_parent))
            if limb.kind is Kind.UNIVERSAL:
                first, last = self.start_velocity[limb.u_at : limb.u_at + 2]
                alpha[b] -= first * last * np.cross(limb.axis, limb.R_0.T @ limb.axis_parent)
            if limb.kind.slides:
                at_parent += 2.0 * self.start_velocity[limb.u_at] * np.cross(Omega[p], limb.axis_parent)
            at_child = np.cross(alpha[b], limb.s_child) + np.cross(Omega[b], np.cross(Omega[b], limb.s_child))
            a[b] = a[p] + R[p] @ at_parent - R[b] @ at_child
        return np.concatenate((a, alpha), axis=1)[:nb]

    def _unit_motions(self) -> States:
        """Return poses and velocities of all bodies at the start, with each velocity in turn 1 and all others 0."""
        n = len(self.start_velocity)
        return self.states(np.tile(self.start, (n, 1)), np.eye(n))


def build_spanning_tree(system: MultibodySystem, start: State) -> EngineTree:
    """Return the spanning tree of a system, its cut joints, drives and links, by the rule of the module's docstring.

    Raises ValueError for a joint that closes a loop and cannot be cut, and for a drive without a hinge or slide.
    """
    followed = {*JointKind, *MovingKind}.difference(DRIVES, LINKS)
    reached, children = walk_joints(system, followed, uncut=followed.difference(CUTTABLE))
    limbs: list[EngineLimb] = []
    sizes = [0, 0]

    def visit(body: int) -> None:
        """Append the limb of ``body`` to the tree, and its children to the pending bodies."""
        limb = _make_limb(system, start, body, *reached[body], *sizes)
        limbs.append(limb)
        sizes[0] += limb.kind.nq
        sizes[1] += limb.kind.nu
        pending.extend(reversed(children[body]))

    pending = list(reversed(children[GROUND]))
    while pending:
        visit(pending.pop())
    used = {joint for _, joint in reached.values()}
    cut = [k for k in range(system.nj) if k not in used and system.joint_kind(k) not in (*DRIVES, *LINKS)]
    for k in cut:
        if system.joint_kind(k) not in CUTTABLE:
            raise ValueError(
                f"{name_joint(system, k)} ({system.joint_kind(k)}) closes a loop, which only "
                "spherical and revolute joints can do here"
            )
    q, u = np.zeros(sizes[0]), np.zeros(sizes[1])
    for limb in limbs:
        q[limb.q_at : limb.q_at + limb.kind.nq], u[limb.u_at : limb.u_at + limb.kind.nu] = _find_start_coordinates(
            limb, start
        )
    bare = EngineTree(tuple(limbs), (), q, u)
    drives = tuple(_make_drive(system, bare, k) for k in range(system.nj) if system.joint_kind(k) in DRIVES)
    links = tuple(_make_link(system, k) for k in range(system.nj) if system.joint_kind(k) in LINKS)
    return EngineTree(bare.limbs, _find_coincidences(system, start, cut, bare), q, u, drives, links)


def _make_limb(
    system: MultibodySystem, start: State, body: int, parent: int, k: int, q_at: int, u_at: int
) -> EngineLimb:
    """Return the connection of ``body`` to its parent by joint ``k``; with k = -1 the body floats."""
    R_parent = np.eye(3) if parent == GROUND else start.R[parent]
    R_0, zero = R_parent.T @ start.R[body], np.zeros(3)
    if k < 0:
        return EngineLimb(body, GROUND, Kind.FREE, zero, zero, zero, zero, R_0, q_at, u_at)
    child_is_i, sort = system.joint_i[k] == body, system.joint_kind(k)
    s_parent, s_child = system.joint_s_j[k], system.joint_s_i[k]
    in_i, in_j = system.joint_u[k], system.joint_n[k, 0]  # the axes of a universal joint
    if sort != JointKind.UNIVERSAL:
        in_j = np.cross(*system.joint_n[k, :2])
    axis, axis_parent = (in_i, in_j) if child_is_i else (in_j, in_i)
    if not child_is_i:
        s_parent, s_child = s_child, s_parent
    kind = KINDS[JointKind(sort)]
    if kind.slides:  # the point of the parent where the child's is at the start
        r_parent = np.zeros(3) if parent == GROUND else start.r[parent]
        gap = R_parent.T @ (start.r[body] + start.R[body] @ s_child - r_parent) - s_parent
        s_parent = s_parent + axis_parent * (axis_parent @ gap)
    # the axes that the kind of connection does not have
    zero_last, zero_first = kind in (Kind.SLIDE, Kind.BALL, Kind.FIXED), not (kind.slides or kind is Kind.UNIVERSAL)
    axis, axis_parent = axis * (not zero_last), axis_parent * (not zero_first)
    return EngineLimb(body, parent, kind, s_parent, s_child, axis, axis_parent, R_0, q_at, u_at)


def _make_drive(system: MultibodySystem, tree: EngineTree, k: int) -> Drive:
    """Return the drive of joint ``k``, on the hinge or slide between the same bodies; ValueError if there is none."""
    i, j, name = int(system.joint_i[k]), int(system.joint_j[k]), system.joint_names[k]
    turns = system.joint_kind(k) == MovingKind.DRIVEN_ANGLE
    kind, n = Kind.HINGE if turns else Kind.SLIDE, system.joint_n[k]
    axis_j = np.cross(n[0], n[1]) if turns else n[0]
    for limb in tree.limbs:
        if limb.kind is kind and {limb.body, limb.parent} == {i, j}:
            ((_, in_child),) = limb.list_moves()
            along = float(in_child @ (axis_j if limb.body == j else limb.R_0.T @ axis_j))
            if abs(abs(along) - 1.0) < PARALLEL:
                # f with the sign of the coordinate, less its value at t = 0
                numbers = np.round(along) * (1.0 if limb.body == i else -1.0) * system.joint_motion[k]
                numbers[0] = -numbers[4] * np.sin(system.joint_motion[k, 6])
                numbers[5:] = system.joint_motion[k, 5:]
                return Drive(name, limb.body, limb.u_at, numbers)
    raise ValueError(f"{name_joint(system, k)}: the drive is not along the axis of a {kind.value[0]} of the tree")


def _make_link(system: MultibodySystem, k: int) -> PointLink:
    """Return joint ``k``, a distance or a point on a line, as a link."""
    axis, length = np.cross(*system.joint_n[k, :2]), float(system.joint_length[k])
    return PointLink(*_find_ends(system, k), axis, length)


def _find_ends(system: MultibodySystem, k: int) -> tuple[int, np.ndarray, int, np.ndarray]:
    """Return body i, its point, body j and its point of joint ``k``, in the order of ``Points``."""
    return int(system.joint_i[k]), system.joint_s_i[k], int(system.joint_j[k]), system.joint_s_j[k]


def _find_start_coordinates(limb: EngineLimb, start: State) -> tuple[np.ndarray, np.ndarray]:
    """Return coordinates and velocities of a limb at the start: 0 and unit quaternions, except of a free body."""
    b, p = limb.body, limb.parent
    if limb.kind is Kind.FREE:
        x, y, z, w = Rotation.from_matrix(start.R[b]).as_quat()
        return np.concatenate((start.r[b], (w, x, y, z))), np.concatenate((start.v[b], start.Omega[b]))
    v, Omega, R = (np.zeros(3), np.zeros(3), np.eye(3)) if p == GROUND else (start.v[p], start.Omega[p], start.R[p])
    relative = start.Omega[b] - limb.R_0.T @ Omega
    if limb.kind is Kind.BALL:
        return np.array([1.0, 0.0, 0.0, 0.0]), relative
    slip = R.T @ (start.v[b] + start.R[b] @ np.cross(start.Omega[b], limb.s_child) - v) - np.cross(Omega, limb.s_parent)
    u = [(slip @ limb.axis_parent) if slides else relative @ axis for slides, axis in limb.list_moves()]
    return np.zeros(len(u)), np.array(u)


def _find_coincidences(
    system: MultibodySystem, start: State, cut: list[int], tree: EngineTree
) -> tuple[Coincidence, ...]:
    """Return the pairs of points that have to coincide at the cut joints; none for a joint declared twice.

    A revolute joint has a second pair on its axis where that adds rank.
    """
    unit, out, axes = tree._unit_motions(), list[Coincidence](), list[Coincidence]()
    joined = [{limb.body, limb.parent} for limb in tree.limbs if limb.kind in (Kind.HINGE, Kind.BALL)]
    R = np.concatenate((start.R, np.eye(3)[None]))
    for k in cut:
        first, u = Coincidence(*_find_ends(system, k)), system.joint_u[k]
        arm = max(float(np.linalg.norm(first.s_i)), float(np.linalg.norm(first.s_j))) or 1.0
        u_j = R[first.j].T @ R[first.i] @ u
        # another point on the axis, at a distance of the size of the joint
        second = Coincidence(first.i, first.s_i + arm * u, first.j, first.s_j + arm * u_j)
        for to, point in ((out, first), (axes, second))[: 1 + bool(system.joint_revolute[k])]:
            if {first.i, first.j} not in joined or np.max(np.abs(_make_gap_jacobian(unit, [point]))) > PARALLEL * arm:
                to.append(point)
    known = find_rank(_make_gap_jacobian(unit, out))
    for second in axes:
        more = find_rank(_make_gap_jacobian(unit, [*out, second]))
        if more > known:
            known = more
            out.append(second)
    return tuple(out)


def _make_gap_jacobian(unit: States, cuts: Sequence[Coincidence]) -> Float[np.ndarray, "nl nu"]:
    """Return the Jacobian of the gaps of ``cuts``, three rows each; ``unit`` has the motion of each velocity at 1."""
    rows = [point_velocity(unit, c.i, c.s_i) - point_velocity(unit, c.j, c.s_j) for c in cuts]
    return np.concatenate(rows, axis=1).T if rows else np.zeros((0, len(unit)))


def find_rank(G: Float[np.ndarray, "nl nu"], largest: float = 0.0) -> int:
    """Return the rank of ``G``: singular values up to ``DEPENDENT`` times the largest or ``largest`` count as zero."""
    size = np.linalg.svd(G, compute_uv=False) if G.size else np.zeros(1)
    return int(np.sum(size > DEPENDENT * max(size[0], largest)))


def make_matrices(q: Float[np.ndarray, "nt 4"]) -> Float[np.ndarray, "nt 3 3"]:
    """Return rotation matrices of quaternions (w, x, y, z)."""
    return Rotation.from_quat(q, scalar_first=True).as_matrix()


def _rotate(R: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Return R a at each time."""
    return np.einsum("tij,tj->ti", R, a)
