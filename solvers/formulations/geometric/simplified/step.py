"""The step of ODE-GC by a simplified Newton method on S = A M^-1 A^T, for gravity as the only applied force.

Given v1 and nu1: poses by (66), impulses of (74) in space with nu0 = gauge nu1 + nu_start::

    w   = P0 + dt f - dt/2 (D0 f_bar0 + D1 f_bar1) + (D1 - B D_dot1) nu1 - (D0 + B D_dot0) nu0
    v_n = M^-1 R1^T w,   S x = -A1 v_n,   nu1 += x / (1 - gauge),   v1 = v_n + M^-1 A1^T x

The method contracts by O(dt omega), and the change of v1 in the norm of M is the residual (80) that was there before.
So a step is done when the change is below the tolerance. S is factored anew where the change falls
too slowly; if that does not help, or the rank of the rows is not that of the start, the step is left to ``newton``.
Redundant rows get no multiplier: the motion is that of the proximal saddle.
"""

import math

import numpy as np
from numba import njit

from ..index1.kernel import HOT, factorise, rows, solve
from ..newton import FACTORISATIONS, NEWTON, RESIDUALS, SINKING, SOLVES
from ..vectors import JIT, ONCE, copy, turned_by
from .rows import arms, back, cross, rates, times, torque, turn, turn_back
from .state import DEPTH

MOST = 30  # iterations a step
REFRESHES = 2  # factors of S in a step


@njit(**ONCE)
def begin(lean, settings, h):
    """The start of a step of h from ``k``, which follows ``_arms``."""
    model, k, B = lean.model, lean.k, 0.5 * h * settings.b_term
    copy(k.r, lean.r0)
    copy(k.R, lean.R0)
    copy(k.v, lean.v0)
    copy(lean.f_bar, lean.f_bar0)
    for b in range(len(model.mass)):
        x = times(model.J, b, k.v[b, 3], k.v[b, 4], k.v[b, 5])
        x = turn(k.R, b, x[0], x[1], x[2])
        for q in range(3):
            lean.known[b, q] = model.mass[b] * (k.v[b, q] + h * model.gravity[q])
            lean.known[b, 3 + q] = x[q]
    for j in range(len(model.body)):
        f0, f1, f2 = -0.5 * h * lean.f_bar[j, 0], -0.5 * h * lean.f_bar[j, 1], -0.5 * h * lean.f_bar[j, 2]
        for e in range(2):
            b, sign = model.body[j, e], 1.0 - 2.0 * e
            if b < 0:
                continue
            y0, y1, y2 = lean.arm[j, e, 0], lean.arm[j, e, 1], lean.arm[j, e, 2]
            d = cross(lean.spin[b, 0], lean.spin[b, 1], lean.spin[b, 2], y0, y1, y2)
            lean.b0[j, e, 0], lean.b0[j, e, 1], lean.b0[j, e, 2] = y0 + B * d[0], y1 + B * d[1], y2 + B * d[2]
            add_wrench(lean.known, b, sign, f0, f1, f2, cross(y0, y1, y2, f0, f1, f2))
        if model.axes[j]:
            for c in range(2):
                x = torque(lean, j, c)
                for q in range(3):
                    lean.a0[j, c, q] = x[q] + B * x[3 + q]


@njit(**HOT)
def add_wrench(w, b, sign, f0, f1, f2, moment):
    """w_b += sign (f, moment)"""
    w[b, 0] += sign * f0
    w[b, 1] += sign * f1
    w[b, 2] += sign * f2
    w[b, 3] += sign * moment[0]
    w[b, 4] += sign * moment[1]
    w[b, 5] += sign * moment[2]


@njit(**HOT)
def poses(lean, h):
    """Poses (66) of the end from its velocities."""
    k = lean.k
    for b in range(len(lean.model.mass)):
        for q in range(3):
            k.r[b, q] = lean.r0[b, q] + 0.5 * h * (lean.v0[b, q] + k.v[b, q])
        half0 = 0.5 * h * (lean.v0[b, 3] + k.v[b, 3])
        half1 = 0.5 * h * (lean.v0[b, 4] + k.v[b, 4])
        half2 = 0.5 * h * (lean.v0[b, 5] + k.v[b, 5])
        turned_by(lean.R0[b], (half0, half1, half2), k.R[b])


@njit(**ONCE)
def impulses(lean, settings, h):
    """w of the present estimate: its poses, arms, multipliers."""
    model, gauge, B = lean.model, settings.gauge, 0.5 * h * settings.b_term
    poses(lean, h)
    arms(lean, settings)
    copy(lean.known, lean.w)
    for j in range(len(model.body)):
        row = model.row[j]
        p0, p1, p2 = lean.nu[row], lean.nu[row + 1], lean.nu[row + 2]
        m0 = gauge * p0 + lean.nu_start[row]
        m1 = gauge * p1 + lean.nu_start[row + 1]
        m2 = gauge * p2 + lean.nu_start[row + 2]
        f0, f1, f2 = 0.5 * h * lean.f_bar[j, 0], 0.5 * h * lean.f_bar[j, 1], 0.5 * h * lean.f_bar[j, 2]
        for e in range(2):
            b, sign = model.body[j, e], 1.0 - 2.0 * e
            if b < 0:
                continue
            y0, y1, y2 = lean.arm[j, e, 0], lean.arm[j, e, 1], lean.arm[j, e, 2]
            d = cross(lean.spin[b, 0], lean.spin[b, 1], lean.spin[b, 2], y0, y1, y2)
            x = cross(y0, y1, y2, p0 - f0, p1 - f1, p2 - f2)
            y = cross(d[0], d[1], d[2], p0, p1, p2)
            z = cross(lean.b0[j, e, 0], lean.b0[j, e, 1], lean.b0[j, e, 2], m0, m1, m2)
            moment = (x[0] - B * y[0] - z[0], x[1] - B * y[1] - z[1], x[2] - B * y[2] - z[2])
            add_wrench(lean.w, b, sign, p0 - m0 - f0, p1 - m1 - f1, p2 - m2 - f2, moment)
        if model.axes[j]:
            x0 = x1 = x2 = 0.0
            for c in range(2):
                t = torque(lean, j, c)
                p0 = lean.nu[row + 3 + c]
                m0 = gauge * p0 + lean.nu_start[row + 3 + c]
                x0 += p0 * (t[0] - B * t[3]) - m0 * lean.a0[j, c, 0]
                x1 += p0 * (t[1] - B * t[4]) - m0 * lean.a0[j, c, 1]
                x2 += p0 * (t[2] - B * t[5]) - m0 * lean.a0[j, c, 2]
            for e in range(2):
                if model.body[j, e] >= 0:
                    add_wrench(lean.w, model.body[j, e], 1.0 - 2.0 * e, 0.0, 0.0, 0.0, (x0, x1, x2))


@njit(**HOT)
def to_velocities(lean):
    """w := M^-1 R^T w; ``spin`` := R of its Omega."""
    model, k, w = lean.model, lean.k, lean.w
    for b in range(len(model.mass)):
        x = turn_back(k.R, b, w[b, 3], w[b, 4], w[b, 5])
        y = times(model.J_inv, b, x[0], x[1], x[2])
        for q in range(3):
            w[b, q] /= model.mass[b]
            w[b, 3 + q] = y[q]
        lean.spin[b, 0], lean.spin[b, 1], lean.spin[b, 2] = turn(k.R, b, y[0], y[1], y[2])


@njit(**HOT)
def estimate(lean, settings, h, t):
    """v1 and nu1 with acceleration and row forces extrapolated to the middle of the step, at ``t``."""
    model, k, known = lean.model, lean.k, min(lean.past[0], DEPTH)
    for d in range(known):
        lean.weight[d] = h
        for c in range(known):
            if c != d:
                lean.weight[d] *= (t - lean.middle[c]) / (lean.middle[d] - lean.middle[c])
    for b in range(len(model.mass)):
        for q in range(6):
            x = lean.v0[b, q]
            for d in range(known):
                x += lean.weight[d] * lean.acceleration[d, b, q]
            k.v[b, q] = x
    for i in range(len(lean.nu)):
        x = lean.nu_start[i]
        for d in range(known):
            x += lean.weight[d] * lean.impulse[d, i]
        lean.nu[i] = x / (1.0 - settings.gauge)


@njit(**JIT)
def log_determinant(lean):
    """log10 of the determinant of S in rows scaled to a unit diagonal, dropped rows left out."""
    total = 0.0
    for col in range(len(lean.blocks.joint)):
        for c in range(lean.blocks.size[col]):
            inverse = lean.k.L[lean.blocks.start[col], c, c]
            if inverse > 0.0:
                total -= math.log10(inverse * inverse * lean.k.diagonal[lean.blocks.row[col] + c])
    return total


@njit(**ONCE)
def factor(lean, counts):
    """S at the poses of ``k``."""
    rows(lean.model, lean.k)
    lean.rank[1] = factorise(lean.model, lean.blocks, lean.k)
    lean.past[1] = 1
    counts[FACTORISATIONS] += 1
    before = lean.log_det[0]
    lean.log_det[0] = log_determinant(lean)
    lean.log_det[1] = lean.log_det[0] - before


@njit(**HOT)
def one_step(lean, settings, h, t, counts):
    """One step of h whose middle is at t: the last change of v1 [sqrt(J)], or -1 where it does not converge."""
    begin(lean, settings, h)
    estimate(lean, settings, h, t)
    before, refreshed, x = np.inf, 0, lean.k.rhs
    if lean.log_det[1] < SINKING:  # on its way to a loss of rank: seen step by step
        lean.past[1] = 0
    for _ in range(MOST):
        impulses(lean, settings, h)
        if lean.past[1] == 0:
            factor(lean, counts)
            refreshed += 1
            if lean.rank[1] != lean.rank[0]:
                return -1.0
        to_velocities(lean)
        rates(lean, lean.w, x)
        solve(lean.blocks, lean.k, x)
        for i in range(len(x)):
            lean.nu[i] += x[i] / (1.0 - settings.gauge)
        change = math.sqrt(back(lean, x))
        counts[NEWTON] += 1
        counts[RESIDUALS] += 1
        counts[SOLVES] += 1
        if not np.isfinite(change):
            return -1.0
        if change < settings.tolerance:
            return change
        if change > settings.refresh * before:
            if refreshed == REFRESHES and change > 0.5 * before:
                return -1.0
            if refreshed < REFRESHES:
                lean.past[1] = 0
        before = change
    return -1.0
