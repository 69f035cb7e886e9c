"""Wrenches of rows in space and their rates along the motion, for ODE-GC: code by kind from the declarations.

With D the wrenches (force, torque about C) of the rows on both bodies in space, A^T = diag(1, R^T) D, an entry does::

    w += D x + D_dot y,   D_dot the rate of D at the poses and velocities: the B term of Eq. (71)
"""

from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from ....harness.mechanics import joints
from ....harness.mechanics.system import MultibodySystem
from ..compiled.entries import Program
from ..compiled.kernel import Kernel, parts_of
from ..generated import Code, Loop, compile_functions
from ..rows.expressions import joint_numbers, pose_rate, row_expressions


def make_wrenches(
    system: MultibodySystem, k: Kernel, at: tuple[np.ndarray, np.ndarray, np.ndarray], x: np.ndarray, y: np.ndarray,
    w: np.ndarray,
) -> Program:  # fmt: skip
    """The entry at poses and velocities ``at`` = (r, R, v), with ``x``, ``y`` (nrows,) and ``w`` (nb, 6)."""
    parts, steps, keeps = parts_of(system), [], []
    first = 0
    while first < len(parts):
        kind, lo, hi, ground = key = parts[first][:4]
        last = first
        while last < len(parts) and parts[last][:4] == key:
            last += 1
        code = _compiled(str(joints.KINDS[kind]), tuple(range(lo, hi)), bool(ground))
        rows, ends = slice(int(k.row[first]), int(k.row[last])), range(1 if ground else 2)
        numbers = joint_numbers(system, np.array([part.joint for part in parts[first:last]]))
        arrays: list[Any] = [np.array([last - first]), k.t, numbers, x[rows], y[rows]]
        for e in ends:
            b = k.body[first:last, e]
            for array, size in zip(at, (3, 9, 6), strict=True):
                arrays += [array, np.ascontiguousarray(b * size)]
        for e in ends:
            arrays += [w, np.ascontiguousarray(k.body[first:last, e] * 6)]
        steps.append((code.address("wrenches"), arrays))
        keeps.append(code)
        first = last
    return Program(steps, keeps=(keeps, k))


@cache
def _compiled(kind: str, rows: tuple[int, ...], ground: bool) -> Code:
    e = row_expressions(kind, rows)
    x, y = (ca.SX.sym(name, len(rows)) for name in "xy")
    i, j = ([ca.SX.sym(f"{name}_{end}", size) for name, size in (("r", 3), ("R", 9), ("v", 6))] for end in "ij")
    turns = [ca.reshape(e.x[12 * b + 3 : 12 * b + 12], 3, 3).T for b in range(2)]
    to_space = ca.diagcat(ca.SX.eye(3), turns[0], ca.SX.eye(3), turns[1])
    moved = ca.vertcat(e.x, e.t), ca.vertcat(pose_rate(e.x, e.V), 1)
    out = to_space @ e.A.T @ x + ca.jtimes(to_space @ e.A.T @ y, *moved)
    free = ca.Function("wrenches", [e.x, e.V, e.t, e.numbers, x, y], [out])
    rest = [ca.SX.zeros(3), ca.vec(ca.SX.eye(3)), ca.SX.zeros(6)] if ground else j
    made = free(ca.vertcat(*i[:2], *rest[:2]), ca.vertcat(i[2], rest[2]), e.t, e.numbers, x, y)
    made = ca.densify(ca.simplify(made))
    ends = [made[:6]] if ground else [made[:6], made[6:]]
    loop = Loop(whole=[e.t], rows=[e.numbers, x, y], blocks=[*i, *([] if ground else j)], added_blocks=ends)
    return compile_functions({"wrenches": loop})
