"""Residual of one ODE-GC step, Eqs. (74) and (75), body and joint by joint.

With nu = M_bar mu, P = (m r_dot, R J Omega), D nu the spatial wrench of the rows and D_dot nu its rate (the B term
of Eq. 71)::

    (74)  P1 - P0 - (D1 nu1 - D0 nu0) + dt/2 (D_dot0 nu0 + D_dot1 nu1) - dt/2 (w0 + w1) = 0
    (75)  phi_dot1 + [dt/2 ((C_bar phi_dot + K_bar phi)_0 + (...)_1) - sigma0] / M_bar1 = 0

w is the applied wrench plus D G with G = C_bar mu + K_bar lam - f_bar. The gauge gives nu0 = gauge * nu1 + nu_start:
symmetric (-1, 0), zero (0, 0), accumulate (0, nu carried). Rotational rows are turned back by R1^T.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from .directions import coefficients
from .kinematics import applied, joints
from .small import INNER, JIT, back3, cross3, quadratic3, turn3, turned_by


class Settings(NamedTuple):
    """The choices of docs/notation.md that the kernels branch on."""

    gauge: float  # -1 symmetric, 0 zero and accumulate
    keep_nu: int  # 1: nu is carried from step to step (accumulate, or C_bar, K_bar != 0)
    direction: int  # index in ``directions.CHOICES``
    use_f_bar: int
    corrective: int  # 1: C_bar, K_bar by Eq. (32); mu, lam and sigma carried
    carry_sigma: int  # 1: sigma0 of (75) is that of (62) at the last step, else 0
    b_term: float  # 1; 0 drops the B term of Eq. (71), which costs the order (a planted error)
    tolerance: float  # [sqrt(J)], Eqs. (80), (81)
    max_newton: int
    refresh: float  # a kept factorisation is renewed when a correction shrinks the residual by less than this factor
    couple: int  # 1: body-to-body blocks of the Jacobian are kept


class Rows(NamedTuple):
    """Per row, carried over the step: unknown nu1 and what it starts from."""

    nu1: np.ndarray
    nu_start: np.ndarray
    lam0: np.ndarray
    mu0: np.ndarray
    sigma0: np.ndarray
    G0: np.ndarray
    G1: np.ndarray
    dG: np.ndarray  # dG1/dnu1
    weight: np.ndarray  # (2, nrows): phi_dot and phi factors of (75)


@njit(**JIT)
def complete(model, m, settings):
    """Everything that follows from poses and velocities of ``m``."""
    joints(model, m)
    applied(model, m)
    coefficients(model, m, settings.direction, settings.corrective)


@njit(**INNER)
def move(m0, m1, dt):
    """Poses of ``m1`` from its velocities, Eq. (66): mean velocity, rotation by the exponential."""
    half = 0.5 * dt
    for b in range(len(m0.r)):
        for k in range(3):
            m1.r[b, k] = m0.r[b, k] + half * (m0.v[b, k] + m1.v[b, k])
        x0, x1, x2 = m0.v[b, 3] + m1.v[b, 3], m0.v[b, 4] + m1.v[b, 4], m0.v[b, 5] + m1.v[b, 5]
        turned_by(m0.R, b, half * x0, half * x1, half * x2, m1.R)


@njit(**JIT)
def start_forces(m0, rows, settings):
    """G of the step's start."""
    for k in range(len(rows.G0)):
        rows.G0[k] = -settings.use_f_bar * m0.f_bar[k]
        if settings.corrective:
            rows.G0[k] += m0.c_bar[k] * rows.mu0[k] + m0.k_bar[k] * rows.lam0[k]


@njit(**JIT)
def end_forces(m0, m1, rows, dt, settings):
    """G of the step's end and the factors of (75)."""
    for k in range(len(rows.G1)):
        rows.G1[k] = -settings.use_f_bar * m1.f_bar[k]
        rows.dG[k] = 0.0
        rows.weight[0, k] = 1.0
        rows.weight[1, k] = 0.0
        if settings.corrective:
            mu1 = rows.nu1[k] / m1.m_bar[k]
            lam1 = rows.lam0[k] + 0.5 * dt * (rows.mu0[k] + mu1)
            rows.G1[k] += m1.c_bar[k] * mu1 + m1.k_bar[k] * lam1
            rows.dG[k] = (m1.c_bar[k] + 0.5 * dt * m1.k_bar[k]) / m1.m_bar[k]
            rows.weight[0, k] = 1.0 + 0.5 * dt * m1.c_bar[k] / m1.m_bar[k]
            rows.weight[1, k] = 0.5 * dt * m1.k_bar[k] / m1.m_bar[k]


@njit(**INNER)
def balance(model, m0, m1, rows, dt, settings, body, constraint):
    """Fill ``body`` (nb, 6) with (74), rotational rows in the body frame of the end, and ``constraint`` with (75)."""
    half = 0.5 * dt
    J, v0, v1 = model.J, m0.v, m1.v
    for b in range(len(model.mass)):
        for k in range(3):
            body[b, k] = model.mass[b] * (v1[b, k] - v0[b, k]) - half * (m0.force[b, k] + m1.force[b, k])
        x0, x1, x2 = turn3(J, b, v0[b, 3], v0[b, 4], v0[b, 5])
        x0, x1, x2 = turn3(m0.R, b, x0, x1, x2)
        body[b, 3] = -x0 - half * (m0.force[b, 3] + m1.force[b, 3])
        body[b, 4] = -x1 - half * (m0.force[b, 4] + m1.force[b, 4])
        body[b, 5] = -x2 - half * (m0.force[b, 5] + m1.force[b, 5])
    _point_reactions(model, m0, m1, rows, dt, settings, body)
    _axis_reactions(model, m0, m1, rows, dt, settings, body)
    for b in range(len(model.mass)):
        x0, x1, x2 = back3(m1.R, b, body[b, 3], body[b, 4], body[b, 5])
        y0, y1, y2 = turn3(J, b, v1[b, 3], v1[b, 4], v1[b, 5])
        body[b, 3], body[b, 4], body[b, 5] = x0 + y0, x1 + y1, x2 + y2
    for k in range(len(constraint)):
        constraint[k] = m1.phi_dot[k]
        if settings.carry_sigma:
            constraint[k] -= rows.sigma0[k] / m1.m_bar[k]
        if settings.corrective:
            before = m0.c_bar[k] * m0.phi_dot[k] + m0.k_bar[k] * m0.phi[k]
            after = m1.c_bar[k] * m1.phi_dot[k] + m1.k_bar[k] * m1.phi[k]
            constraint[k] += half * (before + after) / m1.m_bar[k]


@njit(**INNER)
def _point_reactions(model, m0, m1, rows, dt, settings, body):
    half = 0.5 * dt
    B = half * settings.b_term
    for j in range(len(model.end)):
        q = model.row[j]
        x0, x1, x2 = rows.nu1[q], rows.nu1[q + 1], rows.nu1[q + 2]
        g = settings.gauge
        y0, y1, y2 = g * x0 + rows.nu_start[q], g * x1 + rows.nu_start[q + 1], g * x2 + rows.nu_start[q + 2]
        p0, p1, p2 = half * rows.G0[q], half * rows.G0[q + 1], half * rows.G0[q + 2]
        s0, s1, s2 = half * rows.G1[q], half * rows.G1[q + 1], half * rows.G1[q + 2]
        for e in range(2):
            b = model.end[j, e]
            if b < 0:
                continue
            sign = 1.0 - 2.0 * e
            body[b, 0] += sign * (y0 - x0 - p0 - s0)
            body[b, 1] += sign * (y1 - x1 - p1 - s1)
            body[b, 2] += sign * (y2 - x2 - p2 - s2)
            # moments: arm0 x (F0 - G0) + B arm_dot0 x F0 - arm1 x (F1 + G1) + B arm_dot1 x F1
            a0, a1, a2 = m0.arm[j, e, 0], m0.arm[j, e, 1], m0.arm[j, e, 2]
            t0, t1, t2 = cross3(a0, a1, a2, y0 - p0, y1 - p1, y2 - p2)
            a0, a1, a2 = m0.arm_dot[j, e, 0], m0.arm_dot[j, e, 1], m0.arm_dot[j, e, 2]
            u0, u1, u2 = cross3(a0, a1, a2, B * y0, B * y1, B * y2)
            a0, a1, a2 = m1.arm[j, e, 0], m1.arm[j, e, 1], m1.arm[j, e, 2]
            w0, w1, w2 = cross3(a0, a1, a2, x0 + s0, x1 + s1, x2 + s2)
            a0, a1, a2 = m1.arm_dot[j, e, 0], m1.arm_dot[j, e, 1], m1.arm_dot[j, e, 2]
            z0, z1, z2 = cross3(a0, a1, a2, B * x0, B * x1, B * x2)
            body[b, 3] += sign * (t0 + u0 - w0 + z0)
            body[b, 4] += sign * (t1 + u1 - w1 + z1)
            body[b, 5] += sign * (t2 + u2 - w2 + z2)


@njit(**INNER)
def _axis_reactions(model, m0, m1, rows, dt, settings, body):
    half = 0.5 * dt
    B = half * settings.b_term
    for j in range(len(model.end)):
        if not model.hinged[j]:
            continue
        t0, t1, t2 = 0.0, 0.0, 0.0
        for k in range(2):
            row = model.row[j] + 3 + k
            nu1 = rows.nu1[row]
            nu0 = settings.gauge * nu1 + rows.nu_start[row]
            w0, w1 = nu0 - half * rows.G0[row], -nu1 - half * rows.G1[row]
            a0, a1, a2, d0, d1, d2 = axis_torque(m0.u, m0.u_dot, m0.n, m0.n_dot, j, k)
            b0, b1, b2, e0, e1, e2 = axis_torque(m1.u, m1.u_dot, m1.n, m1.n_dot, j, k)
            t0 += w0 * a0 + w1 * b0 + B * (nu0 * d0 + nu1 * e0)
            t1 += w0 * a1 + w1 * b1 + B * (nu0 * d1 + nu1 * e1)
            t2 += w0 * a2 + w1 * b2 + B * (nu0 * d2 + nu1 * e2)
        for e in range(2):
            b = model.end[j, e]
            if b >= 0:
                sign = 1.0 - 2.0 * e
                body[b, 3] += sign * t0
                body[b, 4] += sign * t1
                body[b, 5] += sign * t2


@njit(**INNER)
def axis_torque(u, u_dot, n, n_dot, j, k):
    """Components of a = u x n_k, the unit torque of axis row k of joint ``j``, and of its rate."""
    u0, u1, u2, n0, n1, n2 = u[j, 0], u[j, 1], u[j, 2], n[j, k, 0], n[j, k, 1], n[j, k, 2]
    a0, a1, a2 = cross3(u0, u1, u2, n0, n1, n2)
    b0, b1, b2 = cross3(u_dot[j, 0], u_dot[j, 1], u_dot[j, 2], n0, n1, n2)
    c0, c1, c2 = cross3(u0, u1, u2, n_dot[j, k, 0], n_dot[j, k, 1], n_dot[j, k, 2])
    return a0, a1, a2, b0 + c0, b1 + c1, b2 + c2


@njit(**INNER)
def residual_norm(model, m1, body, constraint):
    """sqrt(R_v . M^-1 R_v + R_mu . M_bar^-1 R_mu) [sqrt(J)], Eq. (80), with R_mu = M_bar * (75)."""
    total = 0.0
    for b in range(len(model.mass)):
        for k in range(3):
            total += body[b, k] * body[b, k] / model.mass[b]
        total += quadratic3(model.J_inv, b, body[b, 3], body[b, 4], body[b, 5])
    for k in range(len(constraint)):
        total += m1.m_bar[k] * constraint[k] * constraint[k]
    return np.sqrt(total)
