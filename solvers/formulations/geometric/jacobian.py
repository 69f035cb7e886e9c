"""Exact derivative of the step residual (module ``residual``) in dense blocks, one per body, joint end and pair.

The pose of the end follows its velocity: ``dr1 = dt/2 dr_dot1`` and ``dR1 = R1 hat(theta)``, ``theta = T dOmega1``,
``T = dt/2 dexp(dt/2 (Omega0 + Omega1))``. Here inertia, f_bar and springs; joints are in ``jacobian_joints``.

Left out: how C_bar, K_bar, M_bar and the springs' part of f_bar change within the step (of order dt^2; it only
slows the convergence). Without springs the Jacobian is exact.
"""

import numpy as np
from numba import njit

from .jacobian_joints import axis_columns, axis_constraints, axis_forces, point_constraints, point_forces
from .kinematics import spring_line
from .small import (
    INNER,
    JIT,
    cross,
    cross3,
    dot,
    hat_hat,
    product,
    right_differential,
    times_hat,
    turn3,
    turn_back,
)


@njit(**JIT)
def assemble(model, m0, m1, rows, dt, settings, diagonal, index, blocks, T):
    """Fill ``blocks`` (npairs, 6, 6); ``index`` says which block is whose; ``diagonal`` (nrows,) is (Xi M_bar)^-1.

    Each part loops over all joints itself: a call of a compiled function with these tuples costs more than a joint.
    """
    blocks[:] = 0.0
    _inertia(model, m0, m1, dt, index, blocks, T)
    point_forces(model, m0, m1, rows, dt, settings, index, blocks, T)
    point_constraints(model, m1, rows, dt, index, blocks, T)
    if settings.couple and settings.use_f_bar and settings.direction != 2:
        _f_bar(model, m1, 0.5 * dt, index, blocks, T, settings)
    axis_columns(model, m0, m1, rows, dt, settings, index, blocks)
    axis_forces(model, m1, rows, dt, settings, index, blocks, T)
    axis_constraints(model, m1, rows, index, blocks, T)
    for j in range(len(model.end)):
        for k in range(model.row[j + 1] - model.row[j]):
            blocks[index.diagonal[j], k, k] = diagonal[model.row[j] + k]
    for s in range(len(model.k)):
        _spring(model, m1, dt, index, blocks, T, s)


@njit(**INNER)
def _inertia(model, m0, m1, dt, index, blocks, T):
    """d(R J Omega) = R (J dOmega - hat(J Omega) theta); T of the body."""
    for b in range(len(model.mass)):
        half = 0.5 * dt
        right_differential(
            half * (m0.v[b, 3] + m1.v[b, 3]),
            half * (m0.v[b, 4] + m1.v[b, 4]),
            half * (m0.v[b, 5] + m1.v[b, 5]),
            half,
            T,
            b,
        )
        x0, x1, x2 = turn3(model.J, b, m1.v[b, 3], m1.v[b, 4], m1.v[b, 5])
        p = index.body[b]
        for k in range(3):
            blocks[p, k, k] = model.mass[b]
        for c in range(3):
            y0, y1, y2 = cross3(x0, x1, x2, T[b, 0, c], T[b, 1, c], T[b, 2, c])
            blocks[p, 3, 3 + c] = model.J[b, 0, c] - y0
            blocks[p, 4, 3 + c] = model.J[b, 1, c] - y1
            blocks[p, 5, 3 + c] = model.J[b, 2, c] - y2


@njit(**INNER)
def _f_bar(model, m1, half, index, blocks, T, settings):
    """-half D1 G1 with G1 = -f_bar = -N / size: size depends on the arms, f_bar' = -f_bar size' / size."""
    for j in range(len(model.end)):
        row = model.row[j]
        x = np.empty((8, 3))
        for k in range(3):
            size = 0.0
            for e in range(2):  # size = a . a or a . M^-1 a; its gradient on theta of each end into x[e]
                b = model.end[j, e]
                x[e, :] = 0.0
                if b < 0:
                    continue
                for q in range(3):
                    x[2, q] = m1.R[b, k, q]  # R^T e_k
                cross(model.s[j, e], x[2], x[3])  # rotational part of a
                if settings.direction == 0:
                    x[4, :] = x[3, :]
                    size += 1.0
                else:
                    for q in range(3):
                        x[4, q] = dot(model.J_inv[b, q], x[3])
                    size += 1.0 / model.mass[b]
                size += dot(x[3], x[4])
                # d a_rot = s x (R^T e_k x theta): 2 a' . W a = 2 ((x4 x s) x R^T e_k) . theta
                cross(x[4], model.s[j, e], x[5])
                cross(x[5], x[2], x[6])
                for q in range(3):
                    x[e, q] = 2.0 * x[6, q]
            for e in range(2):  # force half f_bar' on row k acts on end e (residual has -half D G = +half D f_bar)
                b = model.end[j, e]
                if b < 0:
                    continue
                for q in range(3):
                    x[2, q] = m1.R[b, k, q]
                cross(model.s[j, e], x[2], x[3])
                for o in range(2):
                    other = model.end[j, o]
                    pair = index.body[b] if o == e else index.couple[j, e]
                    if other < 0 or pair < 0:
                        continue
                    f = -(1.0 - 2.0 * e) * half * m1.f_bar[row + k] / size
                    for c in range(3):
                        slope = f * (x[o, 0] * T[other, 0, c] + x[o, 1] * T[other, 1, c] + x[o, 2] * T[other, 2, c])
                        blocks[pair, k, 3 + c] += slope
                        for q in range(3):
                            blocks[pair, 3 + q, 3 + c] += slope * x[3, q]


@njit(**INNER)
def _spring(model, m1, dt, index, blocks, T, s):
    """-half dw: F = -tension e on i; dF = -(k e e^T + c e (x_dot^T P)/d + tension P/d) dx - c e e^T dx_dot."""
    half = 0.5 * dt
    line = np.empty((6, 3))
    tension = spring_line(model, m1, s, line)
    d = 0.0
    for q in range(3):
        x = line[2, q] - line[3, q]
        for e in range(2):
            if model.spring_end[s, e] >= 0:
                x += (1.0 - 2.0 * e) * m1.r[model.spring_end[s, e], q]
        d += x * x
    d = np.sqrt(d)
    along = dot(line[0], line[1])
    stiff = np.empty((3, 3))
    damp = np.empty((3, 3))
    for a in range(3):
        for c in range(3):
            P = (1.0 if a == c else 0.0) - line[0, a] * line[0, c]
            swing = model.c[s] * line[0, a] * (line[1, c] - along * line[0, c]) / d
            stiff[a, c] = model.k[s] * line[0, a] * line[0, c] + swing + tension * P / d
            damp[a, c] = model.c[s] * line[0, a] * line[0, c]
    move = np.empty((3, 6))
    shift = np.empty((3, 6))
    force = np.empty((3, 6))
    A = np.empty((3, 3))
    H = np.empty((3, 3))
    spin = np.empty(3)
    local = np.empty((3, 3))
    for o in range(2):
        other = model.spring_end[s, o]
        if other < 0:
            continue
        p = model.p[s, o]
        times_hat(m1.R[other], p, A)
        product(A, T[other], H)
        cross(m1.v[other, 3:], p, spin)
        times_hat(m1.R[other], spin, local)
        for a in range(3):
            for c in range(3):
                move[a, c] = half if a == c else 0.0
                move[a, 3 + c] = -H[a, c]
                shift[a, c] = 1.0 if a == c else 0.0
                shift[a, 3 + c] = -A[a, c]
                for q in range(3):
                    shift[a, 3 + c] -= local[a, q] * T[other, q, c]
        for e in range(2):
            b = model.spring_end[s, e]
            if b < 0:
                continue
            pair = index.body[b] if e == o else index.spring[s, e]
            sign = (1.0 - 2.0 * e) * (1.0 - 2.0 * o)
            for a in range(3):
                for c in range(6):
                    total = 0.0
                    for q in range(3):
                        total += stiff[a, q] * move[q, c] + damp[a, q] * shift[q, c]
                    force[a, c] = -sign * total
            K = blocks[pair]
            local2 = np.empty(3)
            moment = np.empty(3)
            for c in range(6):
                turn_back(m1.R[b], force[:, c], local2)
                cross(model.p[s, e], local2, moment)
                for a in range(3):
                    K[a, c] -= half * force[a, c]
                    K[3 + a, c] -= half * moment[a]
            if e == o:  # the arm turns: R^T ((R (theta x p)) x F) = hat(f) hat(p) theta
                for a in range(3):
                    local2[a] = -(1.0 - 2.0 * e) * tension * line[0, a]
                turn_back(m1.R[b], local2, moment)
                hat_hat(moment, p, A)
                product(A, T[b], H)
                for a in range(3):
                    for c in range(3):
                        K[3 + a, 3 + c] -= half * H[a, c]
