"""Joints and applied forces at one instant: arms, axes, phi, phi_dot, and the wrench of gravity and springs."""

import math

import numpy as np
from numba import njit

from .small import INNER, cross, cross3, dot, turn, turn3


@njit(**INNER)
def joints(model, m):
    """Fill arms, axes and their rates, phi and phi_dot of ``m`` from its poses and velocities."""
    for j in range(len(model.end)):
        row = model.row[j]
        for k in range(3):
            m.phi[row + k] = 0.0
            m.phi_dot[row + k] = 0.0
        for e in range(2):
            sign = 1.0 - 2.0 * e
            b = model.end[j, e]
            s0, s1, s2 = model.s[j, e, 0], model.s[j, e, 1], model.s[j, e, 2]
            if b < 0:
                m.arm[j, e, 0], m.arm[j, e, 1], m.arm[j, e, 2] = s0, s1, s2
                for k in range(3):
                    m.arm_dot[j, e, k] = 0.0
                    m.phi[row + k] += sign * m.arm[j, e, k]
                continue
            m.arm[j, e, 0], m.arm[j, e, 1], m.arm[j, e, 2] = turn3(m.R, b, s0, s1, s2)
            x0, x1, x2 = cross3(m.v[b, 3], m.v[b, 4], m.v[b, 5], s0, s1, s2)
            m.arm_dot[j, e, 0], m.arm_dot[j, e, 1], m.arm_dot[j, e, 2] = turn3(m.R, b, x0, x1, x2)
            for k in range(3):
                m.phi[row + k] += sign * (m.r[b, k] + m.arm[j, e, k])
                m.phi_dot[row + k] += sign * (m.v[b, k] + m.arm_dot[j, e, k])
    _axes(model, m)


@njit(**INNER)
def _axes(model, m):
    for j in range(len(model.end)):
        if not model.hinged[j]:
            continue
        i, g = model.end[j, 0], model.end[j, 1]
        x0, x1, x2 = model.u[j, 0], model.u[j, 1], model.u[j, 2]
        m.u[j, 0], m.u[j, 1], m.u[j, 2] = turn3(m.R, i, x0, x1, x2)
        y0, y1, y2 = cross3(m.v[i, 3], m.v[i, 4], m.v[i, 5], x0, x1, x2)
        m.u_dot[j, 0], m.u_dot[j, 1], m.u_dot[j, 2] = turn3(m.R, i, y0, y1, y2)
        for k in range(2):
            x0, x1, x2 = model.n[j, k, 0], model.n[j, k, 1], model.n[j, k, 2]
            if g < 0:
                m.n[j, k, 0], m.n[j, k, 1], m.n[j, k, 2] = x0, x1, x2
                m.n_dot[j, k, 0], m.n_dot[j, k, 1], m.n_dot[j, k, 2] = 0.0, 0.0, 0.0
            else:
                m.n[j, k, 0], m.n[j, k, 1], m.n[j, k, 2] = turn3(m.R, g, x0, x1, x2)
                y0, y1, y2 = cross3(m.v[g, 3], m.v[g, 4], m.v[g, 5], x0, x1, x2)
                m.n_dot[j, k, 0], m.n_dot[j, k, 1], m.n_dot[j, k, 2] = turn3(m.R, g, y0, y1, y2)
            phi = 0.0
            phi_dot = 0.0
            for q in range(3):
                phi += m.u[j, q] * m.n[j, k, q]
                phi_dot += m.u_dot[j, q] * m.n[j, k, q] + m.u[j, q] * m.n_dot[j, k, q]
            m.phi[model.row[j] + 3 + k] = phi
            m.phi_dot[model.row[j] + 3 + k] = phi_dot


@njit(**INNER)
def applied(model, m):
    """Fill ``m.force``: gravity and spring-dampers, force and torque about C, both in space."""
    for b in range(len(model.mass)):
        for k in range(3):
            m.force[b, k] = model.mass[b] * model.gravity[k]
            m.force[b, 3 + k] = 0.0
    if len(model.k) == 0:
        return
    line = np.empty((6, 3))
    for s in range(len(model.k)):
        tension = spring_line(model, m, s, line)
        for e in range(2):
            b = model.spring_end[s, e]
            if b < 0:
                continue
            sign = 1.0 - 2.0 * e
            for k in range(3):
                line[4, k] = -sign * tension * line[0, k]
                m.force[b, k] += line[4, k]
            cross(line[2 + e], line[4], line[5])
            for k in range(3):
                m.force[b, 3 + k] += line[5, k]


@njit(**INNER)
def spring_line(model, m, s, line):
    """Tension [N] of spring ``s``; ``line`` rows: 0 unit vector from j to i, 1 relative velocity, 2 and 3 the arms."""
    local = np.empty(3)
    line[0, :] = 0.0
    line[1, :] = 0.0
    for e in range(2):
        sign = 1.0 - 2.0 * e
        b = model.spring_end[s, e]
        if b < 0:
            line[2 + e, :] = model.p[s, e, :]
            for k in range(3):
                line[0, k] += sign * model.p[s, e, k]
            continue
        turn(m.R[b], model.p[s, e], line[2 + e])
        cross(m.v[b, 3:], model.p[s, e], local)
        for k in range(3):
            line[0, k] += sign * (m.r[b, k] + line[2 + e, k])
            spin = m.R[b, k, 0] * local[0] + m.R[b, k, 1] * local[1] + m.R[b, k, 2] * local[2]
            line[1, k] += sign * (m.v[b, k] + spin)
    d = math.sqrt(dot(line[0], line[0]))
    for k in range(3):
        line[0, k] /= d
    return model.k[s] * (d - model.d0[s]) + model.c[s] * dot(line[0], line[1])
