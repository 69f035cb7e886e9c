"""Rows of a tree: those that close its loops, those that hold opened balls, and reactions of all of its joints."""

from functools import cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from ....harness.mechanics.fixed_order import apply
from ....harness.mechanics.joint_tree import Limb, remove_rounding
from ....harness.mechanics.system import GROUND
from ..rows.expressions import express_rows, list_joint_parameters
from .motion import ZERO, TreeMotion, Wrench, weighted_sum


class LoopRow(NamedTuple):
    """A row: entries by velocities {number: entry}, phi, phi_dot, and phi_ddot at the motion's accelerations."""

    J: dict[int, ca.SX]
    phi: ca.SX
    rate: ca.SX
    acceleration: ca.SX


def list_loop_rows(motion: TreeMotion) -> list[LoopRow]:
    """Return the constraint rows of the cut joints, which close the tree's loops.

    Beyond the body that the paths of both ends have in common, the forces of a row balance.
    """
    out = []
    for k in motion.tree.cuts:
        ends = int(motion.system.joint_i[k]), int(motion.system.joint_j[k])
        A, phi, phi_t, gamma = _evaluate_joint(motion, k)
        below = _find_common_body(motion, *ends)
        if any(b in motion.opened for e in ends for b in _list_outboard(motion, e, below)):
            below = GROUND  # no loads meet at the ground
        balls = any(motion.limb[b].ball for e in ends for b in _list_outboard(motion, e, below))
        for row in range(A.shape[0]):
            J: dict[int, ca.SX] = {}
            left = ZERO
            rate, acceleration = phi_t[row], gamma[row]
            for e, b in enumerate(ends):
                if b == GROUND:
                    continue
                f, n = A[row, 6 * e : 6 * e + 3].T, A[row, 6 * e + 3 : 6 * e + 6].T
                c, omega = motion.centre[b], motion.omega[b]
                rate += ca.dot(f, motion.v[b] + ca.cross(omega, c)) + ca.dot(n, omega)
                acceleration += ca.dot(f, motion.a[b] + motion.W[b] @ c) + ca.dot(n, motion.alpha[b])
                load = Wrench(f, n + ca.cross(c, f))
                for u, entry in motion.project_load(b, load, below):
                    J[u] = J.get(u, 0) + entry
                left = left + _transmit_moment(motion, b, load, below) if balls else left
            if below != GROUND:  # forces are in balance there; moments are not, if a ball passes none on
                for u, entry in motion.project_load(below, Wrench(ZERO, left)):
                    J[u] = J.get(u, 0) + entry
            out.append(LoopRow({u: x for u, x in J.items() if not x.is_zero()}, phi[row], rate, acceleration))
    return out


def list_ball_rows(motion: TreeMotion) -> list[LoopRow]:
    """Return the rows that close opened ball joints: the freed velocity of P equals that of the parent there.

    Their phi, rate and acceleration are zero.
    """
    out = []
    for b in motion.opened:
        for k, e in motion.list_freed_directions(b):
            J = {u: -x for u, x in motion.project_load(motion.limb[b].parent, motion.transmit_load(b, Wrench(e, ZERO)))}
            out.append(LoopRow({u: x for u, x in J.items() if not x.is_zero()} | {k: ca.SX(1)}, *[ca.SX(0)] * 3))
    return out


def compute_row_loads(motion: TreeMotion, lam: ca.SX) -> dict[int, Wrench]:
    """Return the wrench of the cut joints with the multipliers ``lam`` on each body, about its point P."""
    out = {b: Wrench(ZERO, ZERO) for b in motion.limb}
    at = 0
    for k in motion.tree.cuts:
        ends = int(motion.system.joint_i[k]), int(motion.system.joint_j[k])
        A = _evaluate_joint(motion, k)[0]
        load = A.T @ lam[at : at + A.shape[0]]
        at += A.shape[0]
        for e, b in enumerate(ends):
            if b != GROUND:
                f, n = load[6 * e : 6 * e + 3], load[6 * e + 3 : 6 * e + 6]
                out[b] = Wrench(out[b].f + f, out[b].n + n + ca.cross(motion.centre[b], f))
    return out


def compute_reaction(motion: TreeMotion, limb: Limb, load: Wrench) -> ca.SX:
    """Return the multipliers of a tree joint's rows from ``load``, the wrench that the joint carries, about P.

    The rows are orthonormal about the joint's point on body i, so that each multiplier is a projection.
    """
    A = _evaluate_joint(motion, limb.joint, at_joint=True)[0]
    sign = 1.0 if limb.child_is_i else -1.0
    arm = motion.R[limb.parent] @ ca.SX(ca.DM(limb.point_of_i))  # from P to the point of i
    if not limb.child_is_i:
        slides = motion.axes[limb.body].slides
        arm = arm - weighted_sum(slides, [motion.q[limb.q_at + k] for k in range(len(slides))])
    return sign * (A[:, :3] @ load.f + A[:, 3:6] @ (load.n - ca.cross(arm, load.f)))


def _evaluate_joint(motion: TreeMotion, k: int, *, at_joint: bool = False) -> tuple[ca.SX, ...]:
    """Return A, phi, phi_t, gamma of joint ``k``, with phi_dot = A (v of C, omega of both bodies) + phi_t.

    With ``at_joint``, the joint's point takes the place of C on each body, and only A is valid.
    """
    s, ends = motion.system, (int(motion.system.joint_i[k]), int(motion.system.joint_j[k]))
    numbers = list_joint_parameters(s, np.array([k]))[0]
    i, j = (motion.frame(b).T for b in ends)
    size = float(np.max(np.abs(numbers[:6]), initial=0.0))
    for at, frame in ((0, i), (3, j), (6, i), (9, i), (12, j), (15, j), (18, j)):
        numbers[at : at + 3] = remove_rounding(apply(frame.T, numbers[at : at + 3]), size if at < 6 else 1.0)
    if at_joint:
        numbers[:6] = 0.0
    x, V = [], []
    for b in ends:
        x += [ZERO if at_joint else motion.P[b] + motion.centre[b], ca.vec(motion.R[b].T)]
        V += [motion.v[b] + ca.cross(motion.omega[b], motion.centre[b]), motion.omega[b]]
    return _make_row_function(str(s.joint_kind(k)))(ca.vertcat(*x), ca.vertcat(*V), motion.t, numbers)


def _list_inward_path(motion: TreeMotion, b: int) -> list[int]:
    """Return the bodies from ``b`` along parents to the ground, both included."""
    path = [b]
    while b != GROUND:
        b = motion.limb[b].parent
        path.append(b)
    return path


def _find_common_body(motion: TreeMotion, i: int, j: int) -> int:
    """Return the first body, or the ground, that the paths from ``i`` and ``j`` along parents have in common."""
    above = set(_list_inward_path(motion, j))
    return next(b for b in _list_inward_path(motion, i) if b in above)


def _list_outboard(motion: TreeMotion, b: int, below: int) -> list[int]:
    """Return the bodies from ``b`` along parents to ``below``, which is excluded."""
    path = _list_inward_path(motion, b)
    return path[: path.index(below)]


def _transmit_moment(motion: TreeMotion, b: int, load: Wrench, below: int) -> ca.SX:
    """Return the moment, about the P of ``below``, that the joints transmit to that body from a ``load`` on ``b``."""
    while b != below:
        load, b = motion.transmit_load(b, load), motion.limb[b].parent
    return load.n


@cache
def _make_row_function(kind: str) -> ca.Function:
    """Return A, phi, phi_t, gamma of a kind of joint as a CasADi function of poses, velocities, time and parameters."""
    e = express_rows(kind, None, space=True)
    return ca.Function("rows", [e.x, e.V, e.t, e.numbers], [e.A, e.phi, e.phi_t, e.gamma])
