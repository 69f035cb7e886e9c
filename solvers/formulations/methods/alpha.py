"""Generalised-alpha on the rotation group, index 3 or stabilised, and projections after a step (compiled).

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

from functools import partial

import numpy as np

from ....harness.types import Problem
from ..compiled.algebra import clear, copy, largest
from ..compiled.bundles import make_record, make_step
from ..compiled.entries import inner, run
from ..compiled.host import Method, tolerance_of
from ..compiled.marching import STUCK
from .iteration import FAILED, MOST_ITERATIONS, SLOW, has_settled
from .products import add_scaled, move, set_rates

COUNTERS = ("iterations", "factorisations")
ARRAYS = {
    "r0": "nb 3", "R0": "nb 3 3", "v0": "nb 6", "vdot0": "nb 6",
    "a0": "nb 6",  # the scheme's own acceleration
    "slack": "nb 6",  # M^-1 A^T eta
    "dq": "nb 6", "lam": "nr", "eta": "nr",
}  # fmt: skip


def alpha_steps(
    problem: Problem, tolerance: float, *, beta: float, gamma: float, alpha_m: float = 0.0, alpha_f: float = 0.0,
    shift: float = 0.0, stabilised: bool = False, projected: bool = False,
) -> Method:  # fmt: skip
    """The method; ``tolerance`` of phi and of the last correction of poses [m; without unit], ``shift`` of S."""
    tolerance, notes = tolerance_of(tolerance, problem)
    scheme = make_record(
        alpha_m=alpha_m, alpha_f=alpha_f, beta=beta, gamma=gamma, tolerance=tolerance, shift=shift,
        stabilised=stabilised, projected=projected,
    )  # fmt: skip
    of_system = partial(make_step, arrays=ARRAYS, scheme=scheme)  # ``v_dot`` of the kernel is vdot
    return Method(of_system, step, finish, start, counters=COUNTERS, notes=notes)


def start(s):
    """vdot and a of index 1. lam grows from 0: redundant rows share it where none is dropped."""
    run(s.kernel.accelerate)
    s.control.factorisations += 1
    copy(s.kernel.v_dot, s.a0)
    s.kernel.state.shift = s.scheme.shift


def step(s):
    """One step of ``control.h``."""
    c, k, h = s.control, s.kernel, s.control.h
    k.t[0] = c.t + h
    copy(k.r, s.r0)
    copy(k.R, s.R0)
    copy(k.v, s.v0)
    copy(k.v_dot, s.vdot0)
    clear(s.slack)
    last, state, slow = np.inf, 0, False
    for i in range(MOST_ITERATIONS):
        _predict(s, k, h)
        run(k.rows)
        if i == 0 or slow:
            run(k.factorise)
            c.factorisations += 1
        size = _correct(s, k, h)
        c.iterations += 1
        state = has_settled(size, last, s.scheme.tolerance)
        slow = size > SLOW * last
        last = size
        if state != 0:
            break
    if state == FAILED or not last <= s.scheme.tolerance:
        c.status = STUCK


def finish(s):
    """The scheme's acceleration at the end; velocities and accelerations projected."""
    k = s.kernel
    _predict(s, k, s.control.h)
    for b in range(len(s.a0)):
        for a in range(6):
            s.a0[b, a] = _scheme_acceleration(s, b, a)
    if s.scheme.projected:
        _project(s, k)
    copy(s.lam, k.lam)


@inner
def _scheme_acceleration(s, b, a):
    """a_1 of body ``b``, component ``a``."""
    c = s.scheme
    known = c.alpha_f * s.vdot0[b, a] - c.alpha_m * s.a0[b, a]
    return ((1.0 - c.alpha_f) * s.kernel.v_dot[b, a] + known) / (1.0 - c.alpha_m)


@inner
def _predict(s, k, h):
    """Velocities and poses of ``k`` that belong to vdot."""
    c = s.scheme
    for b in range(len(s.v0)):
        for a in range(6):
            v0, a0, a1 = s.v0[b, a], s.a0[b, a], _scheme_acceleration(s, b, a)
            k.v[b, a] = v0 + h * ((1.0 - c.gamma) * a0 + c.gamma * a1)
            s.dq[b, a] = h * (v0 + h * ((0.5 - c.beta) * a0 + c.beta * a1)) + s.slack[b, a]
    move(s.r0, s.R0, s.dq, k.r, k.R)


@inner
def _correct(s, k, h):
    """Correct vdot, lam and eta with the rows at hand; returns the size of what was off."""
    c = s.scheme
    share = (1.0 - c.alpha_f) / (1.0 - c.alpha_m)
    on_q, on_v = share * c.beta * h * h, share * c.gamma * h
    size = largest(k.phi)
    if c.stabilised:
        copy(k.v, k.w)
        run(k.slips)
        for a in range(len(s.eta)):
            s.eta[a] = -k.x[a]
        size = max(size, on_q / on_v * largest(s.eta))
    run(k.forces)
    copy(k.force, k.w)
    run(k.divide)
    for b in range(len(k.w)):
        add_scaled(-1.0, k.v_dot[b], k.w[b])
    copy(s.lam, k.x)
    run(k.push)
    set_rates(k)
    for a in range(len(k.rhs)):
        k.rhs[a] = (-s.eta[a] / on_v if c.stabilised else -k.phi[a] / on_q) - k.x[a]
        s.eta[a] = -k.phi[a] + on_q / on_v * s.eta[a]
    _push_solution(k)
    add_scaled(1.0, k.x, s.lam)
    for b in range(len(k.w)):
        add_scaled(1.0, k.w[b], k.v_dot[b])
    size = max(size, on_q * largest(k.w))
    if c.stabilised:
        copy(s.eta, k.rhs)
        copy(s.slack, k.w)
        _push_solution(k)
        copy(k.w, s.slack)
    return size


@inner
def _push_solution(k):
    """w += M^-1 A^T x, x = S^-1 rhs"""
    run(k.solve)
    copy(k.rhs, k.x)
    run(k.push)


@inner
def _project(s, k):
    """v onto A v + phi_t = 0, then vdot onto A vdot = -gamma, along M^-1 A^T; twice each, for S is that of an estimate.

    What the second adds to M vdot is a reaction, too, and of the order of h: ``lam`` takes it up.
    """
    run(k.rows)
    run(k.project_rates)
    run(k.project_rates)
    run(k.rows)  # gamma of the projected velocities
    copy(k.v_dot, k.w)
    for _ in range(2):
        set_rates(k)
        for a in range(len(k.rhs)):
            k.rhs[a] = -k.gamma[a] - k.x[a]
        _push_solution(k)
        add_scaled(1.0, k.x, s.lam)
    copy(k.w, k.v_dot)
    copy(k.w, s.a0)
