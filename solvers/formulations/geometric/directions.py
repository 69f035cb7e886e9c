"""Directions c_R and the coefficients they give each constraint row: M_bar, f_bar (Eq. 30), C_bar, K_bar (Eq. 32).

``a . c = 1`` (Eq. 31) leaves c free; three choices:

- ``a``: c = a / (a . a), defined where M is singular too;
- ``mass``: c = M^-1 a / (a . M^-1 a);
- ``translation``: c = (e_k, 0) on the first body, for spherical joints: M_bar = m, f_bar = applied force.
"""

import numpy as np
from numba import njit

from .kinematics import spring_line
from .small import INNER, back3, cross, cross3, dot, turn3, turn_back

CHOICES = ("a", "mass", "translation")


@njit(**INNER)
def coefficients(model, m, choice, with_springs):
    """Fill ``m.m_bar, m.f_bar`` and, if ``with_springs``, also ``m.c, m.c_bar, m.k_bar``."""
    _masses_and_forces(model, m, choice)
    if with_springs:
        work = np.empty((4, 3))
        for j in range(len(model.end)):
            for row in range(model.row[j], model.row[j + 1]):
                direction(model, m, j, row, choice, work)
                m.c_bar[row] = 0.0
                m.k_bar[row] = 0.0
                _project_springs(model, m, j, row)


@njit(**INNER)
def _masses_and_forces(model, m, choice):
    """M_bar = c . M c and f_bar = c . f of all rows in closed form.

    a has translation e_k (point rows) and rotation x; ``size`` is a . a, or a . M^-1 a.
    """
    for j in range(len(model.end)):
        first, last = model.row[j], model.row[j + 1]
        if choice == 2:
            for k in range(3):
                m.m_bar[first + k] = model.mass[model.end[j, 0]]
                m.f_bar[first + k] = m.force[model.end[j, 0], k]
            continue
        for row in range(first, last):  # sums over the ends: size in c_bar, a . M a in m_bar, force in f_bar
            m.c_bar[row] = 0.0
            m.m_bar[row] = 0.0
            m.f_bar[row] = 0.0
        for e in range(2):
            b = model.end[j, e]
            if b < 0:
                continue
            sign = 1.0 - 2.0 * e
            mass = model.mass[b]
            t0, t1, t2 = 0.0, 0.0, 0.0
            if len(model.k) > 0:  # gravity has no torque about C
                t0, t1, t2 = back3(m.R, b, m.force[b, 3], m.force[b, 4], m.force[b, 5])
            for k in range(last - first):
                x0, x1, x2 = rotation_part(model.s, m.R, m.u, m.n, j, e, b, k)
                row = first + k
                if choice == 0:
                    y0, y1, y2 = turn3(model.J, b, x0, x1, x2)
                    m.c_bar[row] += x0 * x0 + x1 * x1 + x2 * x2
                    m.m_bar[row] += x0 * y0 + x1 * y1 + x2 * y2
                    m.f_bar[row] += sign * (t0 * x0 + t1 * x1 + t2 * x2)
                    if k < 3:
                        m.c_bar[row] += 1.0
                        m.m_bar[row] += mass
                        m.f_bar[row] += sign * m.force[b, k]
                else:
                    y0, y1, y2 = turn3(model.J_inv, b, x0, x1, x2)
                    m.c_bar[row] += x0 * y0 + x1 * y1 + x2 * y2
                    m.f_bar[row] += sign * (t0 * y0 + t1 * y1 + t2 * y2)
                    if k < 3:
                        m.c_bar[row] += 1.0 / mass
                        m.f_bar[row] += sign * m.force[b, k] / mass
        for row in range(first, last):
            scale = 1.0 / m.c_bar[row]
            m.m_bar[row] = m.m_bar[row] * scale * scale if choice == 0 else scale
            m.f_bar[row] *= scale
            m.c_bar[row] = 0.0


@njit(**INNER)
def rotation_part(s, R, u, n, j, e, b, k):
    """Rotational part of row k of joint ``j`` on end ``e``, body ``b``, in its frame, without the end's sign."""
    if k < 3:
        return cross3(s[j, e, 0], s[j, e, 1], s[j, e, 2], R[b, k, 0], R[b, k, 1], R[b, k, 2])
    x0, x1, x2 = cross3(u[j, 0], u[j, 1], u[j, 2], n[j, k - 3, 0], n[j, k - 3, 1], n[j, k - 3, 2])
    return back3(R, b, x0, x1, x2)


@njit(**INNER)
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
        x0, x1, x2 = rotation_part(model.s, m.R, m.u, m.n, j, e, b, k)
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


@njit(**INNER)
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


@njit(**INNER)
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


@njit(**INNER)
def _rate(m, b, p):
    out = np.empty(3)
    cross(m.v[b, 3:], p, out)
    return out


@njit(**INNER)
def _work_of(model, m, row, end, b, s, e, force):
    """c . (force, p x R^T force) of one end."""
    local = np.empty((2, 3))
    turn_back(m.R[b], force, local[0])
    cross(model.p[s, e], local[0], local[1])
    return dot(m.c[row, end, :3], force) + dot(m.c[row, end, 3:], local[1])


@njit(**INNER)
def _turning(model, m, row, end, b, s, e, force):
    local = np.empty((3, 3))
    turn_back(m.R[b], force, local[0])
    cross(local[0], m.c[row, end, 3:], local[1])  # -(c_r x f) = f x c_r
    cross(model.p[s, e], local[1], local[2])
    return dot(m.c[row, end, 3:], local[2])


@njit(**INNER)
def _touches(model, s, j):
    return _end_of(model, j, model.spring_end[s, 0]) >= 0 or _end_of(model, j, model.spring_end[s, 1]) >= 0


@njit(**INNER)
def _end_of(model, j, b):
    if b < 0:
        return -1
    if model.end[j, 0] == b:
        return 0
    if model.end[j, 1] == b:
        return 1
    return -1
