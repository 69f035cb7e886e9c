"""Loops over all joints or forces of one kind, from their expressions, as the source of machine code.

All read numbers and blocks of body i, then of body j unless that is the ground: r, R, v, J^-1 or the first few of them.
"""

from itertools import chain

import casadi as ca

from ....harness.base.generated import GeneratedFunction, Loop
from .expressions import PushExpressions, RowExpressions, express_push, express_rows, list_by_rows, make_matrix


def make_row_loops(kind: str, of: tuple[int, ...], ground: bool) -> dict[str, Loop | GeneratedFunction]:
    """Return the functions ``rows`` and ``constants`` of a kind of joint's constraint rows, to be compiled.

    ``rows``: phi, gamma, torques X and Y = X J^-1 on the bodies; then forces of the rows and phi_t, where they vary.
    ``constants``: whether forces are constant, whether phi_t is zero, and these forces by rows (zero if they vary).
    ``of`` are the indices of the rows; with ``ground`` body j is the ground, and there is body i alone.
    """
    e, bodies = express_rows(kind, of), _make_body_symbols(ground, 4)
    A, phi, gamma, phi_t = substitute_bodies(e, [e.A, e.phi, e.gamma, e.phi_t], bodies)
    X = [A[:, 6 * k + 3 : 6 * k + 6] for k in range(len(bodies))]
    Y = [x @ make_matrix(body[3]) for x, body in zip(X, bodies, strict=True)]
    way = A[:, :3]
    fixed, scleronomic = way.is_constant(), (phi_t.is_constant() and phi_t.nnz() == 0) or bool(phi_t.is_zero())
    stored = [phi, gamma, *map(list_by_rows, (*X, *Y, *([] if fixed else [way]))), *([] if scleronomic else [phi_t])]
    constants = ca.vertcat(float(fixed), float(scleronomic), list_by_rows(way if fixed else ca.SX(len(of), 3)))
    return {
        "rows": Loop(whole=[e.t], rows=[e.numbers], stored=[ca.densify(x) for x in stored], blocks=[*chain(*bodies)]),
        "constants": GeneratedFunction([], [constants]),
    }


def make_row_slope_loops(kind: str, of: tuple[int, ...], ground: bool) -> dict[str, Loop | GeneratedFunction]:
    """Return the functions ``load_slopes`` and ``rate_slopes`` of a kind of joint's constraint rows, to be compiled.

    ``load_slopes``: d(A^T lam)/d(pose), added to blocks (6, 6) by rows, of i by i, i by j, j by i, j by j.
    ``rate_slopes``: d(phi_dot)/d(pose) (n, 6), by body i and by body j. With ``ground`` there is body i alone. ``of``
    are the indices of the rows.
    """
    e, bodies = express_rows(kind, of), _make_body_symbols(ground, 3)
    K, slopes = substitute_bodies(e, [e.load_slopes, e.rate_slopes], bodies, e.lam)
    poses = [part for body in bodies for part in body[:2]]
    stored = [list_by_rows(slopes[:, 6 * k : 6 * k + 6]) for k in range(len(bodies))]
    return {
        "load_slopes": Loop(whole=[e.t], rows=[e.numbers, e.lam], blocks=poses, added_blocks=_list_blocks(K, ground)),
        "rate_slopes": Loop(whole=[e.t], rows=[e.numbers], stored=stored, blocks=[*chain(*bodies)]),
    }


def make_load_loops(kind: str, ground: bool) -> dict[str, Loop | GeneratedFunction]:
    """Return the function ``push`` of a kind of force, to be compiled, which adds the load to that of each body.

    With ``ground`` body j is the ground, and there is body i alone.
    """
    e, bodies = express_push(kind), _make_body_symbols(ground, 3)
    (load,) = substitute_bodies(e, [e.load], bodies)
    added = [load[6 * k : 6 * k + 6] for k in range(len(bodies))]
    return {"push": Loop(whole=[e.t], rows=[e.numbers], blocks=[*chain(*bodies)], added_blocks=added)}


def make_load_slope_loops(kind: str, ground: bool) -> dict[str, Loop | GeneratedFunction]:
    """Return the function ``slopes`` of a kind of force, to be compiled.

    It adds the slopes of the load by poses, then by velocities, to blocks (6, 6) in the order of ``load_slopes``. With
    ``ground`` body j is the ground, and there is body i alone.
    """
    e, bodies = express_push(kind), _make_body_symbols(ground, 3)
    by_pose, by_rate = substitute_bodies(e, [e.pose_slopes, e.velocity_slopes], bodies)
    added = [*_list_blocks(by_pose, ground), *_list_blocks(by_rate, ground)]
    return {"slopes": Loop(whole=[e.t], rows=[e.numbers], blocks=[*chain(*bodies)], added_blocks=added)}


def make_body_loops() -> dict[str, Loop | GeneratedFunction]:
    """Return the functions ``forces``, ``applied``, ``slopes`` and ``zero`` of bodies alone, to be compiled.

    ``applied`` stores gravity as the load (6,) of each body, from its m g (3), J (9) and v (6); ``forces`` this less
    Omega x J Omega; ``slopes`` the derivatives of ``forces`` by velocities (36,), from J and v; ``zero`` zeros.
    """
    weight, J, v = ca.SX.sym("weight", 3), ca.SX.sym("J", 9), ca.SX.sym("v", 6)
    turning = ca.vertcat(ca.SX.zeros(3), -ca.cross(v[3:], make_matrix(J) @ v[3:]))
    still = ca.vertcat(weight, ca.SX.zeros(3))
    return {
        "forces": Loop(rows=[weight, J, v], stored=[ca.densify(still + turning)]),
        "applied": Loop(rows=[weight, J, v], stored=[ca.densify(still)]),
        "slopes": Loop(rows=[J, v], stored=[list_by_rows(ca.jacobian(turning, v))]),
        "zero": Loop(stored=[ca.SX(0.0)]),
    }


def _list_blocks(K: ca.SX, ground: bool) -> list[ca.SX]:
    """Return the blocks (6, 6) of slopes K (12, 12) by loaded and moving body, each as a column of its rows.

    With ``ground`` there is the block of body i alone.
    """
    ends = (slice(0, 6),) if ground else (slice(0, 6), slice(6, 12))
    return [list_by_rows(K[a, b]) for a in ends for b in ends]


def _make_body_symbols(ground: bool, n: int) -> list[list[ca.SX]]:
    """Return new symbols for the bodies that move, for each the first ``n`` of r, R, v, J^-1."""
    parts = (("r", 3), ("R", 9), ("v", 6), ("J_inv", 9))[:n]
    return [[ca.SX.sym(f"{name}_{end}", size) for name, size in parts] for end in ("i" if ground else "ij")]


def substitute_bodies(
    e: RowExpressions | PushExpressions, of: list[ca.SX], bodies: list[list[ca.SX]], *rest: ca.SX
) -> list[ca.SX]:
    """Return the expressions ``of`` with the symbols of ``bodies`` in place of the general ones.

    Where ``bodies`` has one entry, body j is the ground, at rest. ``rest`` are further symbols, which stay.
    """
    free = ca.Function("free", [e.x, e.V, e.t, e.numbers, *rest], of)
    i, j = [*bodies, [ca.SX.zeros(3), list_by_rows(ca.SX.eye(3)), ca.SX.zeros(6)]][:2]
    out = free(ca.vertcat(*i[:2], *j[:2]), ca.vertcat(i[2], j[2]), e.t, e.numbers, *rest)
    return [ca.simplify(x) for x in (out if isinstance(out, tuple) else (out,))]
