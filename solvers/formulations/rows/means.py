"""Discrete gradients: rows and forces between two poses, by which joints do no work and springs conserve energy.

With q_1 = q_0 moved by Cayley's map, R_m = (R_0 + R_1) / 2 (no rotation), R_1 - R_0 = R_m hat(h Omega_m), a row whose
phi is quadratic in the numbers of the poses has phi_1 - phi_0 = d(phi)/dx (x_m) (x_1 - x_0): the mean row is the
gradient at the mean pose. Its torque T in space is transformed to the body by R_m^-1, so that angular momentum
balances, too. R_m^-1 y = R_0^T y - (h/2) Omega_m x R_0^T y.
"""

from collections.abc import Sequence
from typing import Any

import casadi as ca

from ....harness.base.generated import GeneratedFunction, Loop
from .expressions import RowExpressions, express_load, express_rows, list_by_rows, make_matrix, stack_column
from .numbers import count_force_parameters

# poses at the start, at the end; v is the mean
BODY = (("r0", 3), ("R0", 9), ("r", 3), ("R", 9), ("v", 6), ("J_inv", 9))


def make_row_loops(kind: str, of: tuple[int, ...], ground: bool) -> dict[str, Loop | GeneratedFunction]:
    """Return the function ``rows`` of the mean rows of a kind of joint, to be compiled.

    It reads h, the parameters, and blocks of ``BODY`` of i, then of j. It stores phi at the end; torques X and
    Y = X J^-1 of the mean rows on body i and, unless it is the ``ground``, j; and forces of the rows where they vary.
    ``of`` are the indices of the rows.
    """
    e, h, (i, j) = express_rows(kind, of), ca.SX.sym("h"), _make_body_symbols(ground)
    phi, forces, X = express_mean_rows(e, e.numbers, h, (i, j))
    X = X[: 1 if ground else 2]
    Y = [x @ make_matrix(body[5]) for x, body in zip(X, (i, j), strict=False)]
    way = [] if e.A[:, :3].is_constant() else [list_by_rows(forces)]
    stored = [phi, *map(list_by_rows, X), *map(list_by_rows, Y), *way]
    made = [ca.densify(ca.simplify(a)) for a in stored]
    return {"rows": Loop(whole=[h], rows=[e.numbers], stored=made, blocks=[*i, *([] if ground else j)])}


def express_mean_rows(
    e: RowExpressions, numbers: Any, h: ca.SX, bodies: Sequence[Sequence[ca.SX]]
) -> tuple[ca.SX, ca.SX, list[ca.SX]]:
    """Return phi (n,) at the end and the mean rows: forces (n, 3) on body i [space], torques X (n, 3) on both bodies.

    ``numbers`` are the joint's parameters, ``h`` [s] is the step, ``bodies`` are in the form of ``BODY``. Raises
    ValueError where phi is not quadratic in the poses or depends on time. Rows that restrict velocities alone have
    phi = 0, hence mean rows of zero.
    """
    gradient = ca.jacobian(e.phi, e.x)
    if ca.depends_on(ca.vec(ca.jacobian(gradient, e.x)), e.x) or ca.depends_on(e.phi, e.t):
        raise ValueError("no mean rows: phi is not quadratic in the poses")
    x0, x1 = (ca.vertcat(*(b[at] for b in bodies for at in own)) for own in ((0, 1), (2, 3)))
    free = ca.Function("free", [e.x, e.numbers], [e.phi, gradient])
    phi, _ = free(x1, numbers)
    _, P = free(0.5 * (x0 + x1), numbers)
    X = []
    for k, body in enumerate(bodies):
        R = 0.5 * (make_matrix(body[1]) + make_matrix(body[3]))
        columns = [P[:, 12 * k + 3 + c : 12 * k + 12 : 3] for c in range(3)]  # d(phi)/d(c-th column of R)
        T = ca.vertcat(
            *[
                sum((ca.cross(R[:, c], columns[c][a, :].T) for c in range(3)), ca.SX.zeros(3)).T
                for a in range(P.shape[0])
            ]
        )
        X.append(T @ _invert_mean_rotation(body, h).T)
    return phi, P[:, :3], X


def make_load_loops(kind: str, ground: bool) -> dict[str, Loop | GeneratedFunction]:
    """Return the function ``push`` of the mean loads of springs or loads, to be compiled.

    It reads t at the end and h, the parameters, and blocks of ``BODY``; it adds to the loads of both bodies. With d the
    length at the start (0) and the end (1), a spring pulls with k (1 - 2 d_free / (d_0 + d_1)) times the mean line, a
    damper with (2 c / h) (d_1 - d_0) / (d_0 + d_1) times it. Forces and torques of a load are means of those at the
    start and the end.
    """
    t, h, numbers, (i, j) = (
        ca.SX.sym("t"),
        ca.SX.sym("h"),
        ca.SX.sym("p", count_force_parameters(kind)),
        _make_body_symbols(ground),
    )
    if kind == "spring":
        p, (k, free, c) = (numbers[:3], numbers[3:6]), (numbers[6 + a] for a in range(3))
        arms = [[make_matrix(b[at]) @ s for at in (1, 3)] for b, s in zip((i, j), p, strict=True)]
        lines = [i[at] + arms[0][n] - j[at] - arms[1][n] for n, at in enumerate((0, 2))]
        before, after = (ca.norm_2(line) for line in lines)
        pull = k * (1.0 - 2.0 * free / (before + after)) + 2.0 * c * (after - before) / (h * (before + after))
        force, torque = -0.5 * pull * (lines[0] + lines[1]), ca.SX.zeros(3)
        mean_arms = [0.5 * (a + b) for a, b in arms]
    else:
        still = ca.SX.zeros(12)
        pushes = [
            express_load(kind, ca.vertcat(i[at], i[at + 1], j[at], j[at + 1]), still, time, numbers)[2]
            for at, time in ((0, t - h), (2, t))
        ]
        force, torque, point = (0.5 * (stack_column(a) + stack_column(b)) for a, b in zip(*pushes, strict=True))
        mean_arms = [point - 0.5 * (i[0] + i[2])]
    added = []
    for body, arm, sign in zip((i, j)[: 1 if ground else 2], mean_arms, (1.0, -1.0), strict=False):
        added.append(
            ca.densify(
                ca.vertcat(sign * force, _invert_mean_rotation(body, h) @ (sign * (torque + ca.cross(arm, force))))
            )
        )
    return {"push": Loop(whole=[t, h], rows=[numbers], blocks=[*i, *([] if ground else j)], added_blocks=added)}


def _make_body_symbols(ground: bool) -> tuple[list[ca.SX], list[ca.SX]]:
    """Return the quantities of ``BODY`` for i and j: new symbols, but zeros and R = I for j if that is the ground."""
    i, j = ([ca.SX.sym(f"{name}_{end}", size) for name, size in BODY] for end in "ij")
    one = list_by_rows(ca.SX.eye(3))
    still = [one if name in ("R0", "R") else ca.SX.zeros(size) for name, size in BODY]
    return i, still if ground else j


def _invert_mean_rotation(body: Sequence[ca.SX], h: ca.SX) -> ca.SX:
    """Return R_m^-1 = (1 - hat(h Omega_m / 2)) R_0^T, which transforms a mean torque from space to the body."""
    return (ca.SX.eye(3) - ca.skew(0.5 * h * body[4][3:])) @ make_matrix(body[1]).T
