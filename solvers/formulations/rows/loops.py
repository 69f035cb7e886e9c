"""Loops over all joints or forces of one kind, from their expressions: what machine code is made of."""

from typing import NamedTuple

import casadi as ca

from ..generated import Loop, Straight
from .expressions import PushExpressions, RowExpressions, push_expressions, row_expressions


class RowLoop(NamedTuple):
    """A loop, and what it leaves out because it is constant: forces (n, 3) of the rows, whether phi_t is zero."""

    loop: Loop
    way: ca.DM | None
    still: bool


def row_loop(kind: str, rows: tuple[int, ...], ground: bool) -> RowLoop:
    """phi, gamma, X and Y = X J^-1 on body i and, unless on the ground, on body j; then way and phi_t, where they vary.

    Reads t; numbers; blocks r, R, v, J^-1 of body i, then of body j.
    """
    e = row_expressions(kind, rows)
    i, j = _body("i"), _body("j")
    A, phi, gamma, phi_t = _at(e, [e.A, e.phi, e.gamma, e.phi_t], i, j, ground)
    X, ends = [A[:, 3:6], A[:, 9:12]], 1 if ground else 2
    Y = [X[0] @ _matrix(i[3]), X[1] @ _matrix(j[3])]
    way = A[:, :3]
    constant, still = way.is_constant(), (phi_t.is_constant() and phi_t.nnz() == 0) or bool(phi_t.is_zero())
    stored = [phi, gamma, *map(_by_rows, X[:ends]), *map(_by_rows, Y[:ends])]
    stored += [] if constant else [_by_rows(way)]
    stored += [] if still else [phi_t]
    blocks = [*i, *([] if ground else j)]
    loop = Loop(whole=[e.t], rows=[e.numbers], stored=[ca.densify(x) for x in stored], blocks=blocks)
    return RowLoop(loop, ca.DM(way) if constant else None, still)


def constants(way: ca.DM | None, still: bool, n: int) -> Straight:
    """Whether ``way`` is constant, ``still``, and ``way`` by rows."""
    values = ca.SX(n, 3) if way is None else ca.SX(way)
    return Straight([], [ca.vertcat(float(way is not None), float(still), _by_rows(values))])


def push_loop(kind: str, ground: bool) -> Loop:
    """The loads of one kind added to both bodies; reads t; numbers; blocks r, R, v of body i, then of body j."""
    e = push_expressions(kind)
    i, j = _body("i"), _body("j")
    (load,) = _at(e, [e.load], i, j, ground)
    blocks = [*i[:3], *([] if ground else j[:3])]
    added = [load[:6], *([] if ground else [load[6:]])]
    return Loop(whole=[e.t], rows=[e.numbers], blocks=blocks, added_blocks=added)


def load_slope_loop(kind: str, rows: tuple[int, ...], ground: bool) -> Loop:
    """d(A^T lam)/d(pose) added to blocks (6, 6), by rows: of i by i and, unless on the ground, i by j, j by i, j by j.

    Reads t; numbers; lam; blocks r, R of body i, then of body j.
    """
    e = row_expressions(kind, rows)
    i, j = _body("i"), _body("j")
    (K,) = _at(e, [e.load_slopes], i, j, ground, e.lam)
    blocks = [*i[:2], *([] if ground else j[:2])]
    return Loop(whole=[e.t], rows=[e.numbers, e.lam], blocks=blocks, added_blocks=_blocks(K, ground))


def rate_slope_loop(kind: str, rows: tuple[int, ...], ground: bool) -> Loop:
    """d(phi_dot)/d(pose) (n, 6), by body i and, unless on the ground, by body j.

    Reads t; numbers; blocks r, R, v of body i, then of body j.
    """
    e = row_expressions(kind, rows)
    i, j = _body("i"), _body("j")
    (slopes,) = _at(e, [e.rate_slopes], i, j, ground)
    stored = [_by_rows(slopes[:, :6]), *([] if ground else [_by_rows(slopes[:, 6:])])]
    return Loop(whole=[e.t], rows=[e.numbers], stored=stored, blocks=[*i[:3], *([] if ground else j[:3])])


def push_slope_loop(kind: str, ground: bool) -> Loop:
    """Slopes of the loads of one kind by poses, then by velocities, added to blocks as ``load_slope_loop`` does.

    Reads t; numbers; blocks r, R, v of body i, then of body j.
    """
    e = push_expressions(kind)
    i, j = _body("i"), _body("j")
    by_pose, by_rate = _at(e, [e.pose_slopes, e.velocity_slopes], i, j, ground)
    added = [*_blocks(by_pose, ground), *_blocks(by_rate, ground)]
    blocks = [*i[:3], *([] if ground else j[:3])]
    return Loop(whole=[e.t], rows=[e.numbers], blocks=blocks, added_blocks=added)


def body_slope_loop() -> Loop:
    """Slopes of ``body_loop`` with its gyroscopic torque by velocities, stored (n, 36); reads rows J (9), v (6)."""
    J, v = ca.SX.sym("J", 9), ca.SX.sym("v", 6)
    load = ca.vertcat(ca.SX.zeros(3), -ca.cross(v[3:], _matrix(J) @ v[3:]))
    return Loop(rows=[J, v], stored=[_by_rows(ca.jacobian(load, v))])


def zero_loop() -> Loop:
    """Numbers set to zero."""
    return Loop(stored=[ca.SX(0.0)])


def _blocks(K: ca.SX, ground: bool) -> list[ca.SX]:
    ends = (slice(0, 6),) if ground else (slice(0, 6), slice(6, 12))
    return [_by_rows(K[a, b]) for a in ends for b in ends]


def body_loop(*, gyroscopic: bool) -> Loop:
    """Gravity, less Omega x J Omega where asked for, stored as the load (n, 6); reads rows m g (3), J (9), v (6)."""
    weight, J, v = ca.SX.sym("weight", 3), ca.SX.sym("J", 9), ca.SX.sym("v", 6)
    torque = -ca.cross(v[3:], _matrix(J) @ v[3:]) if gyroscopic else ca.SX.zeros(3)
    return Loop(rows=[weight, J, v], stored=[ca.densify(ca.vertcat(weight, torque))])


def _body(end: str) -> list[ca.SX]:
    return [ca.SX.sym(f"{name}_{end}", size) for name, size in (("r", 3), ("R", 9), ("v", 6), ("J_inv", 9))]


def _at(
    e: RowExpressions | PushExpressions, of: list[ca.SX], i: list[ca.SX], j: list[ca.SX], ground: bool, *rest: ca.SX
) -> list[ca.SX]:
    """Expressions at the symbols of two bodies, the second of which may be the ground."""
    free = ca.Function("free", [e.x, e.V, e.t, e.numbers, *rest], of)
    r, R, v = (ca.SX.zeros(3), _by_rows(ca.SX.eye(3)), ca.SX.zeros(6)) if ground else j[:3]
    out = free(ca.vertcat(i[0], i[1], r, R), ca.vertcat(i[2], v), e.t, e.numbers, *rest)
    return [ca.simplify(x) for x in (out if isinstance(out, tuple) else (out,))]


def _matrix(a: ca.SX) -> ca.SX:
    return ca.reshape(a, 3, 3).T


def _by_rows(a: ca.SX) -> ca.SX:
    return ca.vec(ca.densify(a).T)
