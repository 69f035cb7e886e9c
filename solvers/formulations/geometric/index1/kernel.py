"""Rows, S = A M^-1 A^T, its factor and what follows from it: accelerations, multipliers, projections.

Row of joint j at end e, sign +1 for i and -1 for j: translation ``sign e_k`` (point rows), rotation X, in the body::

    point row k   X = sign (s x R^T e_k)
    line row      X = sign R^T (arm x f), translation sign f (module ``lines``); so are moving rows, with a torque
    axis row k    X = sign R^T (u x n_k)

    S = sum over bodies  X_a J^-1 X_c^T  (+ sign_a sign_c f_a . f_c / m, f = e_k on point rows)
    S lam = -gamma - A M^-1 f,   v_dot = M^-1 (f + A^T lam),   gamma = A_dot v

A pivot below ``DEPENDENT`` of its own diagonal is that of a redundant row: its multiplier is 0 and the other rows are
exact for right-hand sides that belong to a motion. The rank may change with the configuration.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from ..arrays import Model
from ..loads import load
from ..torsion import torque
from ..user_forces import evaluate_law
from ..vectors import INNER, JIT, add, copy, cross, dot, plus, turn_back, turned_by
from .blocks import WIDTH, Blocks, analyse
from .lines import line_rows

HOT = {**INNER, "forceinline": True}
FUSED = {**HOT, "fastmath": {"contract"}}  # products and sums in one rounding: linear algebra
DEPENDENT = 1e-9  # of the row's own entry of S; rounding leaves 1e-15, the weakest true pivots of our problems are 1e-4


class Kernel(NamedTuple):
    """Room for one evaluation. Rows of X, gamma, lam are those of phi; velocities (nb, 6) as in ``State``."""

    t: np.ndarray  # (1,) [s], to be set before rows and forces are evaluated
    r: np.ndarray  # (nb, 3)
    R: np.ndarray  # (nb, 3, 3)
    v: np.ndarray  # (nb, 6)
    v_dot: np.ndarray  # (nb, 6)
    force: np.ndarray  # (nb, 6): applied force [space], torque about C [body], gyroscopic term included
    X: np.ndarray  # (nj, 2, WIDTH, 3)
    Y: np.ndarray  # (nj, 2, WIDTH, 3): X J^-1
    way: np.ndarray  # (nj, WIDTH, 3): f of each row, 0 for axis rows
    L: np.ndarray  # (nblocks, WIDTH, WIDTH): S, then its factor; diagonal entries inverted, 0 for a redundant row
    gamma: np.ndarray  # (nrows,)
    phi: np.ndarray  # (nrows,)
    slip: np.ndarray  # (nrows,) phi_t of moving rows: A v + phi_t = 0
    lam: np.ndarray  # (nrows,) reaction conjugate to phi
    rhs: np.ndarray  # (nrows,)
    diagonal: np.ndarray  # (nrows,) of S, what its pivots are compared with
    line: np.ndarray  # (6, 3) of a spring


def empty_kernel(model: Model) -> tuple[Kernel, Blocks]:
    """Arrays and analysis of a system."""
    blocks = analyse(model)
    nb, nj, nr = len(model.mass), len(model.body), int(model.row[-1])
    way = np.zeros((nj, WIDTH, 3))
    way[model.pins > 0, :3] = np.eye(3)
    room = Kernel(
        t=np.zeros(1), slip=np.zeros(nr),
        r=np.zeros((nb, 3)), R=np.zeros((nb, 3, 3)), v=np.zeros((nb, 6)), v_dot=np.zeros((nb, 6)),
        force=np.zeros((nb, 6)), X=np.zeros((nj, 2, WIDTH, 3)), Y=np.zeros((nj, 2, WIDTH, 3)), way=way,
        L=np.zeros((len(blocks.other), WIDTH, WIDTH)), gamma=np.zeros(nr), phi=np.zeros(nr), lam=np.zeros(nr),
        rhs=np.zeros(nr), diagonal=np.zeros(nr), line=np.zeros((6, 3)),
    )  # fmt: skip
    return room, blocks


@njit(**HOT)
def rows(model, k):
    """Fill X, Y, gamma and phi from the poses and velocities of ``k``."""
    for j in range(len(model.body)):
        first = model.row[j]
        for a in range(3 if model.pins[j] else 0):
            k.gamma[first + a] = 0.0
            k.phi[first + a] = 0.0
        for e in range(2 if model.pins[j] else 0):
            sign = 1.0 - 2.0 * e
            b = model.body[j, e]
            s0, s1, s2 = model.s[j, e, 0], model.s[j, e, 1], model.s[j, e, 2]
            if b < 0:
                k.phi[first] += sign * s0
                k.phi[first + 1] += sign * s1
                k.phi[first + 2] += sign * s2
                continue
            w0, w1, w2 = k.v[b, 3], k.v[b, 4], k.v[b, 5]
            c0, c1, c2 = w1 * s2 - w2 * s1, w2 * s0 - w0 * s2, w0 * s1 - w1 * s0
            d0, d1, d2 = w1 * c2 - w2 * c1, w2 * c0 - w0 * c2, w0 * c1 - w1 * c0
            for a in range(3):
                R0, R1, R2 = k.R[b, a, 0], k.R[b, a, 1], k.R[b, a, 2]
                k.X[j, e, a, 0] = sign * (s1 * R2 - s2 * R1)
                k.X[j, e, a, 1] = sign * (s2 * R0 - s0 * R2)
                k.X[j, e, a, 2] = sign * (s0 * R1 - s1 * R0)
                k.gamma[first + a] += sign * (R0 * d0 + R1 * d1 + R2 * d2)
                k.phi[first + a] += sign * (k.r[b, a] + R0 * s0 + R1 * s1 + R2 * s2)
        if model.lines[j]:
            line_rows(model, k, j)
        if model.axes[j]:
            _axis_rows(model, k, j)
        fill_Y(model, k, j)


@njit(**HOT)
def fill_Y(model, k, j):
    """Y = X J^-1 of joint ``j``."""
    for e in range(2):
        b = model.body[j, e]
        if b < 0:
            continue
        for a in range(model.row[j + 1] - model.row[j]):
            x0, x1, x2 = k.X[j, e, a, 0], k.X[j, e, a, 1], k.X[j, e, a, 2]
            for q in range(3):
                k.Y[j, e, a, q] = x0 * model.J_inv[b, 0, q] + x1 * model.J_inv[b, 1, q] + x2 * model.J_inv[b, 2, q]


@njit(**HOT)
def _turned(k, b, x0, x1, x2):
    """x, x_dot and x_ddot less the part with Omega_dot, in space, of a vector fixed in body b (-1: the ground)."""
    if b < 0:
        return x0, x1, x2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    w0, w1, w2 = k.v[b, 3], k.v[b, 4], k.v[b, 5]
    c0, c1, c2 = w1 * x2 - w2 * x1, w2 * x0 - w0 * x2, w0 * x1 - w1 * x0
    d0, d1, d2 = w1 * c2 - w2 * c1, w2 * c0 - w0 * c2, w0 * c1 - w1 * c0
    R = k.R
    return (
        R[b, 0, 0] * x0 + R[b, 0, 1] * x1 + R[b, 0, 2] * x2,
        R[b, 1, 0] * x0 + R[b, 1, 1] * x1 + R[b, 1, 2] * x2,
        R[b, 2, 0] * x0 + R[b, 2, 1] * x1 + R[b, 2, 2] * x2,
        R[b, 0, 0] * c0 + R[b, 0, 1] * c1 + R[b, 0, 2] * c2,
        R[b, 1, 0] * c0 + R[b, 1, 1] * c1 + R[b, 1, 2] * c2,
        R[b, 2, 0] * c0 + R[b, 2, 1] * c1 + R[b, 2, 2] * c2,
        R[b, 0, 0] * d0 + R[b, 0, 1] * d1 + R[b, 0, 2] * d2,
        R[b, 1, 0] * d0 + R[b, 1, 1] * d1 + R[b, 1, 2] * d2,
        R[b, 2, 0] * d0 + R[b, 2, 1] * d1 + R[b, 2, 2] * d2,
    )


@njit(**HOT)
def _axis_rows(model, k, j):
    i, g, at = model.body[j, 0], model.body[j, 1], 3 * model.pins[j]
    first = model.row[j] + at
    for c in range(model.axes[j]):
        u0, u1, u2, p0, p1, p2, a0, a1, a2 = _turned(k, i, model.u[j, c, 0], model.u[j, c, 1], model.u[j, c, 2])
        n0, n1, n2, q0, q1, q2, b0, b1, b2 = _turned(k, g, model.n[j, c, 0], model.n[j, c, 1], model.n[j, c, 2])
        k.phi[first + c] = u0 * n0 + u1 * n1 + u2 * n2
        k.gamma[first + c] = (
            a0 * n0 + a1 * n1 + a2 * n2 + 2.0 * (p0 * q0 + p1 * q1 + p2 * q2) + u0 * b0 + u1 * b1 + u2 * b2
        )
        t0, t1, t2 = u1 * n2 - u2 * n1, u2 * n0 - u0 * n2, u0 * n1 - u1 * n0
        for e in range(2):
            b = model.body[j, e]
            if b < 0:
                continue
            sign = 1.0 - 2.0 * e
            for q in range(3):
                k.X[j, e, at + c, q] = sign * (k.R[b, 0, q] * t0 + k.R[b, 1, q] * t1 + k.R[b, 2, q] * t2)


@njit(**FUSED)
def factorise(model, blocks, k, shift=0.0):
    """S into ``k.L``, then its block Cholesky factor in place; returns the number of rows kept (the rank).

    ``shift`` is added to the diagonal, relative to it: with more than ``DEPENDENT`` no row is dropped.
    """
    nj, rank = len(blocks.joint), 0
    L = k.L
    for p in range(len(blocks.other)):
        for a in range(WIDTH):
            for c in range(WIDTH):
                L[p, a, c] = 0.0
    for col in range(nj):
        jc, size = blocks.joint[col], blocks.size[col]
        for p in range(blocks.start[col], blocks.start[col + 1]):
            ja, height = blocks.joint[blocks.other[p]], blocks.size[blocks.other[p]]
            for t in range(blocks.shared_start[p], blocks.shared_start[p + 1]):
                ea, ec = blocks.shared[t, 1], blocks.shared[t, 2]
                weight = (1.0 - 2.0 * ea) * (1.0 - 2.0 * ec) / model.mass[model.body[jc, ec]]
                if size == WIDTH:
                    _add_turnings(k, L, p, ja, ea, jc, ec, WIDTH, height)
                else:
                    _add_turnings(k, L, p, ja, ea, jc, ec, size, height)
                if model.pins[ja] and model.pins[jc]:
                    for a in range(3):
                        L[p, a, a] += weight
                else:
                    _add_translations(k, ja, jc, height, size, weight, L[p])
        for a in range(size):
            k.diagonal[blocks.row[col] + a] = L[blocks.start[col], a, a]
            L[blocks.start[col], a, a] *= 1.0 + shift
    for col in range(nj):
        d, size = blocks.start[col], blocks.size[col]
        rank += _diagonal(L, d, size, k, blocks.row[col])
        for p in range(d + 1, blocks.start[col + 1]):  # L_pd = S_pd L_dd^-T
            height = blocks.size[blocks.other[p]]
            if size == WIDTH:  # as a constant it has the loops unrolled: half the time of a full block
                _divide(L, p, d, WIDTH, height)
            else:
                _divide(L, p, d, size, height)
        for t in range(blocks.update_start[col], blocks.update_start[col + 1]):
            target, left, right = blocks.update[t, 0], blocks.update[t, 1], blocks.update[t, 2]
            for a in range(WIDTH):
                for c in range(WIDTH):
                    x = 0.0
                    for q in range(WIDTH):
                        x += L[left, a, q] * L[right, c, q]
                    L[target, a, c] -= x
    return rank


@njit(**FUSED)
def _add_turnings(k, L, p, ja, ea, jc, ec, size, height):
    """L_p += X J^-1 X^T of two joints at one body."""
    for a in range(height):
        x0, x1, x2 = k.X[ja, ea, a, 0], k.X[ja, ea, a, 1], k.X[ja, ea, a, 2]
        for c in range(size):
            L[p, a, c] += x0 * k.Y[jc, ec, c, 0] + x1 * k.Y[jc, ec, c, 1] + x2 * k.Y[jc, ec, c, 2]


@njit(**INNER)
def _add_translations(k, ja, jc, height, size, weight, block):
    """block += weight f_a . f_c: joints with rows that are no point rows."""
    for a in range(height):
        f0, f1, f2 = k.way[ja, a, 0], k.way[ja, a, 1], k.way[ja, a, 2]
        for c in range(size):
            block[a, c] += weight * (f0 * k.way[jc, c, 0] + f1 * k.way[jc, c, 1] + f2 * k.way[jc, c, 2])


@njit(**FUSED)
def _divide(L, p, d, size, height):
    """L_p := L_p L_d^-T"""
    for a in range(height):
        for c in range(size):
            x = L[p, a, c]
            for q in range(c):
                x -= L[p, a, q] * L[d, c, q]
            L[p, a, c] = x * L[d, c, c]


@njit(**FUSED)
def _subtract(L, p, x, row, size, at, height):
    """x[at:] -= L_p x[row:]"""
    for a in range(height):
        y = 0.0
        for q in range(size):
            y += L[p, a, q] * x[row + q]
        x[at + a] -= y


@njit(**FUSED)
def _subtract_transposed(L, p, x, row, size, at, height):
    """x[row:] -= L_p^T x[at:]"""
    for a in range(height):
        y = x[at + a]
        for q in range(size):
            x[row + q] -= L[p, a, q] * y


@njit(**FUSED)
def _diagonal(L, d, size, k, row):
    """Cholesky of one diagonal block, its diagonal inverted."""
    kept = 0
    for c in range(size):
        x = L[d, c, c]
        for q in range(c):
            x -= L[d, c, q] * L[d, c, q]
        inverse = 1.0 / math.sqrt(x) if x > DEPENDENT * k.diagonal[row + c] else 0.0
        kept += inverse > 0.0
        L[d, c, c] = inverse
        for a in range(c + 1, size):
            x = L[d, a, c]
            for q in range(c):
                x -= L[d, a, q] * L[d, c, q]
            L[d, a, c] = x * inverse
    return kept


@njit(**FUSED)
def solve(blocks, k, x):
    """x (nrows,) := S^-1 x with the factor in ``k.L``; 0 in redundant rows."""
    L, nj = k.L, len(blocks.joint)
    for col in range(nj):
        d, size, row = blocks.start[col], blocks.size[col], blocks.row[col]
        for a in range(size):
            y = x[row + a]
            for q in range(a):
                y -= L[d, a, q] * x[row + q]
            x[row + a] = y * L[d, a, a]
        for p in range(d + 1, blocks.start[col + 1]):
            at = blocks.row[blocks.other[p]]
            height = blocks.size[blocks.other[p]]
            if size == WIDTH:
                _subtract(L, p, x, row, WIDTH, at, height)
            else:
                _subtract(L, p, x, row, size, at, height)
    for col in range(nj - 1, -1, -1):
        d, size, row = blocks.start[col], blocks.size[col], blocks.row[col]
        for p in range(d + 1, blocks.start[col + 1]):
            at = blocks.row[blocks.other[p]]
            height = blocks.size[blocks.other[p]]
            if size == WIDTH:
                _subtract_transposed(L, p, x, row, WIDTH, at, height)
            else:
                _subtract_transposed(L, p, x, row, size, at, height)
        for a in range(size - 1, -1, -1):
            y = x[row + a]
            for q in range(a + 1, size):
                y -= L[d, q, a] * x[row + q]
            x[row + a] = y * L[d, a, a]


@njit(**HOT)
def applied(model, k):
    """Fill ``k.force``: gravity, springs, dampers, loads and user forces; torques in the body."""
    for b in range(len(model.mass)):
        for a in range(3):
            k.force[b, a] = model.mass[b] * model.gravity[a]
            k.force[b, 3 + a] = 0.0
    for s in range(len(model.stiffness)):
        _spring(model, k, s)
    for i in range(len(model.torsion_body)):
        _torsion(model, k, i)
    for i in range(len(model.load_body)):
        _load(model, k, i)
    for i in range(len(model.user_body)):
        _user_force(model, k, i)


@njit(**INNER)
def _torsion(model, k, i):
    T = torque(model, k.R, k.v, i)
    for e in range(2):
        b = model.torsion_body[i, e]
        if b >= 0:
            add(1.0 - 2.0 * e, turn_back(k.R[b], T), k.force[b, 3:])


@njit(**INNER)
def _load(model, k, i):
    b = model.load_body[i]
    F, T = load(model, k.R[b], k.t[0], i)
    torque = plus(turn_back(k.R[b], T), cross(model.load_p[i], turn_back(k.R[b], F)))
    for a in range(3):
        k.force[b, a] += F[a]
        k.force[b, 3 + a] += torque[a]


@njit(**INNER)
def _user_force(model, k, i):
    evaluate_law(model, k.r, k.R, k.v, k.t[0], i)
    for e in range(2):
        b = model.user_body[i, e]
        if b >= 0:
            add(1.0, model.user_load[e], k.force[b])
            add(1.0, turn_back(k.R[b], model.user_load[2 + e]), k.force[b, 3:])


@njit(**HOT)
def add_gyroscopic(model, k):
    """``k.force`` -= Omega x J Omega"""
    J = model.J
    for b in range(len(model.mass)):
        w0, w1, w2 = k.v[b, 3], k.v[b, 4], k.v[b, 5]
        h0 = J[b, 0, 0] * w0 + J[b, 0, 1] * w1 + J[b, 0, 2] * w2
        h1 = J[b, 1, 0] * w0 + J[b, 1, 1] * w1 + J[b, 1, 2] * w2
        h2 = J[b, 2, 0] * w0 + J[b, 2, 1] * w1 + J[b, 2, 2] * w2
        k.force[b, 3] += w2 * h1 - w1 * h2
        k.force[b, 4] += w0 * h2 - w2 * h0
        k.force[b, 5] += w1 * h0 - w0 * h1


@njit(**HOT)
def _spring(model, k, s):
    l0 = l1 = l2 = d0 = d1 = d2 = 0.0
    for e in range(2):
        sign, b = 1.0 - 2.0 * e, model.spring_body[s, e]
        x, x_dot = _turned(k, b, model.p[s, e, 0], model.p[s, e, 1], model.p[s, e, 2])[:3], (0.0, 0.0, 0.0)
        r0 = r1 = r2 = v0 = v1 = v2 = 0.0
        if b >= 0:
            x_dot = _turned(k, b, model.p[s, e, 0], model.p[s, e, 1], model.p[s, e, 2])[3:6]
            r0, r1, r2, v0, v1, v2 = k.r[b, 0], k.r[b, 1], k.r[b, 2], k.v[b, 0], k.v[b, 1], k.v[b, 2]
        l0 += sign * (r0 + x[0])
        l1 += sign * (r1 + x[1])
        l2 += sign * (r2 + x[2])
        d0 += sign * (v0 + x_dot[0])
        d1 += sign * (v1 + x_dot[1])
        d2 += sign * (v2 + x_dot[2])
    d = math.sqrt(l0 * l0 + l1 * l1 + l2 * l2)
    rate = (l0 * d0 + l1 * d1 + l2 * d2) / d
    tension = (model.stiffness[s] * (d - model.free_length[s]) + model.damping[s] * rate) / d
    for e in range(2):
        b = model.spring_body[s, e]
        if b < 0:
            continue
        f = -(1.0 - 2.0 * e) * tension
        f0, f1, f2 = f * l0, f * l1, f * l2
        k.force[b, 0] += f0
        k.force[b, 1] += f1
        k.force[b, 2] += f2
        R, p0, p1, p2 = k.R, model.p[s, e, 0], model.p[s, e, 1], model.p[s, e, 2]
        g0 = R[b, 0, 0] * f0 + R[b, 1, 0] * f1 + R[b, 2, 0] * f2
        g1 = R[b, 0, 1] * f0 + R[b, 1, 1] * f1 + R[b, 2, 1] * f2
        g2 = R[b, 0, 2] * f0 + R[b, 1, 2] * f1 + R[b, 2, 2] * f2
        k.force[b, 3] += p1 * g2 - p2 * g1
        k.force[b, 4] += p2 * g0 - p0 * g2
        k.force[b, 5] += p0 * g1 - p1 * g0


@njit(**HOT)
def times_inverse_mass(model, w):
    """w (nb, 6) := M^-1 w"""
    for b in range(len(model.mass)):
        t0, t1, t2 = w[b, 3], w[b, 4], w[b, 5]
        for a in range(3):
            w[b, a] /= model.mass[b]
            w[b, 3 + a] = model.J_inv[b, a, 0] * t0 + model.J_inv[b, a, 1] * t1 + model.J_inv[b, a, 2] * t2


@njit(**HOT)
def times_rows(model, k, w, sign, x):
    """x (nrows,) += sign A w"""
    for j in range(len(model.body)):
        first = model.row[j]
        for e in range(2):
            b = model.body[j, e]
            if b < 0:
                continue
            for a in range(model.row[j + 1] - first):
                y = k.X[j, e, a, 0] * w[b, 3] + k.X[j, e, a, 1] * w[b, 4] + k.X[j, e, a, 2] * w[b, 5]
                if model.pins[j]:
                    if a < 3:
                        y += (1.0 - 2.0 * e) * w[b, a]
                elif model.lines[j]:
                    y += (1.0 - 2.0 * e) * dot(k.way[j, a], w[b])
                x[first + a] += sign * y


@njit(**HOT)
def minus_rates(model, k, v, x):
    """x (nrows,) := -(A v + phi_t)"""
    for a in range(len(x)):
        x[a] = -k.slip[a]
    times_rows(model, k, v, -1.0, x)


@njit(**HOT)
def add_back(model, way, Y, x, w):
    """w (nb, 6) += M^-1 A^T x with the rows whose f and Y = X J^-1 are given."""
    for j in range(len(model.body)):
        first = model.row[j]
        for e in range(2):
            b = model.body[j, e]
            if b < 0:
                continue
            share = (1.0 - 2.0 * e) / model.mass[b]
            for a in range(model.row[j + 1] - first):
                y = x[first + a]
                if model.pins[j]:
                    if a < 3:
                        w[b, a] += share * y
                elif model.lines[j]:
                    for q in range(3):
                        w[b, q] += share * y * way[j, a, q]
                w[b, 3] += Y[j, e, a, 0] * y
                w[b, 4] += Y[j, e, a, 1] * y
                w[b, 5] += Y[j, e, a, 2] * y


@njit(**HOT)
def add_rows_back(model, k, x, w):
    """w (nb, 6) += M^-1 A^T x"""
    add_back(model, k.way, k.Y, x, w)


@njit(**HOT)
def _index_1(model, blocks, k):
    applied(model, k)
    add_gyroscopic(model, k)
    copy(k.force, k.v_dot)
    times_inverse_mass(model, k.v_dot)
    for a in range(len(k.lam)):
        k.lam[a] = -k.gamma[a]
    times_rows(model, k, k.v_dot, -1.0, k.lam)
    solve(blocks, k, k.lam)
    add_rows_back(model, k, k.lam, k.v_dot)


@njit(**HOT)
def accelerate(model, blocks, k):
    """Index 1: ``v_dot`` and ``lam`` at the poses and velocities of ``k``; returns the rank."""
    rows(model, k)
    rank = factorise(model, blocks, k)
    _index_1(model, blocks, k)
    return rank


@njit(**INNER)
def reactions(model, blocks, k):
    """``accelerate`` with the factor of these poses at hand; once a step and not inlined, which compiles faster."""
    rows(model, k)
    _index_1(model, blocks, k)


@njit(**JIT)
def evaluate(model, blocks, k):
    """``accelerate``, to be called from Python: compiled once for all methods."""
    return accelerate(model, blocks, k)


@njit(**HOT)
def clear(a):
    """a := 0"""
    for at in np.ndindex(a.shape):
        a[at] = 0.0


@njit(**HOT)
def project(model, blocks, k, work):
    """Poses onto phi = 0, then velocities onto A v + phi_t = 0, along M^-1 A^T, factor at hand; ``work`` (nb, 6).

    One pass each: what is left is the square of what there was, as long as ``k.L`` belongs to poses nearby.
    """
    for a in range(len(k.rhs)):
        k.rhs[a] = -k.phi[a]
    solve(blocks, k, k.rhs)
    clear(work)
    add_rows_back(model, k, k.rhs, work)
    for b in range(len(model.mass)):
        for a in range(3):
            k.r[b, a] += work[b, a]
        turned_by(k.R[b], (work[b, 3], work[b, 4], work[b, 5]), k.R[b])
    rows(model, k)
    minus_rates(model, k, k.v, k.rhs)
    solve(blocks, k, k.rhs)
    add_rows_back(model, k, k.rhs, k.v)
