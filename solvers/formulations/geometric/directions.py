"""Directions c_R and the coefficients they give each constraint row: M_bar, f_bar (Eq. 30), C_bar, K_bar (Eq. 32).

``a . c = 1`` (Eq. 31) leaves c free; three choices:

- ``a``: c = a / (a . a), defined where M is singular too;
- ``mass``: c = M^-1 a / (a . M^-1 a);
- ``translation``: c = (e_k, 0) on the first body, for spherical joints: M_bar = m, f_bar = applied force.
"""

import numpy as np
from numba import njit

from solvers.formulations.geometric.kinematics import spring_line
from solvers.formulations.geometric.small import JIT, back3, cross, cross3, dot, quadratic3, turn3, turn_back

CHOICES = ("a", "mass", "translation")


@njit(**JIT)
def coefficients(model, m, choice, with_springs):
    """Fill ``m.m_bar, m.f_bar`` and, if ``with_springs``, also ``m.c, m.c_bar, m.k_bar``."""
    for j in range(len(model.end)):
        for k in range(model.row[j + 1] - model.row[j]):
            _mass_and_force(model, m, j, k, choice)
    if with_springs:
        work = np.empty((4, 3))
        for j in range(len(model.end)):
            for row in range(model.row[j], model.row[j + 1]):
                direction(model, m, j, row, choice, work)
                m.c_bar[row] = 0.0
                m.k_bar[row] = 0.0
                _project_springs(model, m, j, row)


@njit(**JIT)
def _mass_and_force(model, m, j, k, choice):
    """M_bar = c . M c and f_bar = c . f in closed form: a has translation e_k (point rows) and rotation x."""
    row = model.row[j] + k
    if choice == 2:
        m.m_bar[row] = model.mass[model.end[j, 0]]
        m.f_bar[row] = m.force[model.end[j, 0], k]
        return
    point = 1.0 if k < 3 else 0.0
    size = 0.0
    mass = 0.0
    force = 0.0
    for e in range(2):
        b = model.end[j, e]
        if b < 0:
            continue
        sign = 1.0 - 2.0 * e
        x0, x1, x2 = rotation_part(model, m, j, e, k)
        f = m.force[b, k] if k < 3 else 0.0
        t0, t1, t2 = back3(m.R, b, m.force[b, 3], m.force[b, 4], m.force[b, 5])
        if choice == 0:
            size += point + x0 * x0 + x1 * x1 + x2 * x2
            mass += point * model.mass[b] + quadratic3(model.J, b, x0, x1, x2)
            force += sign * (f + t0 * x0 + t1 * x1 + t2 * x2)
        else:
            y0, y1, y2 = turn3(model.J_inv, b, x0, x1, x2)
            size += point / model.mass[b] + x0 * y0 + x1 * y1 + x2 * y2
            force += sign * (f / model.mass[b] + t0 * y0 + t1 * y1 + t2 * y2)
    m.m_bar[row] = mass / (size * size) if choice == 0 else 1.0 / size
    m.f_bar[row] = force / size


@njit(**JIT)
def rotation_part(model, m, j, e, k):
    """Rotational part of row k of joint ``j`` on end ``e``, body frame, without the end's sign."""
    b = model.end[j, e]
    if k < 3:
        return cross3(
            model.s[j, e, 0], model.s[j, e, 1], model.s[j, e, 2], m.R[b, k, 0], m.R[b, k, 1], m.R[b, k, 2]
        )
    n = k - 3
    x0, x1, x2 = cross3(m.u[j, 0], m.u[j, 1], m.u[j, 2], m.n[j, n, 0], m.n[j, n, 1], m.n[j, n, 2])
    return back3(m.R, b, x0, x1, x2)


@njit(**JIT)
def direction(model, m, j, row, choice, work):
    """Fill ``m.c[row]``: c_R on both ends (translation [space], rotation [body])."""
    if choice == 2:
        m.c[row, :, :] = 0.0
        m.c[row, 0, row - model.row[j]] = 1.0
        return
    size = 0.0
    for e in range(2):
        a = m.c[row, e]
        a[:] = 0.0
        b = model.end[j, e]
        if b < 0:
            continue
        k = row - model.row[j]
        sign = 1.0 - 2.0 * e
        if k < 3:
            a[k] = sign
        x0, x1, x2 = rotation_part(model, m, j, e, k)
        a[3], a[4], a[5] = sign * x0, sign * x1, sign * x2
        if choice == 0:
            for q in range(6):
                size += a[q] * a[q]
        else:
            for q in range(3):
                work[0, q] = dot(model.J_inv[b, q], a[3:])
            for q in range(3):
                size += a[q] * a[q] / model.mass[b] + a[3 + q] * work[0, q]
                a[q] /= model.mass[b]
                a[3 + q] = work[0, q]
    for e in range(2):
        for q in range(6):
            m.c[row, e, q] /= size


@njit(**JIT)
def _project_springs(model, m, j, row):
    """Eq. (32): -c . (df/dv) c and -c . (df/dq) c, f = (force [space], torque [body]), spring by spring.

    Moving along c by e shifts the end points by x = c_t + c_r x p (in space) and turns the body torque's frame.
    """
    line = np.empty((6, 3))
    x = np.empty((4, 3))
    for s in range(len(model.k)):
        if not _touches(model, s, j):
            continue
        tension = spring_line(model, m, s, line)
        e_hat = line[0]
        d = tension_free_length(model, s, m, line)
        for q in range(3):
            x[0, q] = 0.0  # shift of x_i - x_j
            x[1, q] = 0.0  # its rate of change for the same motion: R (Omega x (c_r x p))
        for e in range(2):
            b = model.spring_end[s, e]
            end = _end_of(model, j, b)
            if b < 0 or end < 0:
                continue
            sign = 1.0 - 2.0 * e
            cross(m.c[row, end, 3:], model.p[s, e], x[2])
            cross(m.c[row, end, 3:], _rate(m, b, model.p[s, e]), x[3])
            for q in range(3):
                x[0, q] += sign * (m.c[row, end, q] + dot(m.R[b, q], x[2]))
                x[1, q] += sign * dot(m.R[b, q], x[3])
        along = dot(e_hat, x[0])
        rate = dot(line[1], x[0]) / d - dot(e_hat, line[1]) * along / d + dot(e_hat, x[1])
        for e in range(2):
            b = model.spring_end[s, e]
            end = _end_of(model, j, b)
            if b < 0 or end < 0:
                continue
            sign = 1.0 - 2.0 * e
            # generalised force of a unit tension on this end is -sign e_hat at the point
            for q in range(3):
                x[2, q] = -sign * (model.c[s] * along * e_hat[q])
                dT = model.k[s] * along + model.c[s] * rate
                x[3, q] = -sign * (dT * e_hat[q] + tension * (x[0, q] - along * e_hat[q]) / d)
            m.c_bar[row] -= _work_of(model, m, row, end, b, s, e, x[2])
            m.k_bar[row] -= _work_of(model, m, row, end, b, s, e, x[3])
            # the body torque p x R^T F also changes because R turns: -p x (c_r x R^T F)
            for q in range(3):
                x[2, q] = -sign * tension * e_hat[q]
            m.k_bar[row] -= _turning(model, m, row, end, b, s, e, x[2])


@njit(**JIT)
def tension_free_length(model, s, m, line):
    """Present length of spring ``s`` [m]: end points from ``line``'s arms and the bodies' positions."""
    d = 0.0
    for q in range(3):
        x = line[2, q] - line[3, q]
        if model.spring_end[s, 0] >= 0:
            x += m.r[model.spring_end[s, 0], q]
        if model.spring_end[s, 1] >= 0:
            x -= m.r[model.spring_end[s, 1], q]
        d += x * x
    return np.sqrt(d)


@njit(**JIT)
def _rate(m, b, p):
    out = np.empty(3)
    cross(m.v[b, 3:], p, out)
    return out


@njit(**JIT)
def _work_of(model, m, row, end, b, s, e, force):
    """c . (force, p x R^T force) of one end."""
    local = np.empty((2, 3))
    turn_back(m.R[b], force, local[0])
    cross(model.p[s, e], local[0], local[1])
    return dot(m.c[row, end, :3], force) + dot(m.c[row, end, 3:], local[1])


@njit(**JIT)
def _turning(model, m, row, end, b, s, e, force):
    local = np.empty((3, 3))
    turn_back(m.R[b], force, local[0])
    cross(local[0], m.c[row, end, 3:], local[1])  # -(c_r x f) = f x c_r
    cross(model.p[s, e], local[1], local[2])
    return dot(m.c[row, end, 3:], local[2])


@njit(**JIT)
def _touches(model, s, j):
    return _end_of(model, j, model.spring_end[s, 0]) >= 0 or _end_of(model, j, model.spring_end[s, 1]) >= 0


@njit(**JIT)
def _end_of(model, j, b):
    if b < 0:
        return -1
    if model.end[j, 0] == b:
        return 0
    if model.end[j, 1] == b:
        return 1
    return -1
