"""Rows of A at the poses and velocities of a kernel: X, Y = X J^-1, gamma and phi."""

from numba import njit

from ..lines import line_rows
from .room import HOT


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
def turned(k, b, x0, x1, x2):
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
        u0, u1, u2, p0, p1, p2, a0, a1, a2 = turned(k, i, model.u[j, c, 0], model.u[j, c, 1], model.u[j, c, 2])
        n0, n1, n2, q0, q1, q2, b0, b1, b2 = turned(k, g, model.n[j, c, 0], model.n[j, c, 1], model.n[j, c, 2])
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
