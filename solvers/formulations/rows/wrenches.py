"""Loops of ODE-GC's simplified method over joints of one kind: wrenches of rows in space, and their rates.

With D the wrenches (force, torque about C) of the rows on both bodies, in space, and u = (r_dot, omega), so that
phi_dot = D^T u, B = dt/2 times the switch of the B term of Eq. (71), f_bar and M_bar by Eqs. (30), (31) under gravity::

    begin     at the start of a step: w -= dt/2 D0 f_bar0; M_bar phi_dot^2, f_bar0, and entries of D0 + B D_dot0 for
    impulses  w += (D1 - B D_dot1) nu1 - (D0 + B D_dot0) nu0 - dt/2 D1 f_bar1; f_bar1, and entries of D1 for
    rates     x := -D^T u
    loads     load += D x

Entries of a matrix that are equal or opposite are kept once: three for the torques of a joint's point rows.
"""

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..generated import GeneratedFunction, Loop
from .expressions import RowExpressions, differentiate_pose, express_rows, make_matrix

ALONG_A, ALONG_MASS, TRANSLATION = range(3)  # c of Eq. (31): a/(a . a), M^-1 a/(a . M^-1 a), (e_k, 0)
BODY = (("r", 3), ("R", 9), ("u", 6), ("numbers", 22))  # numbers: m g, m, J^-1, J


def wrench_loops(
    kind: str, rows: tuple[int, ...], ground: bool, direction: int, *, use_f_bar: bool
) -> dict[str, Loop | GeneratedFunction]:
    """Return the functions of the module's table for a kind of joint, and ``sizes``, to be compiled.

    ``sizes`` returns the numbers of entries kept of the start and of the end of a step. ``rows`` are the numbers of the
    rows; with ``ground`` body j is the ground. ``direction`` is that of c in Eq. (31); ``use_f_bar``: with f_bar of Eq.
    (30).
    """
    e, n = express_rows(kind, rows, space=True), 1 if ground else 2
    x, nu_start = (ca.SX.sym(name, len(rows)) for name in ("x", "nu_start"))
    plan = ca.SX.sym("plan", 3)
    bodies = [[ca.SX.sym(f"{part}_{end}", size) for part, size in BODY] for end in "ij"]
    still = [ca.SX.zeros(3), ca.vec(ca.densify(ca.SX.eye(3))), ca.SX.zeros(6)]
    ends = [bodies[0][:3], still if ground else bodies[1][:3]]
    moved = ca.vertcat(e.x, e.t), ca.vertcat(differentiate_pose(e.x, e.V, space=True), 1)
    rate = ca.jtimes(e.A.T @ x, *moved)
    m_bar, f_bar = measure_rows_in_space(e, bodies[:n], direction)
    f_bar = f_bar if use_f_bar else ca.SX.zeros(len(rows))
    slip = m_bar * e.phi_dot**2
    Z = e.A.T + plan[1] * ca.jacobian(rate, x)
    w = e.A.T @ (x - plan[0] * f_bar) - plan[1] * rate
    others = [part for body in bodies for part in body[3:]]
    free = ca.Function(
        "free", [e.x, e.V, e.t, e.numbers, plan, x, *others], [Z, e.A.T, w, f_bar, -plan[0] * (e.A.T @ f_bar), slip]
    )
    poses = ca.vertcat(*ends[0][:2], *ends[1][:2]), ca.vertcat(ends[0][2], ends[1][2])
    Z, D, w, f_bar, first, slip = (ca.simplify(a) for a in free.call([*poses, e.t, e.numbers, plan, x, *others]))
    entries0, Z_kept = _name_entries(Z[: 6 * n, :])
    entries, D_kept = _name_entries(D[: 6 * n, :])
    given = [entries0[0], entries[0]]
    w = w[: 6 * n] - Z_kept @ (plan[2] * x + nu_start)
    u = ca.vertcat(*[ends[b][2] for b in range(n)])
    blocks = [part for b in range(n) for part in bodies[b][: 4 if use_f_bar else 3]]
    last = [ca.densify(f_bar)] if use_f_bar else []
    return {
        "begin": Loop(
            whole=[e.t, plan],
            rows=[e.numbers],
            blocks=[part for b in bodies[:n] for part in b],
            stored=[entries0[1], ca.densify(slip), *last],
            added_blocks=list_by_ends(first[: 6 * n]),
        ),
        "impulses": Loop(
            whole=[e.t, plan],
            rows=[e.numbers, given[0], x, nu_start],
            blocks=blocks,
            stored=[entries[1], *last],
            added_blocks=list_by_ends(w),
        ),
        "rates": Loop(rows=[given[1]], blocks=[ends[b][2] for b in range(n)], stored=[ca.densify(-D_kept.T @ u)]),
        "loads": Loop(rows=[given[1], x], added_blocks=list_by_ends(D_kept @ x)),
        "sizes": GeneratedFunction([], [ca.DM([entries0[0].numel(), entries[0].numel()])]),
    }


def list_by_ends(w: ca.SX) -> list[ca.SX]:
    """Return the load ``w`` (6 or 12,) as a list of the six entries of each body."""
    return [ca.densify(w[at : at + 6]) for at in range(0, w.numel(), 6)]


def _name_entries(Z: ca.SX) -> tuple[tuple[ca.SX, ca.SX], ca.SX]:
    """Return symbols and values of the entries of a matrix that vary, and the matrix in these symbols."""
    values, fill = distinct_entries(Z)
    kept = ca.SX.sym("kept", len(values))
    return (kept, ca.vertcat(*values)), fill(kept)


def distinct_entries(Z: ca.SX) -> tuple[list[ca.SX], Callable[[Any], ca.SX]]:
    """Return the distinct entries of a matrix that vary, and a function that fills the matrix from them.

    Two entries count as one where they are equal, or opposite, at three sets of random numbers.
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

    def fill(kept: Any) -> ca.SX:
        inside = [sign * kept[known] if sign else Z[c] for c, (sign, known) in enumerate(which)]
        return ca.reshape(ca.vertcat(*inside), *Z.shape)

    return values, fill


def measure_rows_in_space(e: RowExpressions, bodies: Sequence[list[ca.SX]], direction: int) -> tuple[ca.SX, ca.SX]:
    """Return M_bar and f_bar of rows in space under gravity; ``bodies`` are symbols of each end that end in numbers.

    These are the ``numbers`` of ``BODY``: m g, m, J^-1, J.
    """
    turn = [ca.diagcat(ca.SX.eye(3), make_matrix(e.x[12 * end + 3 : 12 * end + 12])) for end in range(2)]
    ends = [(x[3], make_matrix(x[13:22]), make_matrix(x[4:13]), ca.vertcat(x[:3], ca.SX(3, 1))) for *_, x in bodies]
    return measure_rows(e.A @ ca.diagcat(*turn), ends, direction)[:2]


def measure_rows(
    A: ca.SX, ends: Sequence[tuple[ca.SX, ca.SX, ca.SX, ca.SX]], direction: int
) -> tuple[ca.SX, ca.SX, list[ca.SX]]:
    """Return M_bar = c . M c and f_bar = c . f of the rows ``A`` (n, 12), and c on each end (n, 6).

    A has torques in the body. Each of ``ends`` has mass, J, J^-1 and the load (force [space], torque [body]);
    ``direction`` is that of c in Eq. (31).
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
