"""Loops over joints of a kind for ODE-GC's Eqs. (74), (75) and (79), and code of a step for one mechanism.

D are the wrenches of the rows on both bodies (force, torque about C), D_dot their rates along the motion, M_bar, f_bar
and c_R those of Eqs. (30), (31), B is dt/2 times the switch of the B term of Eq. (71), Z0 = D0 + B D_dot0; suffix 0 is
the start of a step, 1 its end. ``OF_JOINTS`` of ``methods.gc_step`` and ``methods.gc_newton`` says what each function
reads and writes. The simplified method is in space, under gravity alone; the full one has torques in the body, and its
motion at the end turns by theta = T dOmega1. It leaves out the slopes of M_bar and of C_bar, K_bar, and those of f_bar
by the forces: of order dt^2.
"""

from collections.abc import Sequence
from functools import cache
from math import prod
from typing import Any

import casadi as ca
import numpy as np

from ....harness.base.generated import GeneratedFunction, Loop
from .expressions import (
    differentiate_by_pose,
    differentiate_pose,
    express_rows,
    find_distinct_entries,
    list_by_rows,
    make_matrix,
)
from .loops import substitute_bodies
from .mechanism import JointPart, SymbolicMechanism, SymbolicState, add_to_bodies, make_column, multiply_row
from .numbers import NUMBERS

ALONG_A, ALONG_MASS, TRANSLATION = range(3)  # c of Eq. (31): a/(a . a), M^-1 a/(a . M^-1 a), (e_k, 0)
IN_SPACE = (("r", 3), ("R", 9), ("u", 6), ("numbers", 22))  # numbers: m g, m, J^-1, J
BODY = (("r", 3), ("R", 9), ("v", 6), ("force", 6), ("inertia", 19), ("T", 9))  # inertia: m, J, J^-1
IN_A_PRODUCT = 16  # ratios of pivots, each above 1e-9, of which one logarithm is taken


def express_bar_terms(
    A: ca.SX, ends: Sequence[tuple[ca.SX, ca.SX, ca.SX, ca.SX]], direction: int
) -> tuple[ca.SX, ca.SX, list[ca.SX]]:
    """Return M_bar = c . M c and f_bar = c . f (n,) of the rows ``A`` (n, 12), and c on each end, a list of (n, 6).

    A has torques in the body. ``ends`` has, for each body that moves, its mass, J, J^-1 and load (force [space], torque
    [body]). ``direction`` of c in Eq. (31) is ``ALONG_A``, ``ALONG_MASS`` or ``TRANSLATION``.
    """
    n, c = A.shape[0], list[ca.SX]()
    if direction == TRANSLATION:
        mass, _, _, f = ends[0]
        return ca.SX.ones(n) * mass, A[:, :3] @ f[:3], [ca.horzcat(A[:, :3], ca.SX(n, 3)), ca.SX(n, 6)][: len(ends)]
    size: Any = 0
    inertia: Any = 0
    force: Any = 0
    for end, (mass, J, J_inv, f) in enumerate(ends):
        way, X = A[:, 6 * end : 6 * end + 3], A[:, 6 * end + 3 : 6 * end + 6]
        z, y = (way, X) if direction == ALONG_A else (way / mass, X @ J_inv)
        size += ca.sum2(way * z) + ca.sum2(X * y)
        inertia += mass * ca.sum2(z * z) + ca.sum2((y @ J) * y)
        force += z @ f[:3] + y @ f[3:]
        c.append(ca.horzcat(z, y))
    m_bar = inertia / (size * size) if direction == ALONG_A else 1 / size
    return m_bar, force / size, [x / ca.repmat(size, 1, 6) for x in c]


@cache
def express_wrenches(kind: str, of: tuple[int, ...], ends: int, direction: int) -> ca.Function:
    """Return the wrenches in space of rows of a kind of joint as a CasADi function, under gravity alone.

    It takes poses (24,), velocities in space (12,), t, parameters of the joint and of both bodies (``IN_SPACE``), B and
    nu; it returns Z = D + B D_dot (6 or 12, n), D, f_bar, M_bar phi_dot^2 and D_dot nu. ``of`` are the indices of the
    rows, ``ends`` the number of bodies that move, 1 or 2; ``direction`` is that of c in Eq. (31).
    """
    e, nu, B = express_rows(kind, of, space=True), ca.SX.sym("nu", len(of)), ca.SX.sym("B")
    bodies = [ca.SX.sym(f"numbers_{end}", 22) for end in "ij"]
    rate = ca.jtimes(e.A.T @ nu, ca.vertcat(e.x, e.t), ca.vertcat(differentiate_pose(e.x, e.V, space=True), 1))
    turn = [ca.diagcat(ca.SX.eye(3), make_matrix(e.x[12 * end + 3 : 12 * end + 12])) for end in range(2)]
    inertias = [
        (x[3], make_matrix(x[13:22]), make_matrix(x[4:13]), ca.vertcat(x[:3], ca.SX(3, 1))) for x in bodies[:ends]
    ]
    m_bar, f_bar, _ = express_bar_terms(e.A @ ca.diagcat(*turn), inertias, direction)
    Z = e.A.T + B * ca.jacobian(rate, nu)
    given = [e.x, e.V, e.t, e.numbers, *bodies, B, nu]
    found = [Z[: 6 * ends, :], e.A.T[: 6 * ends, :], f_bar, m_bar * e.phi_dot**2, rate[: 6 * ends]]
    return ca.Function("wrenches", given, found)


def wrench_loops(
    kind: str, rows: tuple[int, ...], ground: bool, direction: int, *, use_f_bar: bool
) -> dict[str, Loop | GeneratedFunction]:
    """Return the functions ``OF_JOINTS`` of ``methods.gc_step`` for a kind of joint, and ``sizes``, to be compiled.

    ``sizes`` returns how many entries of Z are kept from the start of a step, and of D from its end. ``rows`` are the
    indices of the rows; with ``ground`` body j is the ground. ``direction`` is that of c in Eq. (31). Without
    ``use_f_bar``, f_bar of Eq. (30) is taken as zero.
    """
    (i, j), bodies = _make_bodies(IN_SPACE, ground)
    t, numbers, plan = ca.SX.sym("t"), ca.SX.sym("p", NUMBERS), ca.SX.sym("plan", 3)
    x, nu_start = (ca.SX.sym(name, len(rows)) for name in ("x", "nu_start"))
    poses, velocities = ca.vertcat(*i[:2], *j[:2]), ca.vertcat(i[2], j[2])
    wrench = express_wrenches(kind, rows, len(bodies), direction)
    Z, D, f_bar, slip, rate = wrench(poses, velocities, t, numbers, i[3], j[3], plan[1], x)
    f_bar = f_bar if use_f_bar else ca.SX.zeros(len(rows))
    w, first = D @ (x - plan[0] * f_bar) - plan[1] * rate, -plan[0] * (D @ f_bar)
    Z, D, w, f_bar, first, slip = (ca.simplify(a) for a in (Z, D, w, f_bar, first, slip))
    (kept0, values0), Z_kept = _name_entries(Z)
    (kept, values), D_kept = _name_entries(D)
    u = ca.vertcat(*[body[2] for body in bodies])
    return {
        "start": Loop(
            whole=[t, plan],
            rows=[numbers],
            blocks=[part for body in bodies for part in body],
            stored=[values0, ca.densify(slip), *([ca.densify(f_bar)] if use_f_bar else [])],
            added_blocks=list_by_ends(first),
        ),
        "impulses": Loop(
            whole=[t, plan],
            rows=[numbers, kept0, x, nu_start],
            blocks=[part for body in bodies for part in body[: 4 if use_f_bar else 3]],
            stored=[values],
            added_blocks=list_by_ends(w - Z_kept @ (plan[2] * x + nu_start)),
        ),
        "rates": Loop(rows=[kept], blocks=[body[2] for body in bodies], stored=[ca.densify(-D_kept.T @ u)]),
        "loads": Loop(rows=[kept, x], added_blocks=list_by_ends(D_kept @ x)),
        "sizes": GeneratedFunction([], [ca.DM([kept0.numel(), kept.numel()])]),
    }


def newton_loops(
    kind: str, rows: tuple[int, ...], ground: bool, direction: int, *, symmetric: bool, use_f_bar: bool, couple: bool
) -> dict[str, Loop]:
    """Return the functions ``OF_JOINTS`` of ``methods.gc_newton`` for a kind of joint, to be compiled.

    ``rows`` are the indices of its rows; with ``ground`` body j is the ground. ``direction`` is that of c in Eq. (31).
    ``symmetric`` is for the symmetric gauge, in which nu0 depends on nu1. ``couple`` adds slopes of each body's load by
    the other body and, with ``use_f_bar``, those of f_bar of Eq. (30) by poses.
    """
    e, n, (both, moving), plan = express_rows(kind, rows), len(rows), _make_bodies(BODY, ground), ca.SX.sym("plan", 3)
    ends, (half, B, gauge) = len(moving), ca.vertsplit(plan)
    symbols = nu, on_D, on_D_dot, nu_start, G0, stiffness, on_phi_dot, on_phi = [ca.SX.sym("x", n) for _ in range(8)]
    inertias = [(b[4][0], make_matrix(b[4][1:10]), make_matrix(b[4][10:19]), b[3]) for b in moving]
    m_bar, f_bar, c = express_bar_terms(e.A, inertias, direction)
    D = e.A.T  # torques in the body
    D_dot = ca.jtimes(D, ca.vertcat(e.x, e.t), ca.vertcat(differentiate_pose(e.x, e.V), 1))
    turns = slice(3, 6), slice(9, 12)  # of both bodies
    for turn in turns:  # the rate in space of a torque in the body, R^T (R torque)_dot = torque_dot + Omega x torque
        D_dot[turn, :] += ca.skew(e.V[turn]) @ D[turn, :]
    load = D @ on_D + D_dot @ on_D_dot
    by_pose, by_rate = differentiate_by_pose(load, e.x), ca.jacobian(load, e.V)
    if couple and use_f_bar and direction != TRANSLATION:
        by_pose = by_pose + D @ (half * differentiate_by_pose(f_bar, e.x))

    def differentiate(by_pose: ca.SX, by_rate: ca.SX) -> ca.SX:
        """Return slopes (., 12) by the velocities at the end of the step, from those by poses and by velocities.

        A change of the velocities moves the end by dr = dt/2 dr_dot, theta = T dOmega.
        """
        parts = []
        for move, turn, body in zip((slice(0, 3), slice(6, 9)), turns, both, strict=True):
            parts.append(half * by_pose[:, move] + by_rate[:, move])
            parts.append(by_pose[:, turn] @ make_matrix(body[5]) + by_rate[:, turn])
        return ca.horzcat(*parts)

    K = differentiate(by_pose, by_rate)
    for turn, body in zip(turns, both, strict=True):  # R^T d(R torque) = d torque - torque x theta
        K[turn, turn] += -ca.skew(load[turn]) @ make_matrix(body[5])
    row = ca.diag(on_phi_dot) @ differentiate(differentiate_by_pose(e.phi_dot, e.x), ca.jacobian(e.phi_dot, e.V))
    row += ca.diag(on_phi) @ differentiate(differentiate_by_pose(e.phi, e.x), ca.SX(n, 12))
    # torques from the body to space
    in_space = ca.diagcat(*[ca.diagcat(ca.SX.eye(3), make_matrix(b[1])) for b in both])

    def express(*of: ca.SX) -> list[ca.SX]:
        """Return expressions, simplified, with the symbols of ``moving`` bodies in place of the general ones."""
        rest = [part for body in moving for part in (body[1], *body[3:])]
        return substitute_bodies(e, [ca.densify(x) for x in of], moving, *rest, plan, *symbols)

    Z0, first = express((in_space @ (D + B * D_dot))[: 6 * ends, :], (in_space @ D)[: 6 * ends, :] @ (-half * G0))
    pushed, phi, rate, m_bar, f_bar, *c = express(load[: 6 * ends], e.phi, e.phi_dot, m_bar, f_bar, *c)
    column, row, K = express((-D @ ca.diag(stiffness) + B * D_dot)[: 6 * ends, :], row, K)
    kept, Z0_kept = ca.SX.sym("kept", Z0.numel()), ca.SX(Z0)  # Z0 with symbols for the entries that vary
    for entry in range(Z0.numel()):
        if not Z0[entry].is_constant():
            Z0_kept[entry] = kept[entry]
    if symmetric:
        turned_back = ca.diagcat(*[ca.diagcat(ca.SX.eye(3), make_matrix(b[1]).T) for b in moving])
        pushed = pushed + turned_back @ (Z0_kept @ (gauge * nu))
        column = column + gauge * (turned_back @ Z0_kept)
    blocks = [(a, b) for a in range(ends) for b in range(ends) if couple or a == b]
    parts = [column[6 * b : 6 * b + 6, :] for b in range(ends)] + [row[:, 6 * b : 6 * b + 6] for b in range(ends)]
    given = {"whole": [e.t, plan], "rows": [e.numbers, kept, *symbols], "blocks": [x for body in moving for x in body]}
    return {
        "measure": Loop(**given, stored=[phi, rate, m_bar, f_bar]),
        "direction": Loop(**given, stored=[list_by_rows(x) for x in c]),
        "begin": Loop(
            **given, stored=[ca.vec(Z0)] if symmetric else [], added_blocks=list_by_ends(Z0 @ nu_start + first)
        ),
        "balance": Loop(**given, added_blocks=list_by_ends(pushed)),
        "slopes": Loop(
            **given,
            stored=[list_by_rows(x) for x in parts],
            added_blocks=[list_by_rows(K[6 * a : 6 * a + 6, 6 * b : 6 * b + 6]) for a, b in blocks],
        ),
    }


def list_by_ends(w: ca.SX) -> list[ca.SX]:
    """Return the load ``w`` (6 or 12,) as a list of the six entries of each body."""
    return [ca.densify(w[at : at + 6]) for at in range(0, w.numel(), 6)]


def _make_bodies(parts: Sequence[tuple[str, int]], ground: bool) -> tuple[list[list[ca.SX]], list[list[ca.SX]]]:
    """Return the quantities ``parts`` of bodies i and j as symbols, and those of the bodies that move alone.

    ``parts`` are names and sizes, r and R first. With ``ground`` body j is at rest at the origin, with R = I.
    """
    i, j = ([ca.SX.sym(f"{part}_{end}", size) for part, size in parts] for end in "ij")
    if not ground:
        return [i, j], [i, j]
    return [i, [ca.SX.zeros(3), list_by_rows(ca.SX.eye(3)), *(ca.SX.zeros(size) for _, size in parts[2:])]], [i]


def _name_entries(Z: ca.SX) -> tuple[tuple[ca.SX, ca.SX], ca.SX]:
    """Return (symbols, values) of the distinct entries of a matrix that vary, and the matrix in these symbols."""
    values, fill = find_distinct_entries(Z)
    kept = ca.SX.sym("kept", len(values))
    return (kept, ca.vertcat(*values)), fill(kept)


class SimplifiedStep(SymbolicMechanism):
    """The functions of the simplified method's step for a system of spherical and revolute joints under gravity."""

    def make_functions(  # type: ignore[override]
        self, *, gauge: float, b_term: float, direction: int, use_f_bar: int, keep_nu: int
    ) -> tuple[dict[str, GeneratedFunction], list[int]]:
        """Return the functions of a step, and the numbers of entries kept of Z at the start and of the factor.

        The arguments are the fields of ``methods.choices.Settings`` with these names.

        ``begin`` (t, plan, r, R, v, nu_start) -> (known, kept, slip, f_bar) at the start of a step;
        ``factor`` (t, r, R) -> (factor, (rank, log10 det S over its diagonal)), where rows are chosen
        (t, r, R, bounds) -> (factor, found, inverse shares), with ``couple`` (t, r, R) -> scaled S;
        ``iterate`` (t, plan, r, R, v, known, kept, nu, factor) -> (v, nu, (change^2,)) at the end;
        ``correct`` (t, r, R, factor) -> (r, R); ``copy`` (v, nu) and ``copy_poses`` (r, R).
        """
        nb, n, at, plan = self.system.nb, len(self.order), self.state(), ca.SX.sym("plan", 3)
        half, B = plan[0], b_term * plan[0]
        nu, nu_start, known = ca.SX.sym("nu", n), ca.SX.sym("nu_start", n), ca.SX.sym("known", 6 * nb)
        R = [make_matrix(part) for part in ca.vertsplit(at.R, 9)]
        # start of a step: ``first`` collects what its end does not change; end of it: ``w`` collects the impulses
        velocities, w, first = ca.vertsplit(at.v, 6), ca.vertsplit(known, 6), list[ca.SX]()
        spun = at._replace(v=ca.vertcat(*(x for b, v in enumerate(velocities) for x in (v[:3], R[b] @ v[3:]))))
        for b, v in enumerate(velocities):  # momenta in space, and the impulse of gravity
            weight = 2.0 * half * ca.SX(ca.DM(self.system.mass[b] * self.system.gravity))
            first.append(ca.vertcat(self.system.mass[b] * v[:3] + weight, R[b] @ (self.J[b] @ v[3:])))
        values, symbols, f_bars, slips = (list[ca.SX]() for _ in range(4))
        for part in self.parts:
            own = slice(part.first, part.first + len(part.of))
            Z, D, f_bar, slip, _ = self._express_part(part, direction, spun, B)
            Z_end, *_ = self._express_part(part, direction, spun, -B)
            f_bar = f_bar if use_f_bar else ca.SX(len(part.of), 1)
            load = D @ (-half * f_bar)
            if keep_nu:
                load -= Z @ nu_start[own]
            add_to_bodies(first, part.body, load)
            distinct, fill = find_distinct_entries(Z)
            kept = ca.SX.sym("kept", len(distinct))
            distinct_end, fill_end = find_distinct_entries(Z_end - gauge * fill(kept) if gauge else Z_end)
            add_to_bodies(w, part.body, fill_end(distinct_end) @ nu[own] - half * (D @ f_bar))
            values, symbols = [*values, *distinct], [*symbols, kept]
            slips, f_bars = [*slips, slip], [*f_bars, f_bar]

        rows, poses, given = self._rows(at), [at.t, at.r, at.R], [at.t, plan, at.r, at.R, at.v]
        factor, shares, couple = self._make_factor(rows, poses)
        free = [self._divide_by_mass(b, ca.vertcat(p[:3], R[b].T @ p[3:])) for b, p in enumerate(w)]
        # rank and determinant of S: rows left out count neither
        rows_kept = [factor.inverse[k] > 0 for k in self.order]
        ratios = [ca.if_else(rows_kept[c], factor.pivots[c] / factor.diagonal[k], 1) for c, k in enumerate(self.order)]
        products = [prod(ratios[c : c + IN_A_PRODUCT]) for c in range(0, n, IN_A_PRODUCT)]
        log_det = sum((ca.log(x) for x in products), ca.SX(0)) / np.log(10.0)
        found = ca.vertcat(sum(rows_kept, ca.SX(0)), log_det)
        numbers, factor_kept = factor.exchange_numbers()
        x = factor.solve({k: -multiply_row(row, free) for k, row in rows.items()})
        v = self._add_response(free, rows, x)
        changes = [a - o for a, o in zip(v, velocities, strict=True)]
        squares = (
            self.system.mass[b] * ca.dot(c[:3], c[:3]) + ca.dot(c[3:], self.J[b] @ c[3:]) for b, c in enumerate(changes)
        )
        closed = self._close_joints(at, rows, factor)
        made = [ca.vertcat(*first), *map(make_column, (values, slips, f_bars))]
        iterated = [
            ca.vertcat(*v),
            nu + make_column([x[k] for k in range(n)]) * (1.0 / (1.0 - gauge)),
            sum(squares, ca.SX(0)),
        ]
        return {
            "begin": GeneratedFunction([*given, nu_start], made),
            "factor": GeneratedFunction([*poses, *self._bounds], [numbers, found, *shares]),
            **couple,
            "iterate": GeneratedFunction([*given, known, make_column(symbols), nu, factor_kept], iterated),
            "correct": GeneratedFunction([*poses, factor_kept], [closed.r, closed.R]),
            "copy": GeneratedFunction([at.v, nu], [at.v, nu]),
            "copy_poses": GeneratedFunction(poses[1:], poses[1:]),
        }, [len(values), numbers.numel()]

    def _express_part(self, part: JointPart, direction: int, spun: SymbolicState, B: ca.SX) -> list[ca.SX]:
        """Return the results of ``express_wrenches`` for a joint's rows; ``spun`` has velocities in space."""
        s, bodies = self.system, [ca.DM.zeros(22), ca.DM.zeros(22)]
        for end, b in enumerate(part.body):
            if b >= 0:
                inertias = ca.vec(ca.DM(self.J_inv[b]).T), ca.vec(ca.DM(self.J[b]).T)
                bodies[end] = ca.vertcat(ca.DM(s.mass[b] * s.gravity), s.mass[b], *inertias)
        given = [*self._list_inputs(part, spun), *bodies, B]
        wrench = express_wrenches(part.kind, part.of, 2 if part.body[1] >= 0 else 1, direction)
        return list(wrench(*given, ca.SX.zeros(len(part.of))))
