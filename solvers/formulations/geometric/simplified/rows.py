"""Rows of the simplified method in space: arms, unit torques, f_bar of gravity; A w and A^T x without forming A."""

import math

from numba import njit

from ..directions import ALONG_A, TRANSLATION
from ..index1.kernel import HOT


@njit(**HOT)
def cross(a0, a1, a2, b0, b1, b2):
    """a x b"""
    return a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0


@njit(**HOT)
def turn(R, b, x0, x1, x2):
    """R_b x"""
    return (
        R[b, 0, 0] * x0 + R[b, 0, 1] * x1 + R[b, 0, 2] * x2,
        R[b, 1, 0] * x0 + R[b, 1, 1] * x1 + R[b, 1, 2] * x2,
        R[b, 2, 0] * x0 + R[b, 2, 1] * x1 + R[b, 2, 2] * x2,
    )


@njit(**HOT)
def turn_back(R, b, x0, x1, x2):
    """R_b^T x"""
    return (
        R[b, 0, 0] * x0 + R[b, 1, 0] * x1 + R[b, 2, 0] * x2,
        R[b, 0, 1] * x0 + R[b, 1, 1] * x1 + R[b, 2, 1] * x2,
        R[b, 0, 2] * x0 + R[b, 1, 2] * x1 + R[b, 2, 2] * x2,
    )


@njit(**HOT)
def times(J, b, x0, x1, x2):
    """J_b x"""
    return (
        J[b, 0, 0] * x0 + J[b, 0, 1] * x1 + J[b, 0, 2] * x2,
        J[b, 1, 0] * x0 + J[b, 1, 1] * x1 + J[b, 1, 2] * x2,
        J[b, 2, 0] * x0 + J[b, 2, 1] * x1 + J[b, 2, 2] * x2,
    )


@njit(**HOT)
def arms(lean, settings):
    """Arms, R Omega, unit torques and f_bar at the poses and velocities of ``k``."""
    model, k = lean.model, lean.k
    for b in range(len(model.mass)):
        lean.spin[b, 0], lean.spin[b, 1], lean.spin[b, 2] = turn(k.R, b, k.v[b, 3], k.v[b, 4], k.v[b, 5])
    for j in range(len(model.body)):
        for e in range(2):
            b = model.body[j, e]
            if b >= 0:
                x = turn(k.R, b, model.s[j, e, 0], model.s[j, e, 1], model.s[j, e, 2])
                lean.arm[j, e, 0], lean.arm[j, e, 1], lean.arm[j, e, 2] = x
        if settings.use_f_bar:
            f_bar(lean, settings.direction, j)
        if model.axes[j]:
            for c in range(2):
                x = torque(lean, j, c)
                lean.a[j, c, 0], lean.a[j, c, 1], lean.a[j, c, 2] = x[0], x[1], x[2]


@njit(**HOT)
def f_bar(lean, choice, j):
    """Eq. (30) with gravity: c = a/(a . a), M^-1 a/(a . M^-1 a) or (e_k, 0), where |s x R^T e_k|^2 = s^2 - arm_k^2."""
    model, k = lean.model, lean.k
    for q in range(3):
        if choice == TRANSLATION:
            lean.f_bar[j, q] = model.mass[model.body[j, 0]] * model.gravity[q]
            continue
        size, force = 0.0, 0.0
        for e in range(2):
            b, sign = model.body[j, e], 1.0 - 2.0 * e
            if b < 0:
                continue
            s0, s1, s2 = model.s[j, e, 0], model.s[j, e, 1], model.s[j, e, 2]
            if choice == ALONG_A:
                size += 1.0 + s0 * s0 + s1 * s1 + s2 * s2 - lean.arm[j, e, q] * lean.arm[j, e, q]
                force += sign * model.mass[b] * model.gravity[q]
            else:
                x = cross(s0, s1, s2, k.R[b, q, 0], k.R[b, q, 1], k.R[b, q, 2])
                y = times(model.J_inv, b, x[0], x[1], x[2])
                size += 1.0 / model.mass[b] + x[0] * y[0] + x[1] * y[1] + x[2] * y[2]
                force += sign * model.gravity[q]
        lean.f_bar[j, q] = force / size


@njit(**HOT)
def torque(lean, j, c):
    """Unit torque u x n_c of an axis row, and its rate."""
    model, k, i, g = lean.model, lean.k, lean.model.body[j, 0], lean.model.body[j, 1]
    u = turn(k.R, i, model.u[j, c, 0], model.u[j, c, 1], model.u[j, c, 2])
    u_dot = cross(lean.spin[i, 0], lean.spin[i, 1], lean.spin[i, 2], u[0], u[1], u[2])
    n0, n1, n2 = model.n[j, c, 0], model.n[j, c, 1], model.n[j, c, 2]
    m0 = m1 = m2 = 0.0
    if g >= 0:
        n0, n1, n2 = turn(k.R, g, n0, n1, n2)
        m0, m1, m2 = cross(lean.spin[g, 0], lean.spin[g, 1], lean.spin[g, 2], n0, n1, n2)
    a = cross(u[0], u[1], u[2], n0, n1, n2)
    p = cross(u_dot[0], u_dot[1], u_dot[2], n0, n1, n2)
    q = cross(u[0], u[1], u[2], m0, m1, m2)
    return a[0], a[1], a[2], p[0] + q[0], p[1] + q[1], p[2] + q[2]


@njit(**HOT)
def rates(lean, w, out):
    """out (nrows,) := -A w, with ``arm``, ``a`` and ``spin`` of w."""
    model, spin = lean.model, lean.spin
    for j in range(len(model.body)):
        row = model.row[j]
        y0 = y1 = y2 = z0 = z1 = z2 = 0.0
        for e in range(2):
            b, sign = model.body[j, e], 1.0 - 2.0 * e
            if b < 0:
                continue
            s0, s1, s2 = spin[b, 0], spin[b, 1], spin[b, 2]
            x = cross(s0, s1, s2, lean.arm[j, e, 0], lean.arm[j, e, 1], lean.arm[j, e, 2])
            y0 -= sign * (w[b, 0] + x[0])
            y1 -= sign * (w[b, 1] + x[1])
            y2 -= sign * (w[b, 2] + x[2])
            z0 -= sign * s0
            z1 -= sign * s1
            z2 -= sign * s2
        out[row], out[row + 1], out[row + 2] = y0, y1, y2
        if model.axes[j]:
            for c in range(2):
                out[row + 3 + c] = z0 * lean.a[j, c, 0] + z1 * lean.a[j, c, 1] + z2 * lean.a[j, c, 2]


@njit(**HOT)
def back(lean, x):
    """w += M^-1 A^T x; the square of the change of v1 to it, in the norm of M [J]; v1 := w."""
    model, k, w, impulse = lean.model, lean.k, lean.w, lean.known.shape[0]
    total = 0.0
    for b in range(impulse):
        lean.spin[b, 0] = lean.spin[b, 1] = lean.spin[b, 2] = 0.0
    for j in range(len(model.body)):
        row = model.row[j]
        x0, x1, x2 = x[row], x[row + 1], x[row + 2]
        t0 = t1 = t2 = 0.0
        if model.axes[j]:
            for c in range(2):
                y = x[row + 3 + c]
                t0 += y * lean.a[j, c, 0]
                t1 += y * lean.a[j, c, 1]
                t2 += y * lean.a[j, c, 2]
        for e in range(2):
            b, sign = model.body[j, e], 1.0 - 2.0 * e
            if b < 0:
                continue
            y = cross(lean.arm[j, e, 0], lean.arm[j, e, 1], lean.arm[j, e, 2], x0, x1, x2)
            share = sign / model.mass[b]
            w[b, 0] += share * x0
            w[b, 1] += share * x1
            w[b, 2] += share * x2
            lean.spin[b, 0] += sign * (y[0] + t0)
            lean.spin[b, 1] += sign * (y[1] + t1)
            lean.spin[b, 2] += sign * (y[2] + t2)
    for b in range(len(model.mass)):
        y = turn_back(k.R, b, lean.spin[b, 0], lean.spin[b, 1], lean.spin[b, 2])
        z = times(model.J_inv, b, y[0], y[1], y[2])
        for q in range(3):
            w[b, 3 + q] += z[q]
        d0, d1, d2 = w[b, 0] - k.v[b, 0], w[b, 1] - k.v[b, 1], w[b, 2] - k.v[b, 2]
        total += model.mass[b] * (d0 * d0 + d1 * d1 + d2 * d2)
        d0, d1, d2 = w[b, 3] - k.v[b, 3], w[b, 4] - k.v[b, 4], w[b, 5] - k.v[b, 5]
        y = times(model.J, b, d0, d1, d2)
        total += d0 * y[0] + d1 * y[1] + d2 * y[2]
        for q in range(6):
            k.v[b, q] = w[b, q]
    return total


@njit(**HOT)
def constraint_norm(lean, settings):
    """Eq. (81) at the poses and velocities of ``_arms``."""
    model, k, phi_dot, total = lean.model, lean.k, lean.k.rhs, 0.0
    rates(lean, k.v, phi_dot)
    for j in range(len(model.body)):
        for c in range(model.row[j + 1] - model.row[j]):
            size, inertia = 0.0, 0.0
            for e in range(2):
                b = model.body[j, e]
                if b < 0:
                    continue
                if c < 3:
                    x = cross(
                        model.s[j, e, 0], model.s[j, e, 1], model.s[j, e, 2], k.R[b, c, 0], k.R[b, c, 1], k.R[b, c, 2]
                    )
                else:
                    x = turn_back(k.R, b, lean.a[j, c - 3, 0], lean.a[j, c - 3, 1], lean.a[j, c - 3, 2])
                if settings.direction == ALONG_A:
                    y = times(model.J, b, x[0], x[1], x[2])
                    size += x[0] * x[0] + x[1] * x[1] + x[2] * x[2] + (1.0 if c < 3 else 0.0)
                    inertia += x[0] * y[0] + x[1] * y[1] + x[2] * y[2] + (model.mass[b] if c < 3 else 0.0)
                else:
                    y = times(model.J_inv, b, x[0], x[1], x[2])
                    size += x[0] * y[0] + x[1] * y[1] + x[2] * y[2] + (1.0 / model.mass[b] if c < 3 else 0.0)
            m_bar = inertia / (size * size) if settings.direction == ALONG_A else 1.0 / size
            if settings.direction == TRANSLATION:
                m_bar = model.mass[model.body[j, 0]]
            total += m_bar * phi_dot[model.row[j] + c] * phi_dot[model.row[j] + c]
    return math.sqrt(total)
