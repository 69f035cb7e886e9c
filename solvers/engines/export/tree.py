"""A system as a tree in joint coordinates with cut joints: the form of engines that have joint coordinates.

The rule: breadth first from the ground, joints in their order; a joint that reaches a new body is a joint of the tree,
any other is cut. A part that nothing joins to the ground floats on its first body. Coordinates follow the tree depth
first, children in the order in which they were reached::

    hinge   1: angle from the start                      velocity 1
    ball    4: quaternion (w, x, y, z) from the start    velocity 3: relative angular velocity, frame of the child
    free    7: r, quaternion of R                        velocity 6: r_dot, Omega

    R_child = R_parent R_0 rot(q),   r_child = r_parent + R_parent s_parent - R_child s_child

A cut joint is points of two bodies that coincide: one for a spherical joint, and for a revolute joint a second one on
the axis, left out where its rows depend on the others at the start.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from enum import Enum
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ....harness.mechanics import so3
from ....harness.mechanics.motion import point_velocity
from ....harness.mechanics.state import State, States
from ....harness.mechanics.system import GROUND, MultibodySystem
from .model_check import rank


class Kind(Enum):
    """How a body hangs on its parent: sizes of its coordinates and velocities."""

    HINGE = (1, 1)
    BALL = (4, 3)
    FREE = (7, 6)


@dataclass(frozen=True)
class Limb:
    """A body and what it hangs on."""

    body: int
    parent: int  # or ``GROUND``
    kind: Kind
    s_parent: Float[np.ndarray, " 3"]
    s_child: Float[np.ndarray, " 3"]
    axis: Float[np.ndarray, " 3"]  # of a hinge, frame of the child
    R_0: Float[np.ndarray, "3 3"]  # from the parent to the child at the start; free: from space
    q_at: int  # first coordinate
    u_at: int  # first velocity


@dataclass(frozen=True)
class Coincidence:
    """Point ``s_i`` of body i is at point ``s_j`` of body j or the ground."""

    i: int
    s_i: Float[np.ndarray, " 3"]
    j: int
    s_j: Float[np.ndarray, " 3"]


@dataclass(frozen=True)
class Tree:
    """Limbs in the order of the coordinates, and the cut joints."""

    limbs: tuple[Limb, ...]
    cuts: tuple[Coincidence, ...]
    start: Float[np.ndarray, " nq"]
    start_velocity: Float[np.ndarray, " nu"]

    def states(self, q: Float[np.ndarray, "nt nq"], u: Float[np.ndarray, "nt nu"]) -> States:
        """Poses and velocities of all bodies."""
        nt, nb = len(q), len(self.limbs)
        r, v, Omega = np.zeros((3, nt, nb + 1, 3))  # the last body is the ground
        R = np.broadcast_to(np.eye(3), (nt, nb + 1, 3, 3)).copy()
        for limb in self.limbs:
            b, p = limb.body, limb.parent
            own_q = q[:, limb.q_at : limb.q_at + limb.kind.value[0]]
            own_u = u[:, limb.u_at : limb.u_at + limb.kind.value[1]]
            if limb.kind is Kind.FREE:
                r[:, b], R[:, b] = own_q[:, :3], _matrices(own_q[:, 3:])
                v[:, b], Omega[:, b] = own_u[:, :3], own_u[:, 3:]
                continue
            turn = so3.exp(own_q * limb.axis) if limb.kind is Kind.HINGE else _matrices(own_q)
            R[:, b] = R[:, p] @ limb.R_0 @ turn
            relative = own_u * limb.axis if limb.kind is Kind.HINGE else own_u
            Omega[:, b] = np.einsum("tji,tj->ti", limb.R_0 @ turn, Omega[:, p]) + relative
            r[:, b] = r[:, p] + R[:, p] @ limb.s_parent - R[:, b] @ limb.s_child
            v[:, b] = v[:, p] + _turned(R[:, p], np.cross(Omega[:, p], limb.s_parent))
            v[:, b] -= _turned(R[:, b], np.cross(Omega[:, b], limb.s_child))
        return States(r[:, :nb], R[:, :nb], v[:, :nb], Omega[:, :nb])

    def plain(self, system: MultibodySystem, start: State) -> dict[str, Any]:
        """What an engine is given, by names alone; vectors of bodies in their frames, of the ground in space."""
        limbs = [
            {**{f.name: getattr(limb, f.name) for f in fields(limb)}, "kind": limb.kind.name,
             "mass": system.mass[limb.body], "inertia": system.regular_inertia[limb.body],
             **{name: getattr(start, name)[limb.body] for name in ("r", "R", "v", "Omega")}}
            for limb in self.limbs
        ]  # fmt: skip
        springs = [
            {"i": system.spring_i[k], "p_i": system.spring_p_i[k], "j": system.spring_j[k], "p_j": system.spring_p_j[k],
             "stiffness": system.spring_k[k], "damping": system.spring_c[k], "rest_length": system.spring_d0[k]}
            for k in range(len(system.spring_k))
        ]  # fmt: skip
        cuts = [{f.name: getattr(cut, f.name) for f in fields(cut)} for cut in self.cuts]
        return {"gravity": system.gravity, "limbs": limbs, "cuts": cuts, "springs": springs,
                "start": self.start, "start_velocity": self.start_velocity}  # fmt: skip

    def jacobian(self) -> Float[np.ndarray, "twists nu"]:
        """T of (r_dot, Omega) = T u at the start, by bodies: velocities are linear in u."""
        s = self._unit_motions()
        return np.concatenate((s.v, s.Omega), axis=-1).reshape(len(s), -1).T

    def loop_jacobian(self) -> Float[np.ndarray, "nl nu"]:
        """Rate of the gaps of the cut joints = G u at the start."""
        return _gap_rates(self._unit_motions(), self.cuts)

    def bias(self, start: State) -> Float[np.ndarray, "nb 6"]:
        """(r_ddot, Omega_dot) at the start while u_dot = 0."""
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
            at_child = np.cross(alpha[b], limb.s_child) + np.cross(Omega[b], np.cross(Omega[b], limb.s_child))
            a[b] = a[p] + R[p] @ at_parent - R[b] @ at_child
        return np.concatenate((a, alpha), axis=1)[:nb]

    def _unit_motions(self) -> States:
        n = len(self.start_velocity)
        return self.states(np.tile(self.start, (n, 1)), np.eye(n))


def spanning_tree(system: MultibodySystem, start: State) -> Tree:
    """The tree and the cut joints, by the rule above."""
    reached, children = _breadth_first(system)
    limbs: list[Limb] = []
    sizes = [0, 0]

    def visit(body: int) -> None:
        limb = _limb(system, start, body, *reached[body], *sizes)
        limbs.append(limb)
        sizes[0] += limb.kind.value[0]
        sizes[1] += limb.kind.value[1]
        pending.extend(reversed(children[body]))

    pending = list(reversed(children[GROUND]))
    while pending:
        visit(pending.pop())
    used = {joint for _, joint in reached.values()}
    cut = [k for k in range(system.nj) if k not in used]
    q, u = np.zeros(sizes[0]), np.zeros(sizes[1])
    for limb in limbs:
        q[limb.q_at : limb.q_at + limb.kind.value[0]], u[limb.u_at : limb.u_at + limb.kind.value[1]] = _own(limb, start)
    bare = Tree(tuple(limbs), (), q, u)
    return Tree(bare.limbs, _coincidences(system, start, cut, bare._unit_motions()), q, u)


def _breadth_first(system: MultibodySystem) -> tuple[dict[int, tuple[int, int]], dict[int, list[int]]]:
    """(parent, joint) by body, joint -1 for a body that floats; children by body."""
    reached: dict[int, tuple[int, int]] = {}
    children: dict[int, list[int]] = {b: [] for b in range(GROUND, system.nb)}
    ends = list(zip(system.joint_i.tolist(), system.joint_j.tolist(), strict=True))

    def spread(queue: list[int]) -> None:
        while queue:
            parent = queue.pop(0)
            for k, (i, j) in enumerate(ends):
                other = j if i == parent else i if j == parent else parent
                if other not in (GROUND, parent) and other not in reached:
                    reached[other] = (parent, k)
                    children[parent].append(other)
                    queue.append(other)

    spread([GROUND])
    for b in range(system.nb):
        if b not in reached:
            reached[b] = (GROUND, -1)
            children[GROUND].append(b)
            spread([b])
    return reached, children


def _limb(system: MultibodySystem, start: State, body: int, parent: int, k: int, q_at: int, u_at: int) -> Limb:
    R_parent = np.eye(3) if parent == GROUND else start.R[parent]
    R_0, zero = R_parent.T @ start.R[body], np.zeros(3)
    if k < 0:
        return Limb(body, GROUND, Kind.FREE, zero, zero, zero, R_0, q_at, u_at)
    child_is_i = system.joint_i[k] == body
    s = (system.joint_s_j[k], system.joint_s_i[k]) if child_is_i else (system.joint_s_i[k], system.joint_s_j[k])
    kind = Kind.HINGE if system.joint_revolute[k] else Kind.BALL
    axis = system.joint_u[k] if child_is_i else np.cross(*system.joint_n[k, :2])
    return Limb(body, parent, kind, *s, axis, R_0, q_at, u_at)


def _own(limb: Limb, start: State) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates and velocities of a limb at the start."""
    b = limb.body
    if limb.kind is Kind.FREE:
        x, y, z, w = Rotation.from_matrix(start.R[b]).as_quat()
        return np.concatenate((start.r[b], (w, x, y, z))), np.concatenate((start.v[b], start.Omega[b]))
    carried = np.zeros(3) if limb.parent == GROUND else limb.R_0.T @ start.Omega[limb.parent]
    relative = start.Omega[b] - carried
    if limb.kind is Kind.HINGE:
        return np.zeros(1), np.array([relative @ limb.axis])
    return np.array([1.0, 0.0, 0.0, 0.0]), relative


def _coincidences(system: MultibodySystem, start: State, cut: list[int], unit: States) -> tuple[Coincidence, ...]:
    """Points of the cut joints; second points on axes where they say more."""
    out = [Coincidence(int(system.joint_i[k]), system.joint_s_i[k], int(system.joint_j[k]), system.joint_s_j[k])
           for k in cut]  # fmt: skip
    R = np.concatenate((start.R, np.eye(3)[None]))
    known = rank(_gap_rates(unit, out))
    for k, first in zip(cut, tuple(out), strict=True):
        if not system.joint_revolute[k]:
            continue
        in_i = system.joint_u[k]
        in_j = R[first.j].T @ R[first.i] @ in_i
        along = max(float(np.linalg.norm(first.s_i)), float(np.linalg.norm(first.s_j))) or 1.0
        second = Coincidence(first.i, first.s_i + along * in_i, first.j, first.s_j + along * in_j)
        more = rank(_gap_rates(unit, [*out, second]))
        if more > known:
            known = more
            out.append(second)
    return tuple(out)


def _gap_rates(unit: States, cuts: Sequence[Coincidence]) -> Float[np.ndarray, "nl nu"]:
    rows = [point_velocity(unit, c.i, c.s_i) - point_velocity(unit, c.j, c.s_j) for c in cuts]
    return np.concatenate(rows, axis=1).T if rows else np.zeros((0, len(unit)))


def _matrices(q: Float[np.ndarray, "nt 4"]) -> Float[np.ndarray, "nt 3 3"]:
    return Rotation.from_quat(q, scalar_first=True).as_matrix()


def _turned(R: np.ndarray, a: np.ndarray) -> np.ndarray:
    return np.einsum("tij,tj->ti", R, a)
