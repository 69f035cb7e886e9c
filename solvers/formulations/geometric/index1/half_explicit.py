"""Half-explicit Runge-Kutta of order 4 on index 2, each step's end projected onto phi = 0 (compiled).

Brasey and Hairer 1993, SIAM J. Numer. Anal. 30, five stages (HEM4); with R = R_0 exp(theta) as in ``rkmk``::

    Q_i = q_0 + h sum_{j<i} a_ij q'_j,   V_i = v_0 + h sum_{j<i} a_ij V'_j,   M V'_i = f(Q_i, V_i) + A(Q_i)^T lam_i
    lam_i such that A(Q_{i+1}) V_{i+1} = 0, the sixth being the end of the step

Q_{i+1} does not depend on lam_i, so each lam_i is found from linear equations, A(Q_{i+1}) M^-1 A(Q_i)^T dlam = what is
left of A V: by generalised conjugate residuals (Eisenstat, Elman, Schultz 1983, SIAM J. Numer. Anal. 20) with the S of
the step's start as preconditioner. Repetition with S alone does not converge where light bodies turn, nor where S is
nearly singular. lam at the ends of steps, which are recorded, are those of index 1.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from ..arrays import Model
from ..vectors import JIT, copy, turned_by
from .blocks import WIDTH
from .fixed_step import DONE, MOST_ITERATIONS, STUCK, TURNED, keep_step, largest, times_of
from .kernel import (
    HOT,
    Kernel,
    accelerate,
    add_back,
    add_gyroscopic,
    applied,
    clear,
    minus_rates,
    project,
    rows,
    solve,
    times_inverse_mass,
    times_rows,
)
from .rkmk import FINISHED, FULL, NOT_FINITE, theta_dot

STAGES = 5
DIRECTIONS, NUMBERS = 200, 4_000_000  # kept at most, and what they may hold
_S = math.sqrt(6.0)
A = np.array([
    [0.0, 0.0, 0.0, 0.0, 0.0],
    [0.3, 0.0, 0.0, 0.0, 0.0],
    [(1.0 + _S) / 30.0, (11.0 - 4.0 * _S) / 30.0, 0.0, 0.0, 0.0],
    [(-79.0 - 31.0 * _S) / 150.0, (-1.0 - 4.0 * _S) / 30.0, (24.0 + 11.0 * _S) / 25.0, 0.0, 0.0],
    [(14.0 + 5.0 * _S) / 6.0, (-8.0 + 7.0 * _S) / 6.0, (-9.0 - 7.0 * _S) / 4.0, (9.0 - _S) / 4.0, 0.0],
    [0.0, 0.0, (16.0 - _S) / 36.0, (16.0 + _S) / 36.0, 1.0 / 9.0],
])  # fmt: skip
C = A.sum(axis=1)


class Scheme(NamedTuple):
    """Coefficients, the end of the step last; ``tolerance`` of the last correction of velocities [m/s, rad/s]."""

    a: np.ndarray  # (6, 5)
    c: np.ndarray  # (6,) places of the stages and the end
    tolerance: float


class Step(NamedTuple):
    """Room for one step: columns of ``slope`` and ``y`` are r (3), theta (3), v (6)."""

    y0: np.ndarray  # (nb, 12)
    R0: np.ndarray  # (nb, 3, 3)
    y: np.ndarray  # (nb, 12)
    slope: np.ndarray  # (5, nb, 12)
    lam: np.ndarray  # (nrows,)
    push: np.ndarray  # (nb, 6) M^-1 A_i^T of a vector of rows
    Y: np.ndarray  # (nj, 2, WIDTH, 3) of the stage whose multipliers are sought
    way: np.ndarray  # (nj, WIDTH, 3) of it
    tried: np.ndarray  # (depth, nrows) of multipliers
    done: np.ndarray  # (depth, nrows) to what is left of their equations
    clock: np.ndarray  # (3,)


def empty_step(model: Model) -> Step:
    """Arrays of one step."""
    nb, nrows = len(model.mass), int(model.row[-1])
    depth = max(1, min(DIRECTIONS, nrows, NUMBERS // max(nrows, 1)))
    return Step(
        np.zeros((nb, 12)), np.zeros((nb, 3, 3)), np.zeros((nb, 12)), np.zeros((STAGES, nb, 12)), np.zeros(nrows),
        np.zeros((nb, 6)), np.zeros((len(model.body), 2, WIDTH, 3)), np.zeros((len(model.body), WIDTH, 3)),
        np.zeros((depth, nrows)), np.zeros((depth, nrows)), np.zeros(3, dtype=np.int64),
    )  # fmt: skip


def start(k: Kernel, step: Step) -> None:
    """Rows, factor and multipliers of the start are those of index 1."""
    step.lam[:] = k.lam


@njit(**HOT)
def _hold(model, blocks, k, step, tolerance, weight, i):
    """Add to lam of stage i what makes A V + phi_t = 0 at the poses of ``k``; returns whether corrections vanished."""
    left = k.rhs
    minus_rates(model, k, k.v, left)
    solve(blocks, k, left)
    depth = len(step.tried)
    for n in range(depth + MOST_ITERATIONS):
        p, q, share = step.tried[n % depth], step.done[n % depth], 1.0
        copy(left, p)
        step.clock[1] += 1
        last = _push(model, step, p) <= tolerance
        if not last:  # q = S^-1 A M^-1 A_i^T p, made orthogonal to those of the tries before
            for a in range(len(q)):
                q[a] = 0.0
            times_rows(model, k, step.push, 1.0, q)
            solve(blocks, k, q)
            for j in range(min(n, depth)):
                if j != n % depth:
                    shared = _inner(q, step.done[j])
                    _add(-shared, step.done[j], q)
                    _add(-shared, step.tried[j], p)
            size = math.sqrt(_inner(q, q))
            if not size > 0.0:
                return False
            for a in range(len(q)):
                p[a], q[a] = p[a] / size, q[a] / size
            share = _inner(q, left)
            _add(-share, q, left)
            _push(model, step, p)
        for b in range(len(k.v)):
            for a in range(6):
                k.v[b, a] += share * step.push[b, a]
                step.slope[i, b, 6 + a] += share * step.push[b, a] / weight
        _add(share / weight, p, step.lam)
        if last:
            return True
    return False


@njit(**HOT)
def _inner(x, y):
    """x . y"""
    out = 0.0
    for a in range(len(x)):
        out += x[a] * y[a]
    return out


@njit(**HOT)
def _add(share, x, y):
    """y += share x"""
    for a in range(len(x)):
        y[a] += share * x[a]


@njit(**HOT)
def _push(model, step, x):
    """push = M^-1 A_i^T x; returns its largest entry."""
    clear(step.push)
    add_back(model, step.way, step.Y, x, step.push)
    return largest(step.push)


@njit(**HOT)
def _step(model, blocks, k, step, s, t0, h):
    """One step from where ``k`` stands, whose factor is at hand; returns the outcome."""
    copy(k.R, step.R0)
    k.t[0] = t0
    for b in range(len(k.v)):
        for a in range(3):
            step.y0[b, a], step.y0[b, 3 + a] = k.r[b, a], 0.0
        for a in range(6):
            step.y0[b, 6 + a] = k.v[b, a]
    copy(step.y0, step.y)
    rows(model, k)
    for i in range(STAGES):
        applied(model, k)
        add_gyroscopic(model, k)
        times_inverse_mass(model, k.force)
        add_back(model, k.way, k.Y, step.lam, k.force)
        copy(k.Y, step.Y)
        copy(k.way, step.way)
        for b in range(len(k.v)):
            y, slope = step.y[b], step.slope[i, b]
            slope[3], slope[4], slope[5] = theta_dot(y[3], y[4], y[5], y[9], y[10], y[11])
            for a in range(3):
                slope[a] = y[6 + a]
            for a in range(6):
                slope[6 + a] = k.force[b, a]
        for b in range(len(k.v)):
            for a in range(12):
                x = 0.0
                for j in range(i + 1):
                    x += s.a[i + 1, j] * step.slope[j, b, a]
                step.y[b, a] = step.y0[b, a] + h * x
            turn = step.y[b, 3] ** 2 + step.y[b, 4] ** 2 + step.y[b, 5] ** 2
            if not math.isfinite(turn):
                return NOT_FINITE
            if turn > math.pi**2:
                return TURNED
            for a in range(3):
                k.r[b, a] = step.y[b, a]
            turned_by(step.R0[b], (step.y[b, 3], step.y[b, 4], step.y[b, 5]), k.R[b])
            for a in range(6):
                k.v[b, a] = step.y[b, 6 + a]
        k.t[0] = t0 + h * s.c[i + 1]
        rows(model, k)
        if not _hold(model, blocks, k, step, s.tolerance, h * s.a[i + 1, i], i):
            return STUCK
        for b in range(len(k.v)):
            for a in range(6):
                step.y[b, 6 + a] = k.v[b, a]
    accelerate(model, blocks, k)
    copy(k.lam, step.lam)
    project(model, blocks, k, step.push)
    step.clock[2] += 1
    return DONE


@njit(**JIT)
def march(model, blocks, k, step, s, dt, t_end, record):
    """Steps of ``dt``; returns (outcome, steps recorded)."""
    done = 0
    while done < len(record.t):
        t0, t1 = times_of(step.clock, dt, t_end)
        if not t1 > t0:
            return FINISHED, done
        outcome = _step(model, blocks, k, step, s, t0, t1 - t0)
        if outcome != DONE:
            return outcome, done
        if not keep_step(k, step.lam, step.clock, t1, record, done):
            return NOT_FINITE, done
        done += 1
    return FULL, done
