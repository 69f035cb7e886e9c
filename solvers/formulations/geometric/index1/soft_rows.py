"""Spring-dampers as soft rows of a collocation step: stiffness and damping in the matrix of its iteration (compiled).

A row is the rate of a spring's length, A_s = d(length_dot)/dv; its multiplier p = -tension is an unknown of stage i::

    M vdot_i = f_i + A_i^T lam_i + A_s^T p_i,   p_i = -k (length_i - free length) - c length_dot_i

A change dp changes vdot by Z dp, Z = M^-1 A_s^T - M^-1 A^T S^-1 A M^-1 A_s^T. So with G = A_s Z, the tableau a and the
other changes d of vdot Newton's equations are::

    dp_i + sum_j K_ij (A_s d_j + G dp_j) = -p_i - tension_i,   K = h c a + h^2 k a^2,

dense in 3 ns unknowns, the Schur complement of M + h a D + h^2 a^2 K. Its rate does not depend on k and c, for G alone
is frozen over the step, while forces act along the rows of each iterate. Left out: the turning of a spring under
tension (tension / length across it).
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from ..arrays import Model
from ..block_lu import invert
from ..springs import line
from ..vectors import INNER, cross, put, times, turn_back
from .fixed_step import largest
from .kernel import Kernel, add_rows_back, clear, empty_kernel, fill_Y, solve, times_rows


class SoftRows(NamedTuple):
    """The springs of a system, each with one row, and room for their part of an iteration."""

    model: Model  # springs for joints
    stages: tuple[Kernel, ...]  # X, Y, way, lam (the multiplier p) and phi (the tension of the law) of each stage
    old: np.ndarray  # (3, ns) p of the last accepted step
    d: np.ndarray  # (3, ns) A_s d
    W: np.ndarray  # (ns, nrows) change of lam by each p
    G: np.ndarray  # (ns, ns) [1/kg]
    matrix: np.ndarray  # (3 ns, 3 ns) its inverse, too
    x: np.ndarray  # (3 ns,)
    change: np.ndarray  # (ns,)
    rows: np.ndarray  # (nrows,)
    pivots: np.ndarray  # (3 ns,)
    swapped: np.ndarray  # (3 ns,)


def without_springs(model: Model) -> Model:
    """The system less its springs; torsional ones and user forces stay."""
    empty = ("p", "stiffness", "free_length", "damping")
    return model._replace(
        spring_body=model.spring_body[len(model.stiffness) :], **{name: getattr(model, name)[:0] for name in empty}
    )


def soft_rows(model: Model, stages: tuple[Kernel, ...]) -> SoftRows:
    """Rows of the springs of ``model`` on the poses and velocities of ``stages``."""
    ns, nrows = len(model.stiffness), int(model.row[-1])
    none = np.zeros(ns, dtype=np.int64)
    as_joints = model._replace(
        body=model.spring_body[:ns], kind=none, pins=none, lines=none + 1, axes=none, row=np.arange(ns + 1),
    )  # fmt: skip
    return SoftRows(
        as_joints, tuple(empty_kernel(as_joints)[0]._replace(r=k.r, R=k.R, v=k.v) for k in stages),
        old=np.zeros((3, ns)), d=np.zeros((3, ns)), W=np.zeros((ns, nrows)), G=np.zeros((ns, ns)),
        matrix=np.zeros((3 * ns, 3 * ns)), x=np.zeros(3 * ns), change=np.zeros(ns), rows=np.zeros(nrows),
        pivots=np.zeros(3 * ns), swapped=np.zeros(3 * ns, dtype=np.int64),
    )  # fmt: skip


@njit(**INNER)
def pull(model, k):
    """Rows of the springs and the tensions of their law at the poses and velocities of ``k``."""
    for s in range(len(model.stiffness)):
        spring = line(model, k, s)
        k.phi[s] = spring.tension
        put(spring.along, k.way[s, 0])
        for e in range(2):
            b = model.spring_body[s, e]
            if b >= 0:
                put(times(1.0 - 2.0 * e, cross(model.p[s, e], turn_back(k.R[b], spring.along))), k.X[s, e, 0])
        fill_Y(model, k, s)


@njit(**INNER)
def add_pull(model, k, w):
    """w += M^-1 A_s^T p"""
    add_rows_back(model, k, k.lam, w)


@njit(**INNER)
def stretch(model, k, w, out):
    """out := A_s w"""
    clear(out)
    times_rows(model, k, w, 1.0, out)


@njit(**INNER)
def respond(model, blocks, k, soft, i, a, square, h, w):
    """W, G and the inverse of the matrix with the factor and rows of stage ``i``, whose kernel is ``k``; w (nb, 6)."""
    springs, own = soft.model, soft.stages[i]
    ns = len(soft.change)
    for s in range(ns):
        clear(w)
        clear(soft.change)
        soft.change[s] = 1.0
        add_rows_back(springs, own, soft.change, w)
        clear(soft.W[s])
        times_rows(model, k, w, -1.0, soft.W[s])
        solve(blocks, k, soft.W[s])
        add_rows_back(model, k, soft.W[s], w)
        clear(soft.G[s])
        times_rows(springs, own, w, 1.0, soft.G[s])
    for i in range(3):
        for s in range(ns):
            for j in range(3):
                K = h * (springs.damping[s] * a[i, j] + h * springs.stiffness[s] * square[i, j])
                for t in range(ns):
                    soft.matrix[i * ns + s, j * ns + t] = K * soft.G[t, s]
            soft.matrix[i * ns + s, i * ns + s] += 1.0
    return invert(soft.matrix, 3 * ns, soft.pivots, soft.swapped)


@njit(**INNER)
def correct(model, stages, soft, a, square, h, w):
    """Correct p, lam and vdot of all stages; returns the largest change of vdot. ``soft.d`` is given; w (nb, 6)."""
    springs, ns, size = soft.model, len(soft.change), 0.0
    if ns == 0:
        return size
    for i in range(3):
        for s in range(ns):
            x = -soft.stages[i].lam[s] - soft.stages[i].phi[s]
            for j in range(3):
                x -= h * (springs.damping[s] * a[i, j] + h * springs.stiffness[s] * square[i, j]) * soft.d[j, s]
            soft.x[i * ns + s] = x
    for i in range(3):
        k, own = stages[i], soft.stages[i]
        clear(w)
        clear(soft.rows)
        for s in range(ns):
            x = 0.0
            for t in range(3 * ns):
                x += soft.matrix[i * ns + s, t] * soft.x[t]
            soft.change[s] = x
            own.lam[s] += x
            for r in range(len(soft.rows)):
                soft.rows[r] += x * soft.W[s, r]
        add_rows_back(springs, own, soft.change, w)
        add_rows_back(model, k, soft.rows, w)
        for r in range(len(soft.rows)):
            k.lam[r] += soft.rows[r]
        for b in range(len(w)):
            for q in range(6):
                k.v_dot[b, q] += w[b, q]
        size = max(size, largest(w))
    return size
