"""Exact derivative of the step residual (module ``residual``) in dense blocks, one per body, joint end and pair.

The pose of the end follows its velocity: ``dr1 = dt/2 dr_dot1`` and ``dR1 = R1 hat(theta)``, ``theta = T dOmega1``,
``T = dt/2 dexp(dt/2 (Omega0 + Omega1))``. A point row's block uses hat identities in the body frame, with
``f = R1^T F1`` and ``beta = -s + dt/2 Omega1 x s``::

    R1^T d(b1 x F1) = hat(f) hat(beta) theta + dt/2 hat(f) hat(s) dOmega

Left out: how C_bar, K_bar, M_bar and the springs' part of f_bar change within the step (of order dt^2; it only
slows the convergence). Without springs the Jacobian is exact.
"""

import numpy as np
from numba import njit

from solvers.formulations.geometric.kinematics import spring_line
from solvers.formulations.geometric.residual import axis_torque
from solvers.formulations.geometric.small import (
    JIT,
    cross,
    dot,
    hat_hat,
    product,
    right_differential,
    times_hat,
    turn_back,
)


@njit(**JIT)
def assemble(model, m0, m1, rows, dt, settings, diagonal, index, blocks, T):
    """Fill ``blocks`` (npairs, 6, 6); ``index`` says which block is whose; ``diagonal`` (nrows,) is (Xi M_bar)^-1."""
    blocks[:] = 0.0
    x = np.empty(3)
    A = np.empty((3, 3))
    H = np.empty((3, 3))
    for b in range(len(model.mass)):
        for k in range(3):
            x[k] = 0.5 * dt * (m0.v[b, 3 + k] + m1.v[b, 3 + k])
        right_differential(x, 0.5 * dt, T[b])
        K = blocks[index.body[b]]
        for k in range(3):
            K[k, k] = model.mass[b]
            x[k] = dot(model.J[b, k], m1.v[b, 3:])
        # d(R J Omega) = R (J dOmega - hat(J Omega) theta)
        H[0, 0], H[0, 1], H[0, 2] = 0.0, -x[2], x[1]
        H[1, 0], H[1, 1], H[1, 2] = x[2], 0.0, -x[0]
        H[2, 0], H[2, 1], H[2, 2] = -x[1], x[0], 0.0
        product(H, T[b], A)
        for k in range(3):
            for c in range(3):
                K[3 + k, 3 + c] = model.J[b, k, c] - A[k, c]
    for j in range(len(model.end)):
        _point_rows(model, m0, m1, rows, dt, settings, index, blocks, T, j)
        if model.hinged[j]:
            _axis_rows(model, m0, m1, rows, dt, settings, index, blocks, T, j)
        D = blocks[index.diagonal[j]]
        for k in range(model.row[j + 1] - model.row[j]):
            D[k, k] = diagonal[model.row[j] + k]
    for s in range(len(model.k)):
        _spring(model, m1, dt, index, blocks, T, s)


@njit(**JIT)
def _point_rows(model, m0, m1, rows, dt, settings, index, blocks, T, j):
    half = 0.5 * dt
    B = half * settings.b_term
    row = model.row[j]
    g = settings.gauge
    x = np.empty((8, 3))
    A = np.empty((3, 3))
    H = np.empty((3, 3))
    for k in range(3):
        x[0, k] = rows.nu1[row + k]
        x[1, k] = half * rows.G1[row + k]
    for e in range(2):
        b = model.end[j, e]
        if b < 0:
            continue
        sign = 1.0 - 2.0 * e
        s = model.s[j, e]
        R = m1.R[b]
        K = blocks[index.body[b]]
        turn_back(R, x[0], x[2])  # f
        turn_back(R, x[1], x[3])  # half G in the body
        cross(m1.v[b, 3:], s, x[4])  # Omega x s
        for k in range(3):
            x[5, k] = -s[k] + B * x[4, k]  # beta
        hat_hat(x[2], x[5], A)
        hat_hat(x[3], s, H)
        for k in range(3):
            for c in range(3):
                A[k, c] -= H[k, c]
        product(A, T[b], H)
        hat_hat(x[2], s, A)
        for k in range(3):
            for c in range(3):
                K[3 + k, 3 + c] += sign * (H[k, c] + B * A[k, c])
        # columns of nu1: translation sign (g - 1 - half dG), moments R^T (b1 + g b0 - half dG arm1) x e_k
        C = blocks[index.column[j, e]]
        for k in range(3):
            slope = half * rows.dG[row + k]
            C[k, k] = sign * (g - 1.0 - slope)
            for q in range(3):
                b0 = m0.arm[j, e, q] + B * m0.arm_dot[j, e, q]
                x[6, q] = -m1.arm[j, e, q] + B * m1.arm_dot[j, e, q] + g * b0 - slope * m1.arm[j, e, q]
            turn_back(R, x[6], x[7])
            for q in range(3):
                x[6, q] = R[k, q]  # R^T e_k
            cross(x[7], x[6], x[4])
            for q in range(3):
                C[3 + q, k] = sign * x[4, q]
        _point_constraint(m1, rows, half, index, blocks, T, j, e, b, sign, s, row, A, H)
    if settings.use_f_bar and settings.direction != 2:
        _f_bar(model, m1, half, index, blocks, T, settings, j, x)


@njit(**JIT)
def _point_constraint(m1, rows, half, index, blocks, T, j, e, b, sign, s, row, A, H):
    """Rows: d phi_dot = dr_dot - R (hat(Omega x s) theta + hat(s) dOmega), d phi = half dr_dot - R hat(s) theta."""
    C = blocks[index.row[j, e]]
    local = np.empty(3)
    cross(m1.v[b, 3:], s, local)
    S = np.empty((3, 3))
    times_hat(m1.R[b], local, A)
    times_hat(m1.R[b], s, S)
    product(A, T[b], H)
    product(S, T[b], A)
    for k in range(3):
        w, p = rows.weight[0, row + k], rows.weight[1, row + k]
        C[k, k] = sign * (w + half * p)
        for c in range(3):
            C[k, 3 + c] = -sign * (w * (H[k, c] + S[k, c]) + p * A[k, c])


@njit(**JIT)
def _f_bar(model, m1, half, index, blocks, T, settings, j, x):
    """-half D1 G1 with G1 = -f_bar = -N / size: size depends on the arms, f_bar' = -f_bar size' / size."""
    row = model.row[j]
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
            sign = 1.0 - 2.0 * e
            for q in range(3):
                x[2, q] = m1.R[b, k, q]
            cross(model.s[j, e], x[2], x[3])
            for o in range(2):
                other = model.end[j, o]
                if other < 0:
                    continue
                pair = index.body[b] if o == e else index.couple[j, e]
                if pair < 0:
                    continue
                K = blocks[pair]
                f = -sign * half * m1.f_bar[row + k] / size
                for c in range(3):
                    slope = f * (x[o, 0] * T[other, 0, c] + x[o, 1] * T[other, 1, c] + x[o, 2] * T[other, 2, c])
                    K[k, 3 + c] += slope
                    for q in range(3):
                        K[3 + q, 3 + c] += slope * x[3, q]


@njit(**JIT)
def _axis_rows(model, m0, m1, rows, dt, settings, index, blocks, T, j):
    """Torque t = sum_k (-a + B a_dot) nu - half a G, a = u x n_k, on i and -t on j; and the rows phi_dot."""
    half = 0.5 * dt
    B = half * settings.b_term
    ends = model.end[j]
    x = np.empty((6, 3))
    space = np.empty((2, 2, 3, 3))  # derivative of t on (end, theta | dOmega), space
    space[:] = 0.0
    M = np.empty((3, 3))
    for k in range(2):
        row = model.row[j] + 3 + k
        nu, G = rows.nu1[row], half * rows.G1[row]
        x[0, 0], x[0, 1], x[0, 2], x[1, 0], x[1, 1], x[1, 2] = axis_torque(m1, j, k)
        x[3, 0], x[3, 1], x[3, 2], x[4, 0], x[4, 1], x[4, 2] = axis_torque(m0, j, k)
        for q in range(3):
            x[5, q] = (-1.0 - half * rows.dG[row]) * x[0, q] + B * x[1, q]
            x[5, q] += settings.gauge * (x[3, q] + B * x[4, q])
        for e in range(2):
            b = ends[e]
            if b < 0:
                continue
            turn_back(m1.R[b], x[5], x[2])
            C = blocks[index.column[j, e]]
            for q in range(3):
                C[3 + q, 3 + k] = (1.0 - 2.0 * e) * x[2, q]
        _axis_torque_slope(model, m1, j, k, -nu - G, B * nu, space, x, M)
        _axis_constraint(model, m1, rows, half, index, blocks, T, j, k, row, x)
    for e in range(2):
        b = ends[e]
        if b < 0:
            continue
        for o in range(2):
            other = ends[o]
            if other < 0:
                continue
            pair = index.body[b] if o == e else index.couple[j, e]
            if pair < 0:
                continue
            product(space[o, 0], T[other], M)
            K = blocks[pair]
            for c in range(3):
                for q in range(3):
                    x[0, q] = M[q, c] + space[o, 1, q, c]
                turn_back(m1.R[b], x[0], x[1])
                for q in range(3):
                    K[3 + q, 3 + c] += (1.0 - 2.0 * e) * x[1, q]


@njit(**JIT)
def _axis_torque_slope(model, m1, j, k, weight, rate, space, x, M):
    """Add d(weight u x n + rate (u_dot x n + u x n_dot)) to ``space``."""
    i, g = model.end[j, 0], model.end[j, 1]
    u, n = m1.u[j], m1.n[j, k]
    # du = -R hat(u_i) theta, du_dot = -R (hat(Omega x u_i) theta + hat(u_i) dOmega); d(u x y) = -hat(y) du
    for q in range(3):
        x[2, q] = weight * n[q] + rate * m1.n_dot[j, k, q]
    times_hat(m1.R[i], model.u[j], M)
    _add_hat_product(x[2], M, 1.0, space[0, 0])
    _add_hat_product(n, M, rate, space[0, 1])
    cross(m1.v[i, 3:], model.u[j], x[3])
    times_hat(m1.R[i], x[3], M)
    _add_hat_product(n, M, rate, space[0, 0])
    if g < 0:
        return
    for q in range(3):
        x[2, q] = weight * u[q] + rate * m1.u_dot[j, q]
    times_hat(m1.R[g], model.n[j, k], M)
    _add_hat_product(x[2], M, -1.0, space[1, 0])
    _add_hat_product(u, M, -rate, space[1, 1])
    cross(m1.v[g, 3:], model.n[j, k], x[3])
    times_hat(m1.R[g], x[3], M)
    _add_hat_product(u, M, -rate, space[1, 0])


@njit(**JIT)
def _add_hat_product(y, M, weight, out):
    """out += weight hat(y) M"""
    for c in range(3):
        out[0, c] += weight * (y[1] * M[2, c] - y[2] * M[1, c])
        out[1, c] += weight * (y[2] * M[0, c] - y[0] * M[2, c])
        out[2, c] += weight * (y[0] * M[1, c] - y[1] * M[0, c])


@njit(**JIT)
def _axis_constraint(model, m1, rows, half, index, blocks, T, j, k, row, x):
    """(R (theta x p)) . y = theta . (p x R^T y) for p = u_i, Omega x u_i and y = n, n_dot; likewise on j."""
    for e in range(2):
        b = model.end[j, e]
        if b < 0:
            continue
        p = model.u[j] if e == 0 else model.n[j, k]
        y = m1.n[j, k] if e == 0 else m1.u[j]
        y_dot = m1.n_dot[j, k] if e == 0 else m1.u_dot[j]
        C = blocks[index.row[j, e]]
        turn_back(m1.R[b], y, x[2])
        turn_back(m1.R[b], y_dot, x[3])
        cross(p, x[2], x[4])  # on dOmega, and of phi on theta
        cross(p, x[3], x[5])
        cross(m1.v[b, 3:], p, x[3])
        cross(x[3], x[2], x[1])
        w, f = rows.weight[0, row], rows.weight[1, row]
        for q in range(3):
            x[5, q] = w * (x[5, q] + x[1, q]) + f * x[4, q]
        for c in range(3):
            slope = x[5, 0] * T[b, 0, c] + x[5, 1] * T[b, 1, c] + x[5, 2] * T[b, 2, c]
            C[3 + k, 3 + c] = w * x[4, c] + slope


@njit(**JIT)
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
