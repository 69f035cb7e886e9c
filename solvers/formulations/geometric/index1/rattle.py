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

from ..arrays import Model
from ..vectors import JIT, copy
from .blocks import WIDTH
from .fixed_step import FAILED, MOST_ITERATIONS, SETTLED, STUCK, keep_step, largest, paced, settled
from .free_body import Principal, turn_discretely, turn_freely
from .kernel import (
    HOT,
    Kernel,
    add_back,
    add_rows_back,
    applied,
    factorise,
    minus_rates,
    reactions,
    rows,
    solve,
    times_inverse_mass,
)
from .rkmk import FINISHED, FULL, NOT_FINITE

DAMPER_PASSES = 6


class Scheme(NamedTuple):
    """Principal axes, sub-steps ``gamma dt``, the tolerance of phi [m; axis rows without unit], whether dampers act."""

    axes: Principal
    gamma: np.ndarray
    tolerance: float
    damped: int
    discrete: int = 0  # free bodies by the discrete equations of Moser and Veselov, not exactly
    rate: float = 0.0  # [rad/s] of reversible step control; 0: steps of dt


class Step(NamedTuple):
    """Room for one step."""

    r0: np.ndarray  # (nb, 3)
    R0: np.ndarray  # (nb, 3, 3)
    half: np.ndarray  # (nb, 6) M^-1 p without the impulse of the constraints
    v: np.ndarray  # (nb, 6)
    L: np.ndarray  # (3,)
    x: np.ndarray  # (nrows,) impulse of the first half
    lam: np.ndarray  # (nrows,) reaction at the start of the sub-step
    Y0: np.ndarray  # Y of the rows at the start
    way0: np.ndarray  # and f
    clock: np.ndarray  # (3,)
    pace: np.ndarray  # (3,)


def empty_step(model: Model) -> Step:
    """Arrays of one sub-step."""
    nb, nj, nrows = len(model.mass), len(model.body), int(model.row[-1])
    return Step(
        r0=np.zeros((nb, 3)), R0=np.zeros((nb, 3, 3)), half=np.zeros((nb, 6)), v=np.zeros((nb, 6)), L=np.zeros(3),
        x=np.zeros(nrows), lam=np.zeros(nrows), Y0=np.zeros((nj, 2, WIDTH, 3)), way0=np.zeros((nj, WIDTH, 3)),
        clock=np.zeros(3, dtype=np.int64), pace=np.zeros(3),
    )  # fmt: skip


@njit(**HOT)
def _drift(model, s, k, step, h):
    """Poses of ``k`` from the start of the sub-step at ``step.v``, whose Omega becomes that at its end."""
    J = model.J
    for b in range(len(model.mass)):
        w0, w1, w2 = step.v[b, 3], step.v[b, 4], step.v[b, 5]
        for a in range(3):
            k.r[b, a] = step.r0[b, a] + h * step.v[b, a]
            step.L[a] = J[b, a, 0] * w0 + J[b, a, 1] * w1 + J[b, a, 2] * w2
            for c in range(3):
                k.R[b, a, c] = step.R0[b, a, c]
        if s.discrete:
            turn_discretely(J[b], h, k.R[b], step.L)
        else:
            turn_freely(s.axes, b, h, k.R, step.L)
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


def start(k: Kernel, step: Step) -> None:
    """The reaction of index 1; its rows and factor are those of the first step."""
    step.lam[:] = k.lam


@njit(**HOT)
def _sub_step(model, blocks, k, step, s, h):
    """One sub-step, which moves the time of ``k``; returns whether phi came down to the tolerance."""
    copy(k.r, step.r0)
    copy(k.R, step.R0)
    copy(k.v, step.half)
    _kick(model, k, step, h, step.half)
    for a in range(len(step.x)):
        step.x[a] = 0.5 * h * step.lam[a]
    copy(k.Y, step.Y0)
    copy(k.way, step.way0)
    k.t[0] += h
    last = np.inf
    for _ in range(MOST_ITERATIONS):
        copy(step.half, step.v)
        add_back(model, step.way0, step.Y0, step.x, step.v)
        _drift(model, s, k, step, h)
        rows(model, k)
        for a in range(len(k.phi)):
            k.rhs[a] = -k.phi[a] / h
        step.clock[1] += 1
        size = largest(k.phi)
        state = settled(size, last, s.tolerance)
        if state == FAILED:
            return False
        last = size
        if state == SETTLED:
            break
        solve(blocks, k, k.rhs)
        for a in range(len(step.x)):
            step.x[a] += k.rhs[a]
    if last > s.tolerance:
        return False
    copy(step.v, k.v)
    rows(model, k)
    factorise(model, blocks, k)
    step.clock[2] += 1
    for _ in range(DAMPER_PASSES if s.damped else 1):
        copy(step.v, step.half)
        _kick(model, k, step, h, step.half)
        minus_rates(model, k, step.half, k.rhs)
        solve(blocks, k, k.rhs)
        add_rows_back(model, k, k.rhs, step.half)
        copy(step.half, k.v)
    for a in range(len(k.rhs)):
        step.lam[a] = 2.0 * k.rhs[a] / h
    return True


@njit(**JIT)
def march(model, blocks, k, step, s, dt, t_end, record):
    """Steps of ``dt``, each the sub-steps ``gamma dt``; returns (outcome, steps recorded)."""
    done = 0
    while done < len(record.t):
        t0, t1 = paced(step.pace, k, s.rate, step.clock, dt, t_end)
        if not t1 > t0:
            return FINISHED, done
        k.t[0] = t0
        for i in range(len(s.gamma)):
            if not _sub_step(model, blocks, k, step, s, s.gamma[i] * (t1 - t0)):
                return STUCK, done
        reactions(model, blocks, k)  # 2 y / h is one order less exact
        if not keep_step(k, k.lam, step.clock, t1, record, done):
            return NOT_FINITE, done
        done += 1
    return FULL, done
