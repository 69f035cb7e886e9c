"""Radau IIA with three stages on stabilised index 2, error-controlled, in rotation vectors of the step (compiled).

Hairer and Wanner 1996, Solving Ordinary Differential Equations II, IV.8 and VII.4; stabilised: Gear, Gupta, Leimkuhler
1985, J. Comput. Appl. Math. 12. Stages i, with R_i = R_0 exp(theta_i) and the slack z_i = M^-1 A_i^T eta_i::

    v_i = v_0 + h sum a_ij vdot_j,   M vdot_i = f_i + A_i^T lam_i,   phi(q_i) = 0,   A_i v_i = 0
    r_i = r_0 + h sum a_ij (v_j + z_j),   theta_i = h sum a_ij dexp^-1(theta_j) (Omega_j + z_j)

Simplified Newton with one S, that of the second stage's first estimate; d_i = M^-1 (f_i + A_i^T lam_i) - vdot_i::

    S dlam_i = -A_i d_i - sum_j (a^-1)_ij (A v)_j / h,   S deta_i = (A v)_i - sum_j (a^-1)_ij phi_j / h

so that stages decouple without complex systems. Spring-dampers are soft rows of the same step (module ``soft_rows``),
so that their stiffness does not limit it. The last stage is the end of the step.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from ..arrays import Model
from ..vectors import JIT, copy
from .fixed_step import largest, move
from .kernel import (
    HOT,
    Kernel,
    add_gyroscopic,
    add_rows_back,
    applied,
    clear,
    empty_kernel,
    factorise,
    rows,
    solve,
    times_inverse_mass,
    times_rows,
)
from .rkmk import FINISHED, FULL, LEAST, MOST, NOT_FINITE, SAFETY, SHORTEST, UNDERFLOW, keep, theta_dot
from .soft_rows import add_pull, correct, pull, respond, stretch

_S = math.sqrt(6.0)
C = np.array([(4.0 - _S) / 10.0, (4.0 + _S) / 10.0, 1.0])
A = np.array([
    [(88.0 - 7.0 * _S) / 360.0, (296.0 - 169.0 * _S) / 1800.0, (-2.0 + 3.0 * _S) / 225.0],
    [(296.0 + 169.0 * _S) / 1800.0, (88.0 + 7.0 * _S) / 360.0, (-2.0 - 3.0 * _S) / 225.0],
    [(16.0 - _S) / 36.0, (16.0 + _S) / 36.0, 1.0 / 9.0],
])  # fmt: skip
ERROR = np.array([-13.0 - 7.0 * _S, -13.0 + 7.0 * _S, -1.0]) / 3.0
GAMMA = 1.0 / (3.0 + 3.0 ** (2.0 / 3.0) - 3.0 ** (1.0 / 3.0))  # the real eigenvalue of A
MOST_ITERATIONS = 25


class Scheme(NamedTuple):
    """Coefficients; ``tolerance`` of the iteration [m; axis rows and angles without unit]."""

    c: np.ndarray
    a: np.ndarray
    square: np.ndarray  # a a
    inverse: np.ndarray
    error: np.ndarray
    gamma: float
    tolerance: float


class Step(NamedTuple):
    """Room for one step: columns of ``rate``, ``y`` are r (3), theta (3), v (6)."""

    r0: np.ndarray  # (nb, 3)
    R0: np.ndarray  # (nb, 3, 3)
    v0: np.ndarray  # (nb, 6)
    vdot0: np.ndarray  # (nb, 6)
    y: np.ndarray  # (3, nb, 6) r_i - r_0 and theta_i
    rate: np.ndarray  # (3, nb, 6)
    eta: np.ndarray  # (3, nrows)
    off: np.ndarray  # (3, nrows) A v + phi_t
    x: np.ndarray  # (2, nrows)
    d: np.ndarray  # (nb, 6)
    old_vdot: np.ndarray  # (3, nb, 6) of the last accepted step
    old_lam: np.ndarray  # (3, nrows)
    before: np.ndarray  # (1,) [s] its length, 0: there is none


def scheme(rtol: float) -> Scheme:
    """The coefficients; the iteration ends at 1e-10, or a thousandth of ``rtol`` if that is less: constraints hold."""
    return Scheme(C, A, A @ A, np.linalg.inv(A).copy(), ERROR, GAMMA, max(1e-13, min(1e-10, 1e-3 * rtol)))


def empty_step(model: Model) -> Step:
    """Arrays of one step."""
    nb, n = len(model.mass), int(model.row[-1])
    return Step(
        r0=np.zeros((nb, 3)), R0=np.zeros((nb, 3, 3)), v0=np.zeros((nb, 6)), vdot0=np.zeros((nb, 6)),
        y=np.zeros((3, nb, 6)), rate=np.zeros((3, nb, 6)), eta=np.zeros((3, n)), off=np.zeros((3, n)),
        x=np.zeros((2, n)), d=np.zeros((nb, 6)), old_vdot=np.zeros((3, nb, 6)), old_lam=np.zeros((3, n)),
        before=np.zeros(1),
    )  # fmt: skip


def stages_of(model: Model, kernel: Kernel) -> tuple[Kernel, Kernel, Kernel]:
    """A kernel for each stage, the last one ``kernel`` itself, with one factor."""
    shared = {"L": kernel.L, "diagonal": kernel.diagonal, "line": kernel.line, "rhs": kernel.rhs}
    first, second = (empty_kernel(model)[0]._replace(**shared) for _ in range(2))
    return first, second, kernel


def start(k: Kernel, step: Step) -> None:
    """vdot and lam of the start: those of index 1."""
    step.vdot0[:], step.old_vdot[:], step.old_lam[:] = k.v_dot, k.v_dot, k.lam


@njit(**HOT)
def _guess(stages, soft, step, s, h):
    """vdot, lam and p of the stages on the parabola through those of the last step; eta = 0, theta = c h Omega_0."""
    last = step.before[0]
    for i in range(3):
        k = stages[i]
        x = 1.0 + s.c[i] * h / last if last > 0.0 else s.c[i]
        clear(k.v_dot)
        clear(k.lam)
        clear(soft.stages[i].lam)
        clear(step.eta[i])
        for j in range(3):
            m, n = (j + 1) % 3, (j + 2) % 3
            w = (x - s.c[m]) * (x - s.c[n]) / ((s.c[j] - s.c[m]) * (s.c[j] - s.c[n]))
            for b in range(len(step.v0)):
                for a in range(6):
                    k.v_dot[b, a] += w * step.old_vdot[j, b, a]
            for a in range(len(k.lam)):
                k.lam[a] += w * step.old_lam[j, a]
            for a in range(len(soft.change)):
                soft.stages[i].lam[a] += w * soft.old[j, a]
        for b in range(len(step.v0)):
            for a in range(6):
                step.y[i, b, a] = s.c[i] * h * step.v0[b, a]


@njit(**HOT)
def _poses(model, stages, step, s, h, sloped):
    """Velocities and poses of the stages; ``sloped``: the rows of the last iterate stand for those of z."""
    for i in range(3):
        k = stages[i]
        clear(step.d)
        if sloped:
            add_rows_back(model, k, step.eta[i], step.d)
        for b in range(len(step.v0)):
            for a in range(6):
                x = step.v0[b, a]
                for j in range(3):
                    x += h * s.a[i, j] * stages[j].v_dot[b, a]
                k.v[b, a] = x
            y, d = step.y[i, b], step.d[b]
            t = theta_dot(y[3], y[4], y[5], k.v[b, 3] + d[3], k.v[b, 4] + d[4], k.v[b, 5] + d[5])
            for a in range(3):
                step.rate[i, b, a] = k.v[b, a] + d[a]
                step.rate[i, b, 3 + a] = t[a]
    for i in range(3):
        for b in range(len(step.v0)):
            for a in range(6):
                x = 0.0
                for j in range(3):
                    x += h * s.a[i, j] * step.rate[j, b, a]
                step.y[i, b, a] = x
        move(step.r0, step.R0, step.y[i], stages[i])


@njit(**HOT)
def _iterate(model, blocks, stages, soft, step, s, h, first):
    """One correction of vdot, lam, eta and p; returns the size of what was off."""
    _poses(model, stages, step, s, h, not first)
    size = 0.0
    for i in range(3):
        k = stages[i]
        rows(model, k)
        pull(soft.model, soft.stages[i])
        copy(k.slip, step.off[i])
        times_rows(model, k, k.v, 1.0, step.off[i])
        size = max(size, largest(k.phi), h * largest(step.off[i]))
    if first:
        factorise(model, blocks, stages[1])
        respond(model, blocks, stages[1], soft, 1, s.a, s.square, h, step.d)
    for i in range(3):
        k = stages[i]
        applied(model, k)
        add_gyroscopic(model, k)
        times_inverse_mass(model, k.force)
        for b in range(len(step.v0)):
            for a in range(6):
                step.d[b, a] = k.force[b, a] - k.v_dot[b, a]
        add_rows_back(model, k, k.lam, step.d)
        add_pull(soft.model, soft.stages[i], step.d)
        for a in range(len(k.lam)):
            by_v = by_q = 0.0
            for j in range(3):
                by_v += s.inverse[i, j] * step.off[j, a]
                by_q += s.inverse[i, j] * stages[j].phi[a]
            step.x[0, a] = -by_v / h
            step.x[1, a] = step.off[i, a] - by_q / h
        times_rows(model, k, step.d, -1.0, step.x[0])
        solve(blocks, k, step.x[0])
        solve(blocks, k, step.x[1])
        add_rows_back(model, k, step.x[0], step.d)
        for a in range(len(k.lam)):
            k.lam[a] += step.x[0, a]
            step.eta[i, a] += step.x[1, a]
        for b in range(len(step.v0)):
            for a in range(6):
                k.v_dot[b, a] += step.d[b, a]
        stretch(soft.model, soft.stages[i], step.d, soft.d[i])
        size = max(size, h * h * largest(step.d))
    return max(size, h * h * correct(model, stages, soft, s.a, s.square, h, step.d))


@njit(**HOT)
def _error(step, stages, s, h, rtol):
    """RMS of gamma (h y'_0 + e . (y_i - y_0)) over ``rtol (1 + |y|)``; angles over ``rtol``."""
    total = 0.0
    for b in range(len(step.v0)):
        for a in range(12):
            if a < 6:
                x = h * step.v0[b, a]
                for i in range(3):
                    x += s.error[i] * step.y[i, b, a]
                size = max(abs(step.r0[b, a]), abs(step.r0[b, a] + step.y[2, b, a])) if a < 3 else 0.0
            else:
                x = h * step.vdot0[b, a - 6]
                for i in range(3):
                    x += s.error[i] * (stages[i].v[b, a - 6] - step.v0[b, a - 6])
                size = max(abs(step.v0[b, a - 6]), abs(stages[2].v[b, a - 6]))
            total += (s.gamma * x / (rtol * (1.0 + size))) ** 2
    return math.sqrt(total / (12.0 * len(step.v0)))


@njit(**HOT)
def _step(model, blocks, stages, soft, step, s, control, h):
    """One step; returns its error, infinity where the iteration does not converge."""
    for i in range(3):
        stages[i].t[0] = control.clock[0] + s.c[i] * h
    if step.before[0] == 0.0:
        pull(soft.model, soft.stages[2])
        for i in range(3):
            for a in range(len(soft.change)):
                soft.old[i, a] = -soft.stages[2].phi[a]
    _guess(stages, soft, step, s, h)
    last = np.inf
    for i in range(MOST_ITERATIONS):
        size = _iterate(model, blocks, stages, soft, step, s, h, i == 0)
        control.tally[0] += 1
        control.tally[2] += i == 0
        if not np.isfinite(size) or (i > 1 and size > 2.0 * last):
            return np.inf
        last = size
        if size <= s.tolerance:
            break
    if last > s.tolerance:
        return np.inf
    _poses(model, stages, step, s, h, True)
    return _error(step, stages, s, h, control.rtol)


@njit(**JIT)
def march(model, blocks, stages, soft, step, s, control, record):
    """Steps until the record is full or the end is reached; returns (outcome, steps recorded)."""
    k, done = stages[2], 0
    while done < len(record.t):
        t, h, last = control.clock[0], min(control.clock[1], control.max_step), control.clock[2]
        left = control.t_end - t
        if left <= SHORTEST * max(abs(t), 1e-300):
            return FINISHED, done
        if h >= left * (1.0 - 1e-12):
            h = left
        elif 2.0 * h > left:
            h = 0.5 * left
        if h < SHORTEST * max(abs(t), control.t_end * SHORTEST):
            return UNDERFLOW, done
        copy(k.r, step.r0)
        copy(k.R, step.R0)
        copy(k.v, step.v0)
        error = _step(model, blocks, stages, soft, step, s, control, h)
        if not error <= 1.0:
            control.tally[1] += 1
            copy(step.r0, k.r)
            copy(step.R0, k.R)
            copy(step.v0, k.v)
            cut = max(LEAST, SAFETY * error ** (-1.0 / control.order)) if math.isfinite(error) else 0.5
            control.clock[1] = h * min(cut, 0.9)
            if control.clock[1] < SHORTEST * max(t, control.t_end * 1e-6):
                return UNDERFLOW, done
            continue
        if not np.isfinite(largest(k.v)):
            return NOT_FINITE, done
        copy(k.v_dot, step.vdot0)
        for i in range(3):
            copy(stages[i].v_dot, step.old_vdot[i])
            copy(stages[i].lam, step.old_lam[i])
            copy(soft.stages[i].lam, soft.old[i])
        step.before[0] = h
        grow = SAFETY * max(error, 1e-10) ** (-0.7 / control.order) * last ** (0.4 / control.order)
        control.clock[0] = control.t_end if h == left else t + h
        control.clock[1] = h * min(MOST, max(LEAST, grow))
        control.clock[2] = max(error, 1e-4)
        record.t[done] = control.clock[0]
        keep(k, k.lam, record, done)
        done += 1
    return FULL, done
