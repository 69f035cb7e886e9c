"""Half-explicit Runge-Kutta steps of order 4 on index 2, each step's end projected onto phi = 0 (compiled).

Brasey and Hairer 1993, SIAM J. Numer. Anal. 30, five stages (HEM4); with R = R_0 exp(theta) as in ``rkmk``::

    Q_i = q_0 + h sum_{j<i} a_ij q'_j,   V_i = v_0 + h sum_{j<i} a_ij V'_j,   M V'_i = f(Q_i, V_i) + A(Q_i)^T lam_i
    lam_i such that A(Q_{i+1}) V_{i+1} = 0, the sixth being the end of the step

Q_{i+1} does not depend on lam_i, so each lam_i is found from linear equations, A(Q_{i+1}) M^-1 A(Q_i)^T dlam = the
residual of A V: by generalised conjugate residuals (Eisenstat, Elman, Schultz 1983, SIAM J. Numer. Anal. 20) with the S
of the step's start as preconditioner. Repetition with S alone does not converge where light bodies turn, nor where S is
nearly singular. lam at the ends of steps, which are recorded, are those of index 1. ``s`` is the bundle of a step,
``k`` its kernel, ``c`` its control.
"""

import math
from functools import partial
from typing import Any

import numpy as np

from ..compiled.algebra import clear, copy, find_largest, theta_dot
from ..compiled.bundles import make_record, make_step
from ..compiled.entries import compile_inline, run
from ..compiled.host import Method
from ..compiled.kernel import Kernel
from ..compiled.marching import NOT_FINITE, STUCK, TURNED
from .iteration import FAILED, GO_ON, MOST_ITERATIONS, SETTLED, iterate
from .products import add_scaled, displace_poses, set_rates

STAGES = 5
# directions kept at most, and numbers in all of them; half and twice of the first change no bit of a chain of 48 rows,
# of two four-bar cells and of Bricard's linkage, which have fewer
DIRECTIONS, NUMBERS = 200, 4_000_000
_S = math.sqrt(6.0)
A = np.array([
    [0.0, 0.0, 0.0, 0.0, 0.0],
    [0.3, 0.0, 0.0, 0.0, 0.0],
    [(1.0 + _S) / 30.0, (11.0 - 4.0 * _S) / 30.0, 0.0, 0.0, 0.0],
    [(-79.0 - 31.0 * _S) / 150.0, (-1.0 - 4.0 * _S) / 30.0, (24.0 + 11.0 * _S) / 25.0, 0.0, 0.0],
    [(14.0 + 5.0 * _S) / 6.0, (-8.0 + 7.0 * _S) / 6.0, (-9.0 - 7.0 * _S) / 4.0, (9.0 - _S) / 4.0, 0.0],
    [0.0, 0.0, (16.0 - _S) / 36.0, (16.0 + _S) / 36.0, 1.0 / 9.0],
])  # fmt: skip
COUNTERS = ("iterations", "factorisations")
ARRAYS = {
    "r0": "nb 3",
    "R0": "nb 3 3",
    "v0": "nb 6",
    "q": "nb 6",  # r (3), theta (3) from the start of the step
    "moves": f"{STAGES} nb 6",
    "gains": f"{STAGES} nb 6",  # q', V'
    "left": "nr",  # residual of the equations of the multipliers
}


def make_half_explicit_method(tolerance: float) -> Method:
    """Make the half-explicit method, for ``host.integrate``.

    ``tolerance`` is that of the last correction of velocities [m/s, rad/s].
    """
    return Method(partial(prepare, tolerance=tolerance), step, finish, start, counters=COUNTERS)


def prepare(kernel: Kernel, control: np.ndarray, *, tolerance: float) -> Any:
    """Make the bundle of a step, with arrays for directions of multipliers and their effect on the residual."""
    nr = len(kernel.lam)
    depth = max(1, min(DIRECTIONS, nr, NUMBERS // max(nr, 1)))
    tried = {"tried": f"{depth} nr", "reached": f"{depth} nr"}
    # stage whose multipliers are sought, and h a_(i+1)i, by which they change the velocities of the next one
    scheme = make_record(tolerance=tolerance, stage=0, weight=0.0)
    # the last stage is the end
    return make_step(kernel, control, arrays=ARRAYS | tried, scheme=scheme, a=A, c=A.sum(axis=1))


def start(s):
    """Compute constraint rows, factor of S and multipliers of index 1 at the start."""
    run(s.kernel.accelerate)
    s.control.factorisations += 1


def step(s):
    """Compute all stages of a step of ``control.h``, with the factor of its start; the sixth is its end.

    Where a stage fails, ``control.status`` is set to NOT_FINITE, TURNED or STUCK.
    """
    c, k = s.control, s.kernel
    copy(k.r, s.r0)
    copy(k.R, s.R0)
    copy(k.v, s.v0)
    clear(s.q)
    k.t[0] = c.t
    run(k.rows)
    for i in range(STAGES):
        _compute_slope(s, k, i)
        c.status = _next_stage(s, k, c, i)
        if c.status != 0:
            break


def finish(s):
    """Compute multipliers of index 1 at the end of the step, and project it onto the constraints by the same factor."""
    run(s.kernel.accelerate)
    run(s.kernel.project)
    s.control.factorisations += 1


@compile_inline
def _compute_slope(s, k, i):
    """Compute q' and V' of stage i with the multipliers ``k.lam`` found last, and copy the rows of the stage."""
    run(k.forces)
    copy(k.force, k.w)
    run(k.divide)
    copy(k.lam, k.x)
    run(k.push)
    copy(k.w, s.gains[i])
    run(k.keep_rows)
    for b in range(len(k.v)):
        q, v, out = s.q[b], k.v[b], s.moves[i, b]
        out[0], out[1], out[2] = v[0], v[1], v[2]
        out[3], out[4], out[5] = theta_dot(q[3], q[4], q[5], v[3], v[4], v[5])


@compile_inline
def _next_stage(s, k, c, i):
    """Compute poses and velocities of stage i + 1, and the multipliers of stage i.

    Return the status of the step: 0, NOT_FINITE, TURNED where a body turns by more than half a turn, or STUCK.
    """
    for b in range(len(k.v)):
        for a in range(6):
            x = y = 0.0
            for j in range(i + 1):
                x += s.a[i + 1, j] * s.moves[j, b, a]
                y += s.a[i + 1, j] * s.gains[j, b, a]
            s.q[b, a], k.v[b, a] = c.h * x, s.v0[b, a] + c.h * y
        turn = s.q[b, 3] ** 2 + s.q[b, 4] ** 2 + s.q[b, 5] ** 2
        if not math.isfinite(turn):
            return NOT_FINITE
        if turn > math.pi**2:
            return TURNED
    displace_poses(s.r0, s.R0, s.q, k.r, k.R)
    k.t[0] = c.t + c.h * s.c[i + 1]
    run(k.rows)
    s.scheme.stage, s.scheme.weight = i, c.h * s.a[i + 1, i]
    return _find_multipliers(s, k)


@compile_inline
def _find_multipliers(s, k):
    """Correct lam of the stage until A V + phi_t = 0 at the poses of ``k``; return 0, or STUCK if that fails."""
    copy(k.v, k.w)
    run(k.slips)
    _solve(k, s.left)
    return 0 if iterate(s, _sweep, _classify, len(s.tried) + MOST_ITERATIONS) else STUCK


@compile_inline
def _classify(s, i, size, last):
    """Return SETTLED where the correction of velocities, ``size``, is within the tolerance, FAILED if not finite."""
    if not math.isfinite(size):
        return FAILED
    return SETTLED if size <= s.scheme.tolerance else GO_ON


@compile_inline
def _sweep(s, n, stale):
    """Correct lam and V once, by direction ``n`` of the conjugate residuals; return a change of V, its largest entry.

    It is the change by S^-1 times the whole residual. Within the tolerance it is applied as it is; else the residual
    becomes a direction, orthogonal in its effect to those before. Return NaN where a direction has no effect.
    """
    k, g, depth = s.kernel, s.scheme, len(s.tried)
    p, q, share = s.tried[n % depth], s.reached[n % depth], 1.0
    copy(s.left, p)
    s.control.iterations += 1
    change = _apply_multipliers(k, p)
    if not change <= g.tolerance:  # q = S^-1 A M^-1 A_i^T p, made orthogonal to those of the tries before
        set_rates(k)
        _solve(k, q)
        for j in range(min(n, depth)):
            if j != n % depth:
                shared = _take_scalar_product(q, s.reached[j])
                add_scaled(-shared, s.reached[j], q)
                add_scaled(-shared, s.tried[j], p)
        size = math.sqrt(_take_scalar_product(q, q))
        if not size > 0.0:
            return np.nan
        for a in range(len(q)):
            p[a], q[a] = p[a] / size, q[a] / size
        share = _take_scalar_product(q, s.left)
        add_scaled(-share, q, s.left)
        _apply_multipliers(k, p)
    for b in range(len(k.v)):
        add_scaled(share, k.w[b], k.v[b])
        add_scaled(share / g.weight, k.w[b], s.gains[g.stage, b])
    add_scaled(share / g.weight, p, k.lam)
    return change


@compile_inline
def _solve(k, out):
    """Set out := S^-1 x for the kernel's ``x``, with the factor of the step's start."""
    copy(k.x, k.rhs)
    run(k.solve)
    copy(k.rhs, out)


@compile_inline
def _apply_multipliers(k, x):
    """Set ``k.w`` := M^-1 A_i^T x, with the copied rows of the stage; return its largest absolute entry."""
    clear(k.w)
    copy(x, k.x)
    run(k.push_kept)
    return find_largest(k.w)


@compile_inline
def _take_scalar_product(x, y):
    """Return the scalar product of x and y, both (n,)."""
    out = 0.0
    for a in range(len(x)):
        out += x[a] * y[a]
    return out
