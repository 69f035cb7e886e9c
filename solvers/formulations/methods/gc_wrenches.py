"""Wrenches of rows in space and their rates along the motion, for ODE-GC: code by kind from the declarations.

With D the wrenches (force, torque about C) of the rows on both bodies, in space, and u = (r_dot, omega), so that
phi_dot = D^T u, B = dt/2 times the switch of the B term of Eq. (71), f_bar by Eqs. (30), (31) under gravity::

    begin     at the start of a step: w -= dt/2 D0 f_bar0; f_bar0, and entries of D0 + B D_dot0 for
    impulses  w += (D1 - B D_dot1) nu1 - (D0 + B D_dot0) nu0 - dt/2 D1 f_bar1; f_bar1, and entries of D1 for
    rates     x := -D^T u
    loads     load += D x

Entries of a matrix are kept once where they are equal or opposite: of a point row's torque three.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ....harness.mechanics import joints
from ....harness.mechanics.system import MultibodySystem
from ..compiled.entries import Program
from ..compiled.kernel import Kernel, parts_of
from ..generated import Code, Loop, compile_functions
from ..rows.expressions import RowExpressions, joint_numbers, pose_rate, row_expressions

ALONG_A, ALONG_MASS, TRANSLATION = range(3)  # c of Eq. (31): a/(a . a), M^-1 a/(a . M^-1 a), (e_k, 0)
BODY = (("r", 3), ("R", 9), ("u", 6), ("numbers", 13))  # numbers: m g, m, J^-1


class Arrays(NamedTuple):
    """What the loops read and write, beside poses, w and x = rhs of the kernel."""

    plan: np.ndarray  # (3,) dt/2, B and the gauge: nu0 = gauge nu1 + nu_start
    numbers: np.ndarray  # (nb, 13) m g, m, J^-1
    u: np.ndarray  # (nb, 6) r_dot, omega
    load: np.ndarray  # (nb, 6)
    nu_start: np.ndarray  # (nrows,)
    nu: np.ndarray  # (nrows,)
    f_bar: np.ndarray  # (nrows,)


LOOPS = ("begin", "impulses", "rates", "loads")


def make_loops(
    system: MultibodySystem, k: Kernel, at: Arrays, direction: int, *, use_f_bar: bool
) -> dict[str, Program]:
    """The entries of ``LOOPS``; x of ``rates`` and ``loads`` is ``k.rhs``, w is ``k.w``."""
    parts, keeps = parts_of(system), []
    steps: dict[str, list[Any]] = {name: [] for name in LOOPS}
    first = 0
    while first < len(parts):
        kind, lo, hi, ground = key = parts[first][:4]
        last = first
        while last < len(parts) and parts[last][:4] == key:
            last += 1
        made = _compiled(str(joints.KINDS[kind]), tuple(range(lo, hi)), bool(ground), direction, use_f_bar)
        own, m = slice(int(k.row[first]), int(k.row[last])), last - first
        numbers = joint_numbers(system, np.array([part.joint for part in parts[first:last]]))
        kept0, kept, count = np.zeros((m, made.size0)), np.zeros((m, made.size)), np.array([m])

        def ends(*arrays: tuple[np.ndarray, int], of: np.ndarray = k.body[first:last], n: int = made.ends) -> list[Any]:
            return [
                a for e in range(n) for array, size in arrays for a in (array, np.ascontiguousarray(of[:, e] * size))
            ]

        here = [(k.r, 3), (k.R, 9), (at.u, 6), *([(at.numbers, 13)] if use_f_bar else [])]
        poses, to, f_bar = ends(*here), ends((k.w, 6)), [at.f_bar[own]] if use_f_bar else []
        nu = at.nu[own], at.nu_start[own]
        arrays = {
            "begin": [count, k.t, at.plan, numbers, *poses, kept0, *f_bar, *to],
            "impulses": [count, k.t, at.plan, numbers, kept0, *nu, *poses, kept, *f_bar, *to],
            "rates": [count, kept, *ends((at.u, 6)), k.rhs[own]],
            "loads": [count, kept, k.rhs[own], *ends((at.load, 6))],
        }
        for name, of in arrays.items():
            steps[name].append((made.code.address(name), of))
        keeps.append(made.code)
        first = last
    return {name: Program(some, keeps=(keeps, k)) for name, some in steps.items()}


class Compiled(NamedTuple):
    """Code of one kind: its moving ends, and how many entries of the start and of the end are kept."""

    code: Code
    ends: int
    size0: int
    size: int


@cache
def _compiled(kind: str, rows: tuple[int, ...], ground: bool, direction: int, use_f_bar: bool) -> Compiled:
    e, n = row_expressions(kind, rows, space=True), 1 if ground else 2
    x, nu_start = (ca.SX.sym(name, len(rows)) for name in ("x", "nu_start"))
    plan = ca.SX.sym("plan", 3)
    bodies = [[ca.SX.sym(f"{part}_{end}", size) for part, size in BODY] for end in "ij"]
    still = [ca.SX.zeros(3), ca.vec(ca.densify(ca.SX.eye(3))), ca.SX.zeros(6)]
    ends = [bodies[0][:3], still if ground else bodies[1][:3]]
    moved = ca.vertcat(e.x, e.t), ca.vertcat(pose_rate(e.x, e.V, space=True), 1)
    rate = ca.jtimes(e.A.T @ x, *moved)
    f_bar = _f_bar(e, bodies[:n], direction) if use_f_bar else ca.SX.zeros(len(rows))
    Z = e.A.T + plan[1] * ca.jacobian(rate, x)
    w = e.A.T @ (x - plan[0] * f_bar) - plan[1] * rate
    others = [part for body in bodies for part in body[3:]]
    free = ca.Function(
        "free", [e.x, e.V, e.t, e.numbers, plan, x, *others], [Z, e.A.T, w, f_bar, -plan[0] * (e.A.T @ f_bar)]
    )
    poses = ca.vertcat(*ends[0][:2], *ends[1][:2]), ca.vertcat(ends[0][2], ends[1][2])
    Z, D, w, f_bar, first = (ca.simplify(a) for a in free.call([*poses, e.t, e.numbers, plan, x, *others]))
    entries0, Z_kept = _entries(Z[: 6 * n, :])
    entries, D_kept = _entries(D[: 6 * n, :])
    given = [entries0[0], entries[0]]
    w = w[: 6 * n] - Z_kept @ (plan[2] * x + nu_start)
    u = ca.vertcat(*[ends[b][2] for b in range(n)])
    blocks = [part for b in range(n) for part in bodies[b][: 4 if use_f_bar else 3]]
    last = [ca.densify(f_bar)] if use_f_bar else []
    loops = {
        "begin": Loop(
            whole=[e.t, plan], rows=[e.numbers], blocks=blocks, stored=[entries0[1], *last],
            added_blocks=_by_ends(first[: 6 * n]),
        ),
        "impulses": Loop(
            whole=[e.t, plan], rows=[e.numbers, given[0], x, nu_start], blocks=blocks,
            stored=[entries[1], *last], added_blocks=_by_ends(w),
        ),
        "rates": Loop(rows=[given[1]], blocks=[ends[b][2] for b in range(n)], stored=[ca.densify(-D_kept.T @ u)]),
        "loads": Loop(rows=[given[1], x], added_blocks=_by_ends(D_kept @ x)),
    }  # fmt: skip
    return Compiled(compile_functions(loops), n, entries0[0].numel(), entries[0].numel())


def _by_ends(w: ca.SX) -> list[ca.SX]:
    return [ca.densify(w[at : at + 6]) for at in range(0, w.numel(), 6)]


def _entries(Z: ca.SX) -> tuple[tuple[ca.SX, ca.SX], ca.SX]:
    """Symbols and values of the entries of a matrix that vary, and the matrix in these symbols.

    Two are one where they are equal, or opposite, at random numbers.
    """
    Z = ca.densify(Z)
    symbols = ca.symvar(Z)
    random = np.random.default_rng(1)
    probe = ca.Function("probe", symbols, [Z])
    at = np.stack([np.array(probe(*random.standard_normal(len(symbols)))).reshape(-1, order="F") for _ in range(3)])
    found: list[np.ndarray] = []
    values: list[ca.SX] = []
    which = []
    for c in range(Z.numel()):
        if Z[c].is_constant():
            which.append((0, -1))
            continue
        size = 1e-12 * np.max(np.abs(at[:, c]))
        for known, other in enumerate(found):
            sign = next((g for g in (1, -1) if np.max(np.abs(at[:, c] - g * other)) <= size), 0)
            if sign:
                which.append((sign, known))
                break
        else:
            which.append((1, len(found)))
            found.append(at[:, c])
            values.append(Z[c])
    kept = ca.SX.sym("kept", len(values))
    inside = [sign * kept[known] if sign else Z[c] for c, (sign, known) in enumerate(which)]
    return (kept, ca.vertcat(*values)), ca.reshape(ca.vertcat(*inside), *Z.shape)


def _f_bar(rows: RowExpressions, bodies: Sequence[list[ca.SX]], direction: int) -> ca.SX:
    """c . (m g, 0) of each row."""
    A = rows.A
    if direction == TRANSLATION:
        return A[:, :3] @ bodies[0][3][:3]
    size, force = 0, 0
    for e, body in enumerate(bodies):
        way, torque = A[:, 6 * e : 6 * e + 3], A[:, 6 * e + 3 : 6 * e + 6]
        pull, square = way @ body[3][:3], ca.sum2(way * way)
        if direction == ALONG_MASS:
            R, J_inv = (ca.reshape(a, 3, 3).T for a in (rows.x[12 * e + 3 : 12 * e + 12], body[3][4:]))
            turned = torque @ R
            force, size = force + pull / body[3][3], size + square / body[3][3] + ca.sum2((turned @ J_inv) * turned)
        else:
            force, size = force + pull, size + square + ca.sum2(torque * torque)
    return force / size
