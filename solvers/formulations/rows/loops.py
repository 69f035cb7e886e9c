"""Loops over all joints or forces of one kind, from their expressions: what machine code is made of."""

from typing import NamedTuple

import casadi as ca

from ..generated import Loop
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


def push_loop(kind: str, ground: bool) -> Loop:
    """The loads of one kind added to both bodies; reads t; numbers; blocks r, R, v of body i, then of body j."""
    e = push_expressions(kind)
    i, j = _body("i"), _body("j")
    (load,) = _at(e, [e.load], i, j, ground)
    blocks = [*i[:3], *([] if ground else j[:3])]
    added = [load[:6], *([] if ground else [load[6:]])]
    return Loop(whole=[e.t], rows=[e.numbers], blocks=blocks, added_blocks=added)


def body_loop(*, gyroscopic: bool) -> Loop:
    """Gravity, less Omega x J Omega where asked for, stored as the load (n, 6); reads rows m g (3), J (9), v (6)."""
    weight, J, v = ca.SX.sym("weight", 3), ca.SX.sym("J", 9), ca.SX.sym("v", 6)
    torque = -ca.cross(v[3:], _matrix(J) @ v[3:]) if gyroscopic else ca.SX.zeros(3)
    return Loop(rows=[weight, J, v], stored=[ca.densify(ca.vertcat(weight, torque))])


def _body(end: str) -> list[ca.SX]:
    return [ca.SX.sym(f"{name}_{end}", size) for name, size in (("r", 3), ("R", 9), ("v", 6), ("J_inv", 9))]


def _at(
    e: RowExpressions | PushExpressions, of: list[ca.SX], i: list[ca.SX], j: list[ca.SX], ground: bool
) -> list[ca.SX]:
    """Expressions at the symbols of two bodies, the second of which may be the ground."""
    free = ca.Function("free", [e.x, e.V, e.t, e.numbers], of)
    r, R, v = (ca.SX.zeros(3), _by_rows(ca.SX.eye(3)), ca.SX.zeros(6)) if ground else j[:3]
    out = free(ca.vertcat(i[0], i[1], r, R), ca.vertcat(i[2], v), e.t, e.numbers)
    return [ca.simplify(x) for x in (out if isinstance(out, tuple) else (out,))]


def _matrix(a: ca.SX) -> ca.SX:
    return ca.reshape(a, 3, 3).T


def _by_rows(a: ca.SX) -> ca.SX:
    return ca.vec(ca.densify(a).T)
