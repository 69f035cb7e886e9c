"""Loops of ODE-GC's full Newton method over joints of one kind, from their expressions.

With A the rows, loads A^T nu in the body (torques) and D nu in space, D_dot their rate along the motion, B = dt/2 times
the switch of the B term of Eq. (71), Z0 = D0 + B D_dot0, the motion at the end of a step turns by theta = T dOmega1::

    measure    phi, phi_dot, M_bar and f_bar by Eqs. (30), (31)
    direction  c_R on both ends
    begin      known += Z0 nu_start - dt/2 D0 G0 (space), and entries of Z0
    balance    R_v += gauge Z0 nu1 + D1 p + D_dot1 z, p = -nu1 - dt/2 G1, z = B nu1; torques in the body of the end
    slopes     Eq. (79): columns of nu1, rows of (75), blocks of bodies

The slopes of M_bar and of C_bar, K_bar are left out, and those of f_bar by the forces: of order dt^2.
"""

from collections.abc import Sequence

import casadi as ca

from ..generated import Loop
from .expressions import differentiate_by_pose, differentiate_pose, express_rows, list_by_rows, make_matrix
from .wrenches import TRANSLATION, list_by_ends, measure_rows

BODY = (("r", 3), ("R", 9), ("v", 6), ("force", 6), ("inertia", 19), ("T", 9))  # inertia: m, J, J^-1


def newton_loops(
    kind: str, rows: tuple[int, ...], ground: bool, direction: int, *, symmetric: bool, use_f_bar: bool, couple: bool
) -> dict[str, Loop]:
    """Return the functions of the module's table for a kind of joint, to be compiled.

    ``rows`` are the numbers of its rows; with ``ground`` body j is the ground. ``direction`` is that of c in Eq. (31);
    ``symmetric``: in the symmetric gauge; ``use_f_bar``: with f_bar of Eq. (30); ``couple``: with slopes of each body's
    load by the other body, and of f_bar.
    """
    e, n, ends = express_rows(kind, rows), len(rows), 1 if ground else 2
    i, j = ([ca.SX.sym(f"{part}_{end}", size) for part, size in BODY] for end in "ij")
    still = [ca.SX.zeros(3), ca.vec(ca.SX.eye(3)), ca.SX.zeros(6), *(ca.SX.zeros(size) for _, size in BODY[3:])]
    both = i, still if ground else j
    moving = [i, j][:ends]
    plan = ca.SX.sym("plan", 3)  # dt/2, B, gauge
    half, B, gauge = plan[0], plan[1], plan[2]
    nu, p, z, start, G0, stiff, on_rate, on_phi = (
        ca.SX.sym(name, n) for name in ("nu", "p", "z", "start", "G0", "stiff", "on_rate", "on_phi")
    )
    bodies = [(b[4][0], make_matrix(b[4][1:10]), make_matrix(b[4][10:19]), b[3]) for b in moving]
    m_bar, f_bar, c = measure_rows(e.A, bodies, direction)
    D = e.A.T  # torques in the body
    along = ca.vertcat(e.x, e.t), ca.vertcat(differentiate_pose(e.x, e.V), 1)
    D_dot = ca.jtimes(D, *along)
    D_dot = ca.vertcat(
        *[
            ca.vertcat(D_dot[at : at + 3, :], D_dot[at + 3 : at + 6, :] + ca.skew(Omega) @ D[at + 3 : at + 6, :])
            for at, Omega in ((0, e.V[3:6]), (6, e.V[9:12]))
        ]
    )
    load = D @ p + D_dot @ z
    by_pose, by_rate = differentiate_by_pose(load, e.x), ca.jacobian(load, e.V)
    if couple and use_f_bar and direction != TRANSLATION:
        by_pose = by_pose + D @ (half * differentiate_by_pose(f_bar, e.x))
    K = _differentiate_by_end_velocities(by_pose, by_rate, both, half)
    for b in range(2):  # turned back after differentiation: R^T d(R torque) = d torque - torque x theta
        turned = slice(6 * b + 3, 6 * b + 6)
        K[turned, turned] += -ca.skew(load[turned]) @ make_matrix(both[b][5])
    phi_dot = e.phi_dot
    row = ca.diag(on_rate) @ _differentiate_by_end_velocities(
        differentiate_by_pose(phi_dot, e.x), ca.jacobian(phi_dot, e.V), both, half
    )
    row += ca.diag(on_phi) @ _differentiate_by_end_velocities(
        differentiate_by_pose(e.phi, e.x), ca.SX(n, 12), both, half
    )
    in_space = ca.diagcat(*[ca.diagcat(ca.SX.eye(3), make_matrix(b[1])) for b in both])
    Z0 = (in_space @ (D + B * D_dot))[: 6 * ends, :]
    first = (in_space @ D)[: 6 * ends, :] @ (-half * G0)
    rest = [part for body in moving for part in body[3:]]

    def at(*of: ca.SX) -> list[ca.SX]:
        """Return expressions simplified, with the symbols of the bodies in place of general poses and velocities."""
        given = [e.x, e.V, e.t, e.numbers]
        free = [*rest, *(b[1] for b in moving), plan, nu, p, z, start, G0, stiff, on_rate, on_phi]
        made = ca.Function("at", [*given, *free], [ca.densify(x) for x in of])
        x = ca.vertcat(both[0][0], both[0][1], both[1][0], both[1][1])
        out = made.call([x, ca.vertcat(both[0][2], both[1][2]), e.t, e.numbers, *free])
        return [ca.simplify(x) for x in out]

    (Z0,) = at(Z0)
    kept, values, Z0_kept = _name_varying(Z0)
    (first,) = at(first)
    phi, rate, m_bar, f_bar = at(e.phi, phi_dot, m_bar, f_bar)
    c = at(*c)
    (pushed,) = at(load[: 6 * ends])
    column = -D @ ca.diag(stiff) + B * D_dot
    column, row, K = at(column[: 6 * ends, :], row, K)
    poses = [part for body in moving for part in body[:3]]
    loops = {
        "measure": Loop(
            whole=[e.t], rows=[e.numbers], blocks=[x for b in moving for x in b[:5]], stored=[phi, rate, m_bar, f_bar]
        ),
        "direction": Loop(
            whole=[e.t],
            rows=[e.numbers],
            blocks=[x for b in moving for x in b[:5]],
            stored=[list_by_rows(x) for x in c],
        ),
        "begin": Loop(
            whole=[e.t, plan],
            rows=[e.numbers, start, G0],
            blocks=poses,
            stored=[values] if symmetric else [],
            added_blocks=list_by_ends(Z0 @ start + first),
        ),
    }
    given = [e.numbers]
    if symmetric:
        given = [e.numbers, kept]
        turned_back = ca.diagcat(*[ca.diagcat(ca.SX.eye(3), make_matrix(b[1]).T) for b in moving])
        pushed = pushed + turned_back @ (Z0_kept @ (gauge * nu))
        column = column + gauge * (turned_back @ Z0_kept)
    loops["balance"] = Loop(whole=[e.t, plan], rows=[*given, nu, p, z], blocks=poses, added_blocks=list_by_ends(pushed))
    blocks = [(a, b) for a in range(ends) for b in range(ends) if couple or a == b]
    loops["slopes"] = Loop(
        whole=[e.t, plan],
        rows=[*given, nu, p, z, stiff, on_rate, on_phi],
        blocks=[x for b in moving for x in (b if couple and use_f_bar else [*b[:3], b[5]])],
        stored=[
            *(list_by_rows(column[6 * b : 6 * b + 6, :]) for b in range(ends)),
            *(list_by_rows(row[:, 6 * b : 6 * b + 6]) for b in range(ends)),
        ],
        added_blocks=[list_by_rows(K[6 * a : 6 * a + 6, 6 * b : 6 * b + 6]) for a, b in blocks],
    )
    return loops


def _differentiate_by_end_velocities(by_pose: ca.SX, by_rate: ca.SX, both: Sequence[list[ca.SX]], half: ca.SX) -> ca.SX:
    """Return slopes by the velocities at the end of the step, (., 12): dr = dt/2 dr_dot, theta = T dOmega.

    ``by_pose`` and ``by_rate`` are the slopes by poses and by velocities of ``both`` bodies; ``half`` is dt/2.
    """
    parts = []
    for b in range(2):
        at = 6 * b
        parts += [
            half * by_pose[:, at : at + 3] + by_rate[:, at : at + 3],
            by_pose[:, at + 3 : at + 6] @ make_matrix(both[b][5]) + by_rate[:, at + 3 : at + 6],
        ]
    return ca.horzcat(*parts)


def _name_varying(Z: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return symbols and values of all entries of a matrix, and the matrix in these symbols except for constants."""
    Z = ca.densify(Z)
    kept, inside = ca.SX.sym("kept", Z.numel()), ca.SX(Z)
    for c in range(Z.numel()):
        if not Z[c].is_constant():
            inside[c] = kept[c]
    return kept, ca.vec(Z), inside
