"""Runge-Kutta-Munthe-Kaas steps on index 1, error-controlled, each accepted step projected (compiled).

In a step from (r0, R0): y = (r, theta, v) with R = R0 exp(theta), theta = 0 at the start, and::

    r' = v,   theta' = dexp^-1(theta) Omega,   v' = index-1 acceleration

The inverse differential is exact for each body, so the order is that of the tableau for any pair (Munthe-Kaas 1999).
The last stage stands at the end of the step and serves as the next one's first, although the projection moves the
point: that change is of the order of the error, O(h^(p+1)).
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from ..vectors import JIT, close_rotations, copy, turned_by
from .kernel import HOT, accelerate, project

FULL, FINISHED, UNDERFLOW, NOT_FINITE = range(4)
SAFETY, LEAST, MOST = 0.9, 0.2, 5.0  # of the step's change
SHORTEST = 1e-14  # of the time: below it a step no longer moves the clock


class Stages(NamedTuple):
    """Room for one step: columns of ``y`` are r (3), theta (3), v (6)."""

    start: np.ndarray  # (nb, 12)
    R: np.ndarray  # (nb, 3, 3) at the start
    y: np.ndarray  # (nb, 12)
    k: np.ndarray  # (stages + 1, nb, 12)
    work: np.ndarray  # (nb, 6)


class Control(NamedTuple):
    """``clock`` = (t, next step, last error); ``tally`` = (evaluations, rejected, factorisations)."""

    clock: np.ndarray  # (3,)
    tally: np.ndarray  # (3,)
    rtol: float
    max_step: float
    t_end: float
    order: float


class Record(NamedTuple):
    """Accepted steps."""

    t: np.ndarray  # (n,)
    r: np.ndarray  # (n, nb, 3)
    R: np.ndarray  # (n, nb, 3, 3)
    v: np.ndarray  # (n, nb, 6)
    lam: np.ndarray  # (n, nrows)


def empty_stages(nb: int, stages: int) -> Stages:
    """Arrays of one step."""
    return Stages(
        start=np.zeros((nb, 12)), R=np.zeros((nb, 3, 3)), y=np.zeros((nb, 12)), k=np.zeros((stages + 1, nb, 12)),
        work=np.zeros((nb, 6)),
    )  # fmt: skip


def empty_record(n: int, nb: int, nrows: int) -> Record:
    """Room for ``n`` steps."""
    return Record(
        np.zeros(n), np.zeros((n, nb, 3)), np.zeros((n, nb, 3, 3)), np.zeros((n, nb, 6)), np.zeros((n, nrows))
    )


@njit(**HOT)
def keep(kernel, lam, record, n):
    """Where ``kernel`` stands, its R closed, and the multipliers, as row ``n`` of the record."""
    close_rotations(kernel.R)
    copy(kernel.r, record.r[n])
    copy(kernel.R, record.R[n])
    copy(kernel.v, record.v[n])
    copy(lam, record.lam[n])


@njit(**HOT)
def theta_dot(x, y, z, p, q, r):
    """dexp^-1(theta) Omega of theta = (x, y, z), Omega = (p, q, r); a series where theta^2 < 1e-2."""
    s = x * x + y * y + z * z
    if s < 1e-2:
        c = (1.0 + s / 60.0 * (1.0 + s / 42.0 * (1.0 + s / 40.0))) / 12.0
    else:
        half = 0.5 * math.sqrt(s)
        c = (1.0 - half / math.tan(half)) / s
    u, v, w = y * r - z * q, z * p - x * r, x * q - y * p
    return (
        p + 0.5 * u + c * (y * w - z * v),
        q + 0.5 * v + c * (z * u - x * w),
        r + 0.5 * w + c * (x * v - y * u),
    )


@njit(**HOT)
def _derivative(model, blocks, kernel, stages, t, out):
    """Derivative of ``stages.y`` at ``t`` into ``stages.k[out]``; ``kernel`` is left at that point."""
    kernel.t[0] = t
    for b in range(len(model.mass)):
        for a in range(3):
            kernel.r[b, a] = stages.y[b, a]
        turned_by(stages.R[b], (stages.y[b, 3], stages.y[b, 4], stages.y[b, 5]), kernel.R[b])
        for a in range(6):
            kernel.v[b, a] = stages.y[b, 6 + a]
    accelerate(model, blocks, kernel)
    for b in range(len(model.mass)):
        y = stages.y[b]
        t = theta_dot(y[3], y[4], y[5], y[9], y[10], y[11])
        stages.k[out, b, 3], stages.k[out, b, 4], stages.k[out, b, 5] = t
        for a in range(3):
            stages.k[out, b, a] = stages.y[b, 6 + a]
        for a in range(6):
            stages.k[out, b, 6 + a] = kernel.v_dot[b, a]


@njit(**HOT)
def _combine(stages, weights, n, h):
    """y = start + h sum weights k"""
    for b in range(len(stages.y)):
        for a in range(12):
            x = 0.0
            for i in range(n):
                x += weights[i] * stages.k[i, b, a]
            stages.y[b, a] = stages.start[b, a] + h * x


@njit(**HOT)
def _error(stages, tableau, h, rtol):
    """RMS of the error estimate over ``rtol (1 + |y|)``; angles over ``rtol``."""
    first = second = 0.0
    two = len(tableau.error) == 2
    n = tableau.error.shape[1]
    for b in range(len(stages.y)):
        for a in range(12):
            x = y = 0.0
            for i in range(n):
                x += tableau.error[0, i] * stages.k[i, b, a]
                if two:
                    y += tableau.error[1, i] * stages.k[i, b, a]
            scale = rtol if 3 <= a < 6 else rtol * (1.0 + max(abs(stages.start[b, a]), abs(stages.y[b, a])))
            first += (x / scale) ** 2
            second += (y / scale) ** 2
    size = 12.0 * len(stages.y)
    if not two:
        return h * math.sqrt(first / size)
    if first == 0.0 and second == 0.0:
        return 0.0
    return h * first / math.sqrt((first + 0.01 * second) * size)


@njit(**HOT)
def _begin(model, stages, kernel):
    """The step starts where ``kernel`` stands."""
    for b in range(len(model.mass)):
        for a in range(3):
            stages.start[b, a] = kernel.r[b, a]
            stages.start[b, 3 + a] = 0.0
            for c in range(3):
                stages.R[b, a, c] = kernel.R[b, a, c]
        for a in range(6):
            stages.start[b, 6 + a] = kernel.v[b, a]


@njit(**JIT)
def start(model, blocks, kernel, stages, control):
    """The first derivative at the poses and velocities of ``kernel``, and the multipliers there."""
    _begin(model, stages, kernel)
    copy(stages.start, stages.y)
    _derivative(model, blocks, kernel, stages, kernel.t[0], 0)
    control.tally[0] += 1


@njit(**JIT)
def march(model, blocks, kernel, stages, tableau, control, record):
    """Steps until the record is full or the end is reached; returns (outcome, steps recorded)."""
    n, done = len(tableau.b), 0
    while done < len(record.t):
        t, h, last = control.clock[0], min(control.clock[1], control.max_step), control.clock[2]
        left = control.t_end - t
        if left <= SHORTEST * max(abs(t), 1e-300):
            return FINISHED, done
        if h >= left * (1.0 - 1e-12):
            h = left
        elif 2.0 * h > left:
            h = 0.5 * left  # two even steps instead of one and a sliver
        if h < SHORTEST * max(abs(t), control.t_end * SHORTEST):
            return UNDERFLOW, done
        for i in range(1, n):
            _combine(stages, tableau.a[i], i, h)
            _derivative(model, blocks, kernel, stages, t + h * tableau.c[i], i)
        _combine(stages, tableau.b, n, h)
        _derivative(model, blocks, kernel, stages, t + h, n)
        control.tally[0] += n
        error = _error(stages, tableau, h, control.rtol)
        if not error <= 1.0:  # NaN too
            control.tally[1] += 1
            cut = max(LEAST, SAFETY * error ** (-1.0 / control.order)) if math.isfinite(error) else LEAST
            control.clock[1] = h * min(cut, 0.9)
            if control.clock[1] < SHORTEST * max(t, control.t_end * 1e-6):
                return (UNDERFLOW if math.isfinite(error) else NOT_FINITE), done
            continue
        project(model, blocks, kernel, stages.work)
        keep(kernel, kernel.lam, record, done)
        _begin(model, stages, kernel)
        for b in range(len(model.mass)):
            for a in range(3):
                stages.k[0, b, a] = kernel.v[b, a]
                stages.k[0, b, 3 + a] = kernel.v[b, 3 + a]
            for a in range(6):
                stages.k[0, b, 6 + a] = stages.k[n, b, 6 + a]
        grow = SAFETY * max(error, 1e-10) ** (-0.7 / control.order) * last ** (0.4 / control.order)
        control.clock[0] = control.t_end if h == left else t + h
        control.clock[1] = h * min(MOST, max(LEAST, grow))
        control.clock[2] = max(error, 1e-4)
        record.t[done] = control.clock[0]
        done += 1
    return FULL, done
