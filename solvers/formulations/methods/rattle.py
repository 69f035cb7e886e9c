"""RATTLE on SO(3) with the free body as drift, and symmetric compositions of it (compiled).

One sub-step of h from (q_0, v_0) with the factor of S at q_0 (McLachlan, Modin, Verdier, Wilkins 2014)::

    p_half = M v_0 + h/2 f(q_0) + A_0^T x  translation and body momentum L = J Omega; f without gyroscopic term
    q_1 = free motion over h from (q_0, p_half)   x such that phi(q_1) = 0: S_0 dx = -phi / h, repeated
    v_1 = M^-1 (p_1 + h/2 f(q_1) + A_1^T y)       S_1 y = -A_1 (...): A_1 v_1 = 0

Symplectic and time-reversible. In every step phi is below the tolerance and A v at rounding. Dampers enter f(q_1, v_1)
by a fixed-point iteration. ``s`` is the bundle of a step, ``k`` its kernel, ``c`` its control.
"""

from functools import partial

import numpy as np

from ....harness.mechanics.types import Problem
from ..compiled.algebra import copy, find_largest
from ..compiled.bundles import make_record, make_step
from ..compiled.entries import compile_inline, run
from ..compiled.host import Method, choose_tolerance
from ..compiled.marching import STUCK
from .free_body import find_principal_axes, turn_discretely, turn_freely
from .iteration import MOST_ITERATIONS, classify_by_fall, iterate
from .stiff_springs import make_explainer

# passes over forces at the new velocities: each leaves about h c / (2 m) of the error before it. On a damped linkage at
# dt = 5 ms, half moves the end after 3 s by 5e-8 m, twice by 2e-14 m; at 50 ms by 6e-5 and 2e-9 m.
DAMPER_PASSES = 6
ARRAYS = {
    "r0": "nb 3",
    "R0": "nb 3 3",
    "L": "3",
    "half": "nb 6",  # M^-1 p without the impulse of the constraints
    "impulse": "nr",  # impulse of the first half
    "lam": "nr",  # reaction at the start of the sub-step
}


def make_rattle_method(
    problem: Problem, gamma: np.ndarray, tolerance: float, *, discrete: bool = False, rate: float = 0.0
) -> Method:
    """Make RATTLE, or a composition of it with sub-steps ``gamma`` h, for ``host.integrate``.

    phi is kept below ``tolerance`` [m; axis rows without unit]. Free bodies rotate exactly, or by the ``discrete``
    equations of Moser and Veselov; ``rate`` [rad/s] is that of reversible step control, 0 for fixed steps.
    """
    system, (tolerance, notes) = problem.system, choose_tolerance(tolerance, problem)
    scheme = make_record(h=0.0, tolerance=tolerance, damped=not system.is_conservative, discrete=discrete)
    axes = find_principal_axes(system.regular_inertia)
    of_system = partial(make_step, arrays=ARRAYS, scheme=scheme, axes=axes, gamma=gamma)
    return Method(
        of_system,
        step,
        finish,
        start,
        rate=rate,
        counters=("iterations", "factorisations"),
        notes=notes,
        explain=make_explainer(problem),
    )


def start(s):
    """Store the reaction of index 1 at the start; the rows and the factor of S there serve the first step."""
    run(s.kernel.accelerate)
    s.control.factorisations += 1
    copy(s.kernel.lam, s.lam)


def step(s):
    """Take all sub-steps of ``control.h``; set ``control.status`` to STUCK where one does not converge."""
    c, k = s.control, s.kernel
    k.t[0] = c.t
    for i in range(len(s.gamma)):
        if not _sub_step(s, k, c, s.gamma[i] * c.h):
            c.status = STUCK
            break


def finish(s):
    """Set ``lam`` to the reactions of index 1 at the end, as 2 y / h is one order less accurate."""
    run(s.kernel.reactions)


@compile_inline
def _sub_step(s, k, c, h):
    """Take one sub-step of h [s], and advance the time of ``k``; return whether the iteration on phi converges."""
    copy(k.r, s.r0)
    copy(k.R, s.R0)
    copy(k.v, s.half)
    _kick(s, k, h)
    for a in range(len(s.impulse)):
        s.impulse[a] = 0.5 * h * s.lam[a]
    run(k.keep_rows)
    k.t[0] += h
    s.scheme.h = h
    if not iterate(s, _sweep, classify_by_fall, MOST_ITERATIONS):
        return False
    copy(k.w, k.v)
    run(k.rows)
    run(k.factorise)
    c.factorisations += 1
    for _ in range(DAMPER_PASSES if s.scheme.damped else 1):
        copy(k.w, s.half)
        _kick(s, k, h)
        copy(s.half, k.v)
        run(k.project_rates)
    for a in range(len(k.rhs)):
        s.lam[a] = 2.0 * k.rhs[a] / h
    return True


@compile_inline
def _sweep(s, i, stale):
    """Correct the impulse by the last phi, and move all bodies to the end; return the largest phi there.

    ``i`` counts sweeps: the first one takes the impulse as it is. S is never factorised anew, ``stale`` or not.
    """
    k, h = s.kernel, s.scheme.h
    s.control.iterations += 1
    if i > 0:
        run(k.solve)
        for a in range(len(s.impulse)):
            s.impulse[a] += k.rhs[a]
    copy(s.half, k.w)
    copy(s.impulse, k.x)
    run(k.push_kept)
    _drift(s, k, h)
    run(k.rows)
    for a in range(len(k.phi)):
        k.rhs[a] = -k.phi[a] / h
    return find_largest(k.phi)


@compile_inline
def _kick(s, k, h):
    """Add h/2 M^-1 f to the velocities ``half``, with f the applied forces at the state of the kernel."""
    run(k.applied_forces)
    for b in range(len(s.half)):
        t0, t1, t2 = k.force[b, 3], k.force[b, 4], k.force[b, 5]
        for a in range(3):
            J = k.J_inv[b, a]
            s.half[b, a] += 0.5 * h * (k.force[b, a] / k.mass[b])
            s.half[b, 3 + a] += 0.5 * h * (J[0] * t0 + J[1] * t1 + J[2] * t2)


@compile_inline
def _drift(s, k, h):
    """Move all bodies freely for h [s] from the start of the sub-step, at the velocities ``k.w``.

    Their Omega in ``k.w`` becomes that at the end.
    """
    for b in range(len(k.mass)):
        w0, w1, w2 = k.w[b, 3], k.w[b, 4], k.w[b, 5]
        for a in range(3):
            k.r[b, a] = s.r0[b, a] + h * k.w[b, a]
            s.L[a] = k.J[b, a, 0] * w0 + k.J[b, a, 1] * w1 + k.J[b, a, 2] * w2
            for c in range(3):
                k.R[b, a, c] = s.R0[b, a, c]
        if s.scheme.discrete:
            turn_discretely(k.J[b], h, k.R[b], s.L)
        else:
            turn_freely(s.axes, b, h, k.R, s.L)
        l0, l1, l2 = s.L[0], s.L[1], s.L[2]
        for a in range(3):
            k.w[b, 3 + a] = k.J_inv[b, a, 0] * l0 + k.J_inv[b, a, 1] * l1 + k.J_inv[b, a, 2] * l2
