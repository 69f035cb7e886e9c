"""RATTLE on SO(3) with the free body as drift, and symmetric compositions of it (compiled).

One sub-step of h from (q_0, v_0) with the factor of S at q_0 at hand (McLachlan, Modin, Verdier, Wilkins 2014)::

    p_half = M v_0 + h/2 f(q_0) + A_0^T x         translation and body momentum L = J Omega; f without gyroscopic term
    q_1 = free motion over h from (q_0, p_half)   x such that phi(q_1) = 0: S_0 dx = -phi / h, repeated
    v_1 = M^-1 (p_1 + h/2 f(q_1) + A_1^T y)       S_1 y = -A_1 (...): A_1 v_1 = 0

Symplectic and time-reversible; phi and A v at rounding in every step. Dampers enter f(q_1, v_1) by a fixed point.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from ..vectors import JIT, copy
from .free_body import turn_freely
from .kernel import (
    HOT,
    accelerate,
    add_rows_back,
    applied,
    clear,
    factorise,
    rows,
    solve,
    times_inverse_mass,
    times_rows,
)
from .rkmk import FINISHED, FULL, NOT_FINITE, keep

MOST_ITERATIONS = 40
DAMPER_PASSES = 6
STUCK = 4


class Step(NamedTuple):
    """Room for one step; ``clock`` = (steps, iterations, factorisations)."""

    r0: np.ndarray  # (nb, 3)
    R0: np.ndarray  # (nb, 3, 3)
    half: np.ndarray  # (nb, 6) M^-1 p without the impulse of the constraints
    v: np.ndarray  # (nb, 6)
    L: np.ndarray  # (3,)
    x: np.ndarray  # (nrows,) impulse of the first half
    lam: np.ndarray  # (nrows,) reaction at the start of the sub-step
    Y0: np.ndarray  # Y of the rows at the start
    clock: np.ndarray  # (3,)
    tolerance: float  # of phi, relative to the length scale
    damped: int


def empty_step(nb: int, nrows: int, nj: int, width: int, tolerance: float, damped: bool) -> Step:
    """Arrays of one sub-step."""
    return Step(
        r0=np.zeros((nb, 3)), R0=np.zeros((nb, 3, 3)), half=np.zeros((nb, 6)), v=np.zeros((nb, 6)), L=np.zeros(3),
        x=np.zeros(nrows), lam=np.zeros(nrows), Y0=np.zeros((nj, 2, width, 3)),
        clock=np.zeros(3, dtype=np.int64), tolerance=tolerance, damped=int(damped),
    )  # fmt: skip


@njit(**HOT)
def _add_back(model, Y, x, w):
    """w (nb, 6) += M^-1 A^T x with the rows whose Y = X J^-1 is given."""
    for j in range(len(model.body)):
        first = model.row[j]
        for e in range(2):
            b = model.body[j, e]
            if b < 0:
                continue
            share = (1.0 - 2.0 * e) / model.mass[b]
            for a in range(model.row[j + 1] - first):
                y = x[first + a]
                if a < 3:
                    w[b, a] += share * y
                w[b, 3] += Y[j, e, a, 0] * y
                w[b, 4] += Y[j, e, a, 1] * y
                w[b, 5] += Y[j, e, a, 2] * y


@njit(**HOT)
def _drift(model, axes, k, step, h):
    """Poses of ``k`` from the start of the sub-step at ``step.v``, whose Omega becomes that at its end."""
    J = model.J
    for b in range(len(model.mass)):
        w0, w1, w2 = step.v[b, 3], step.v[b, 4], step.v[b, 5]
        for a in range(3):
            k.r[b, a] = step.r0[b, a] + h * step.v[b, a]
            step.L[a] = J[b, a, 0] * w0 + J[b, a, 1] * w1 + J[b, a, 2] * w2
            for c in range(3):
                k.R[b, a, c] = step.R0[b, a, c]
        turn_freely(axes, b, h, k.R, step.L)
        l0, l1, l2 = step.L[0], step.L[1], step.L[2]
        for a in range(3):
            step.v[b, 3 + a] = model.J_inv[b, a, 0] * l0 + model.J_inv[b, a, 1] * l1 + model.J_inv[b, a, 2] * l2


@njit(**HOT)
def _kick(model, k, step, h, v):
    """v (nb, 6) += h/2 M^-1 f at the poses and velocities of ``k``."""
    applied(model, k)
    times_inverse_mass(model, k.force)
    for b in range(len(model.mass)):
        for a in range(6):
            v[b, a] += 0.5 * h * k.force[b, a]


@njit(**JIT)
def start(model, blocks, k, step):
    """Rows, factor and reaction at the start."""
    accelerate(model, blocks, k)
    copy(k.lam, step.lam)
    step.clock[2] += 1


@njit(**HOT)
def _sub_step(model, blocks, axes, k, step, h):
    """One sub-step; returns whether phi came down to the tolerance."""
    copy(k.r, step.r0)
    copy(k.R, step.R0)
    copy(k.v, step.half)
    _kick(model, k, step, h, step.half)
    for a in range(len(step.x)):
        step.x[a] = 0.5 * h * step.lam[a]
        copy(k.Y, step.Y0)
    last = np.inf
    good = False
    for _ in range(MOST_ITERATIONS):
        copy(step.half, step.v)
        _add_back(model, step.Y0, step.x, step.v)
        _drift(model, axes, k, step, h)
        rows(model, k)
        size = 0.0
        for a in range(len(k.phi)):
            size = max(size, abs(k.phi[a]))
            k.rhs[a] = -k.phi[a] / h
        step.clock[1] += 1
        if not np.isfinite(size):
            return False
        if size <= step.tolerance and (size == 0.0 or size > 0.1 * last):  # until it falls no more
            good = True
            break
        if size > 2.0 * last and size > step.tolerance:
            return False
        good = size <= step.tolerance
        last = size
        solve(blocks, k, k.rhs)
        for a in range(len(step.x)):
            step.x[a] += k.rhs[a]
    if not good:
        return False
    copy(step.v, k.v)
    rows(model, k)
    factorise(model, blocks, k)
    step.clock[2] += 1
    for _ in range(DAMPER_PASSES if step.damped else 1):
        copy(step.v, step.half)
        _kick(model, k, step, h, step.half)
        clear(k.rhs)
        times_rows(model, k, step.half, -1.0, k.rhs)
        solve(blocks, k, k.rhs)
        add_rows_back(model, k, k.rhs, step.half)
        copy(step.half, k.v)
    for a in range(len(k.rhs)):
        step.lam[a] = 2.0 * k.rhs[a] / h
    return True


@njit(**JIT)
def march(model, blocks, axes, k, step, gamma, dt, t_end, record):
    """Steps of ``dt``, each the sub-steps ``gamma dt``; returns (outcome, steps recorded)."""
    done = 0
    total = int(np.ceil(t_end / dt - 1e-9))
    while done < len(record.t):
        n = step.clock[0]
        if n >= total:
            return FINISHED, done
        t0, t1 = n * dt, min((n + 1) * dt, t_end)
        for i in range(len(gamma)):
            if not _sub_step(model, blocks, axes, k, step, gamma[i] * (t1 - t0)):
                return STUCK, done
        for b in range(len(model.mass)):
            if not np.isfinite(k.v[b, 0] + k.v[b, 3]):
                return NOT_FINITE, done
        step.clock[0] += 1
        record.t[done] = t1
        keep(k, step.lam, record, done)
        done += 1
    return FULL, done
