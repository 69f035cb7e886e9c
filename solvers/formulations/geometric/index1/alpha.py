"""Generalised-alpha on the rotation group, index 3 or stabilised, and what is done after a step (compiled).

Bruls, Cardona, Arnold 2012, Mech. Mach. Theory 48; stabilised: Arnold, Bruls, Cardona 2015, Numer. Math. 129::

    (1 - alpha_m) a_1 + alpha_m a_0 = (1 - alpha_f) vdot_1 + alpha_f vdot_0
    v_1 = v_0 + (1 - gamma) h a_0 + gamma h a_1
    dq  = h v_0 + (1/2 - beta) h^2 a_0 + beta h^2 a_1 [+ M^-1 A^T eta],   r_1 = r_0 + dq_t,   R_1 = R_0 exp(dq_theta)
    M vdot_1 = f(q_1, v_1) + A_1^T lam,   phi(q_1) = 0   [and A_1 v_1 = 0 with eta]

Simplified Newton with S at the first estimate of q_1, d = M^-1 (f + A^T lam) - vdot_1, beta' = beta (1 - alpha_f) /
(1 - alpha_m), gamma' likewise, vdot_1 += d + M^-1 A^T dlam::

    index 3      S dlam = -A d - phi / (beta' h^2)
    stabilised   S dlam = -A d - A v_1 / (gamma' h),   S deta = -phi + (beta' h / gamma') A v_1

The matrix of the iteration is M alone: springs with h^2 k/m of order one and more are out of its reach.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from ..arrays import Model
from ..vectors import JIT, copy
from .fixed_step import FAILED, MOST_ITERATIONS, SETTLED, STUCK, keep_step, largest, move, settled, times_of
from .kernel import (
    HOT,
    Kernel,
    add_gyroscopic,
    add_rows_back,
    applied,
    clear,
    factorise,
    rows,
    solve,
    times_inverse_mass,
    times_rows,
)
from .rkmk import FINISHED, FULL, NOT_FINITE


class Scheme(NamedTuple):
    """Parameters; ``shift``: relative, added to the diagonal of S; ``projected``: v and vdot after every step."""

    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float
    tolerance: float  # of phi and of the last correction of poses [m; rows of axes and angles without unit]
    stabilised: int = 0
    shift: float = 0.0
    projected: int = 0


class Step(NamedTuple):
    """Room for one step."""

    r0: np.ndarray  # (nb, 3)
    R0: np.ndarray  # (nb, 3, 3)
    v0: np.ndarray  # (nb, 6)
    a0: np.ndarray  # (nb, 6) the scheme's own acceleration
    vdot0: np.ndarray  # (nb, 6)
    vdot: np.ndarray  # (nb, 6)
    slack: np.ndarray  # (nb, 6) M^-1 A^T eta
    d: np.ndarray  # (nb, 6)
    dq: np.ndarray  # (nb, 6)
    lam: np.ndarray  # (nrows,)
    eta: np.ndarray  # (nrows,)
    clock: np.ndarray  # (3,)


def empty_step(model: Model) -> Step:
    """Arrays of one step."""
    nb, nrows = len(model.mass), int(model.row[-1])
    return Step(
        r0=np.zeros((nb, 3)), R0=np.zeros((nb, 3, 3)), v0=np.zeros((nb, 6)), a0=np.zeros((nb, 6)),
        vdot0=np.zeros((nb, 6)), vdot=np.zeros((nb, 6)), slack=np.zeros((nb, 6)), d=np.zeros((nb, 6)),
        dq=np.zeros((nb, 6)), lam=np.zeros(nrows), eta=np.zeros(nrows), clock=np.zeros(3, dtype=np.int64),
    )  # fmt: skip


def start(k: Kernel, step: Step) -> None:
    """vdot and a of the start: those of index 1. lam grows from 0: redundant rows share it where none is dropped."""
    step.a0[:], step.vdot[:] = k.v_dot, k.v_dot


@njit(**HOT)
def _scheme_acceleration(step, s, b, a):
    """a_1 of body ``b``, component ``a``."""
    known = s.alpha_f * step.vdot0[b, a] - s.alpha_m * step.a0[b, a]
    return ((1.0 - s.alpha_f) * step.vdot[b, a] + known) / (1.0 - s.alpha_m)


@njit(**HOT)
def _predict(step, s, h, k):
    """Velocities and poses of ``k`` that belong to ``step.vdot``."""
    for b in range(len(step.v0)):
        for a in range(6):
            a0 = step.a0[b, a]
            a1 = _scheme_acceleration(step, s, b, a)
            v0 = step.v0[b, a]
            k.v[b, a] = v0 + h * ((1.0 - s.gamma) * a0 + s.gamma * a1)
            step.dq[b, a] = h * (v0 + h * ((0.5 - s.beta) * a0 + s.beta * a1)) + step.slack[b, a]
    move(step.r0, step.R0, step.dq, k)


@njit(**HOT)
def _step(model, blocks, k, step, s, t1, h):
    """One step from where ``k`` stands to ``t1``; returns whether the iteration settled."""
    k.t[0] = t1
    copy(k.r, step.r0)
    copy(k.R, step.R0)
    copy(k.v, step.v0)
    copy(step.vdot, step.vdot0)
    clear(step.slack)
    share = (1.0 - s.alpha_f) / (1.0 - s.alpha_m)
    on_q, on_v = share * s.beta * h * h, share * s.gamma * h
    last = np.inf
    for i in range(MOST_ITERATIONS):
        _predict(step, s, h, k)
        rows(model, k)
        if i == 0:
            factorise(model, blocks, k, s.shift)
            step.clock[2] += 1
        applied(model, k)
        add_gyroscopic(model, k)
        times_inverse_mass(model, k.force)
        for b in range(len(step.d)):
            for a in range(6):
                step.d[b, a] = k.force[b, a] - step.vdot[b, a]
        add_rows_back(model, k, step.lam, step.d)
        size = largest(k.phi)
        clear(step.eta)
        if s.stabilised:
            copy(k.slip, step.eta)
            times_rows(model, k, k.v, 1.0, step.eta)
            size = max(size, on_q / on_v * largest(step.eta))
        for a in range(len(k.rhs)):
            k.rhs[a] = -step.eta[a] / on_v if s.stabilised else -k.phi[a] / on_q
            step.eta[a] = -k.phi[a] + on_q / on_v * step.eta[a]
        times_rows(model, k, step.d, -1.0, k.rhs)
        solve(blocks, k, k.rhs)
        add_rows_back(model, k, k.rhs, step.d)
        for a in range(len(k.rhs)):
            step.lam[a] += k.rhs[a]
        for b in range(len(step.d)):
            for a in range(6):
                step.vdot[b, a] += step.d[b, a]
        if s.stabilised:
            solve(blocks, k, step.eta)
            add_rows_back(model, k, step.eta, step.slack)
        step.clock[1] += 1
        size = max(size, on_q * largest(step.d))
        state = settled(size, last, s.tolerance)
        if state == FAILED:
            return False
        last = size
        if state == SETTLED:
            break
    if last > s.tolerance:
        return False
    _predict(step, s, h, k)
    for b in range(len(step.d)):
        for a in range(6):
            step.a0[b, a] = _scheme_acceleration(step, s, b, a)
    if s.projected:
        _project(model, blocks, k, step)
    return True


@njit(**HOT)
def _project(model, blocks, k, step):
    """v onto A v + phi_t = 0, then vdot onto A vdot = -gamma, along M^-1 A^T; twice each, for S is that of an estimate.

    What the second adds to M vdot is a reaction, too, and of the order of h: ``lam`` takes it up.
    """
    rows(model, k)
    for turn in range(4):
        w = k.v if turn < 2 else step.vdot
        if turn == 2:
            rows(model, k)  # gamma of the projected velocities
        for a in range(len(k.rhs)):
            k.rhs[a] = -k.slip[a] if turn < 2 else -k.gamma[a]
        times_rows(model, k, w, -1.0, k.rhs)
        solve(blocks, k, k.rhs)
        add_rows_back(model, k, k.rhs, w)
        for a in range(len(k.rhs) if turn >= 2 else 0):
            step.lam[a] += k.rhs[a]
    copy(step.vdot, step.a0)


@njit(**JIT)
def march(model, blocks, k, step, s, dt, t_end, record):
    """Steps of ``dt``; returns (outcome, steps recorded)."""
    done = 0
    while done < len(record.t):
        t0, t1 = times_of(step.clock, dt, t_end)
        if not t1 > t0:
            return FINISHED, done
        if not _step(model, blocks, k, step, s, t1, t1 - t0):
            return STUCK, done
        if not keep_step(k, step.lam, step.clock, t1, record, done):
            return NOT_FINITE, done
        done += 1
    return FULL, done
