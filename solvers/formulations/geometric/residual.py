"""Residual of one ODE-GC step, Eqs. (74) and (75), body by body and joint by joint.

With nu = M_bar mu, P = (m r_dot, R J Omega), D nu the spatial wrench of the rows and D_dot nu its rate (the B term
of Eq. 71)::

    (74)  P1 - P0 - (D1 nu1 - D0 nu0) + dt/2 (D_dot0 nu0 + D_dot1 nu1) - dt/2 (w0 + w1) = 0
    (75)  phi_dot1 + [dt/2 ((C_bar phi_dot + K_bar phi)_0 + (...)_1) - sigma0] / M_bar1 = 0

w is the applied wrench plus D G with G = C_bar mu + K_bar lam - f_bar. The gauge gives nu0 = gauge * nu1 + nu_start:
symmetric (-1, 0), zero (0, 0), accumulate (0, nu carried). Rotational rows are turned back by R1^T.
"""

import numpy as np
from numba import njit

from .directions import direction, masses_and_forces
from .kinematics import applied, axes, points
from .lines import line_reactions, lines
from .springs import coefficients
from .vectors import INNER, JIT, add, blend, cross, dot, minus, plus, put, times, turn, turn_back, turned_by


@njit(**JIT)
def complete(model, motion, settings):
    """Everything that follows from poses and velocities."""
    points(model, motion)
    lines(model, motion)
    axes(model, motion)
    applied(model, motion)
    masses_and_forces(model, motion, settings.direction)
    if settings.by_forces:
        for j in range(len(model.body)):
            for row in range(model.row[j], model.row[j + 1]):
                direction(model, motion, j, row, settings.direction)
                coefficients(model, motion, j, row)
                motion.k_bar[row] = max(motion.k_bar[row], 0.0)  # a negative one drives phi away exponentially
                motion.c_bar[row] += settings.c_bar * motion.m_bar[row]
                motion.k_bar[row] += settings.k_bar * motion.m_bar[row]
    elif settings.corrective:
        for row in range(len(motion.m_bar)):
            motion.c_bar[row] = settings.c_bar * motion.m_bar[row]
            motion.k_bar[row] = settings.k_bar * motion.m_bar[row]


@njit(**INNER)
def move(step):
    """Poses of the end from its velocities, Eq. (66): mean velocity, rotation by the exponential."""
    start, end, half = step.start, step.end, 0.5 * step.dt
    end.t[0] = start.t[0] + step.dt
    for b in range(len(start.r)):
        for k in range(3):
            end.r[b, k] = start.r[b, k] + half * (start.v[b, k] + end.v[b, k])
        turned_by(start.R[b], times(half, plus(start.v[b, 3:], end.v[b, 3:])), end.R[b])


@njit(**JIT)
def start_forces(step, settings):
    """G0."""
    start, rows = step.start, step.rows
    for k in range(len(rows.G0)):
        rows.G0[k] = -settings.use_f_bar * start.f_bar[k]
        if settings.corrective:
            lam_bar = rows.lam0[k] - lambda_penalty(settings) * start.phi[k]
            rows.G0[k] += start.c_bar[k] * rows.mu0[k] + start.k_bar[k] * lam_bar


@njit(**INNER)
def lambda_penalty(settings):
    """xi of lam_bar = lam - xi phi, Eq. (84); it stays when the xi of mu_bar is raised."""
    return settings.penalty.xi if settings.penalty.lambda_bar else 0.0


@njit(**JIT)
def end_forces(step, settings):
    """G1, its derivative, and the factors of (75)."""
    end, rows, half, xi = step.end, step.rows, 0.5 * step.dt, lambda_penalty(settings)
    by_lam = 2.0 if settings.penalty.lambda_bar else 1.0  # the nested loop has -xi dphi1 = dt/2 dmu1, too
    for k in range(len(rows.G1)):
        rows.G1[k] = -settings.use_f_bar * end.f_bar[k]
        rows.dG[k] = 0.0
        rows.on_rate[k] = 1.0
        rows.on_phi[k] = 0.0
        if settings.corrective:
            mu1 = rows.nu1[k] / end.m_bar[k]
            lam1 = rows.lam0[k] + half * (rows.mu0[k] + mu1)  # (67)
            rows.G1[k] += end.c_bar[k] * mu1 + end.k_bar[k] * (lam1 - xi * end.phi[k])
            rows.dG[k] = (end.c_bar[k] + by_lam * half * end.k_bar[k]) / end.m_bar[k]
            rows.on_rate[k] = 1.0 + half * end.c_bar[k] / end.m_bar[k]
            rows.on_phi[k] = half * end.k_bar[k] / end.m_bar[k]


@njit(**INNER)
def balance(model, step, settings, R_v):
    """Eq. (74), rotational rows in the body frame of the end."""
    start, end, half = step.start, step.end, 0.5 * step.dt
    for b in range(len(model.mass)):
        for k in range(3):
            R_v[b, k] = model.mass[b] * (end.v[b, k] - start.v[b, k]) - half * (start.wrench[b, k] + end.wrench[b, k])
        P0 = turn(start.R[b], turn(model.J[b], start.v[b, 3:]))
        put(blend(-1.0, P0, -half, plus(start.wrench[b, 3:], end.wrench[b, 3:])), R_v[b, 3:])
    _point_reactions(model, step, settings, R_v)
    line_reactions(model, step, settings, R_v)
    _axis_reactions(model, step, settings, R_v)
    for b in range(len(model.mass)):
        put(plus(turn_back(end.R[b], R_v[b, 3:]), turn(model.J[b], end.v[b, 3:])), R_v[b, 3:])


@njit(**INNER)
def _point_reactions(model, step, settings, R_v):
    start, end, rows, half = step.start, step.end, step.rows, 0.5 * step.dt
    B = half * settings.b_term
    for j in range(len(model.body)):
        if not model.pins[j]:
            continue
        row = model.row[j]
        nu1 = rows.nu1[row], rows.nu1[row + 1], rows.nu1[row + 2]
        nu0 = plus(times(settings.gauge, nu1), rows.nu_start[row:])
        G0, G1 = times(half, rows.G0[row:]), times(half, rows.G1[row:])
        force = minus(minus(minus(nu0, nu1), G0), G1)
        for e in range(2):
            b, sign = model.body[j, e], 1.0 - 2.0 * e
            if b < 0:
                continue
            at_start = plus(cross(start.arm[j, e], minus(nu0, G0)), cross(start.arm_dot[j, e], times(B, nu0)))
            at_end = cross(end.arm[j, e], plus(nu1, G1))
            moment = plus(minus(at_start, at_end), cross(end.arm_dot[j, e], times(B, nu1)))
            add(sign, force, R_v[b])
            add(sign, moment, R_v[b, 3:])


@njit(**INNER)
def _axis_reactions(model, step, settings, R_v):
    start, end, rows, half = step.start, step.end, step.rows, 0.5 * step.dt
    B = half * settings.b_term
    for j in range(len(model.body)):
        if not model.axes[j]:
            continue
        moment = (0.0, 0.0, 0.0)
        for k in range(model.axes[j]):
            row = model.row[j] + 3 * model.pins[j] + k
            nu1 = rows.nu1[row]
            nu0 = settings.gauge * nu1 + rows.nu_start[row]
            forces = blend(nu0 - half * rows.G0[row], start.a[j, k], -nu1 - half * rows.G1[row], end.a[j, k])
            rates = blend(nu0, start.a_dot[j, k], nu1, end.a_dot[j, k])
            moment = plus(moment, plus(forces, times(B, rates)))
        for e in range(2):
            if model.body[j, e] >= 0:
                add(1.0 - 2.0 * e, moment, R_v[model.body[j, e], 3:])


@njit(**INNER)
def constraint_balance(step, settings, R_mu):
    """Eq. (75) over M_bar."""
    start, end, half = step.start, step.end, 0.5 * step.dt
    for k in range(len(R_mu)):
        R_mu[k] = end.phi_dot[k]
        if settings.carry_sigma:
            R_mu[k] -= step.rows.sigma0[k] / end.m_bar[k]
        if settings.corrective:
            before = start.c_bar[k] * start.phi_dot[k] + start.k_bar[k] * start.phi[k]
            after = end.c_bar[k] * end.phi_dot[k] + end.k_bar[k] * end.phi[k]
            R_mu[k] += half * (before + after) / end.m_bar[k]


@njit(**INNER)
def residual_norm(model, m_bar, R_v, R_mu):
    """Eq. (80): sqrt(R_v . M^-1 R_v + R_mu . M_bar R_mu) [sqrt(J)], where R_mu is (75) over M_bar."""
    total = 0.0
    for b in range(len(model.mass)):
        for k in range(3):
            total += R_v[b, k] * R_v[b, k] / model.mass[b]
        total += dot(R_v[b, 3:], turn(model.J_inv[b], R_v[b, 3:]))
    return np.sqrt(_add_squares(total, m_bar, R_mu))


@njit(**INNER)
def constraint_norm(motion):
    """Eq. (81): sqrt(phi_dot . M_bar phi_dot) [sqrt(J)]."""
    return np.sqrt(_add_squares(0.0, motion.m_bar, motion.phi_dot))


@njit(**INNER)
def _add_squares(total, weight, x):
    for k in range(len(x)):
        total += weight[k] * x[k] * x[k]
    return total
