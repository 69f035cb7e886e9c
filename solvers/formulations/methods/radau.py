"""Radau IIA with three stages on stabilised index 2, error-controlled, in rotation vectors of the step (compiled).

Hairer and Wanner 1996, Solving Ordinary Differential Equations II, IV.8 and VII.4; stabilised: Gear, Gupta, Leimkuhler
1985, J. Comput. Appl. Math. 12. Stages i, with R_i = R_0 exp(theta_i) and the slack z_i = M^-1 A_i^T eta_i::

    v_i = v_0 + h sum a_ij vdot_j,   M vdot_i = f_i + A_i^T lam_i + A_s^T p_i,   phi(q_i) = 0,   A_i v_i = 0
    r_i = r_0 + h sum a_ij (v_j + z_j),   theta_i = h sum a_ij dexp^-1(theta_j) (Omega_j + z_j)

Simplified Newton with one S, that of the second stage's first estimate; d_i = M^-1 (f_i + A_i^T lam_i) - vdot_i::

    S dlam_i = -A_i d_i - sum_j (a^-1)_ij (A v)_j / h,   S deta_i = (A v)_i - sum_j (a^-1)_ij phi_j / h

so that stages decouple without complex systems. Spring-dampers are soft rows of the same step (module ``springs``), so
that their stiffness does not limit it. The last stage is the end of the step.

The iteration ends where phi, h (A v + phi_t) and h^2 dvdot are below a tolerance [m]. With short steps, as far from the
origin or in a tiny mechanism, that may leave v so far off A v + phi_t = 0 that the error test fails for any next step.
Such a start is moved back (module ``radau_error``), and from then on iterations go on while they gain a digit. ``s`` is
the bundle of a step, ``g`` its kernels of the stages, stacked.
"""

import math
from functools import partial
from typing import Any

import numpy as np

from ....harness.mechanics.fixed_order import inverse
from ....harness.mechanics.system import MultibodySystem
from ....harness.mechanics.types import Problem
from ..compiled.algebra import clear, copy, find_largest, take_larger, theta_dot
from ..compiled.bundles import make_record, make_step
from ..compiled.entries import compile_inline, run
from ..compiled.host import Method, choose_tolerance
from ..compiled.kernel import Kernel
from ..compiled.marching import SAFETY
from ..compiled.soft_rows import remove_springs, stack_kernels
from .iteration import FAILED, GO_ON, SETTLED, classify_by_fall, iterate
from .products import add_scaled, displace_poses
from .radau_error import close_start, estimate_error
from .springs import ENTRIES, add_entries, make_soft_rows, set_rates

_S = math.sqrt(6.0)
A = np.array([
    [(88.0 - 7.0 * _S) / 360.0, (296.0 - 169.0 * _S) / 1800.0, (-2.0 + 3.0 * _S) / 225.0],
    [(296.0 + 169.0 * _S) / 1800.0, (88.0 + 7.0 * _S) / 360.0, (-2.0 - 3.0 * _S) / 225.0],
    [(16.0 - _S) / 36.0, (16.0 + _S) / 36.0, 1.0 / 9.0],
])  # fmt: skip
C = np.array([(4.0 - _S) / 10.0, (4.0 + _S) / 10.0, 1.0])
ERROR = np.array([-13.0 - 7.0 * _S, -13.0 + 7.0 * _S, -1.0]) / 3.0
MOST_ITERATIONS = 25  # more help iterations that converge slowly, fewer end hopeless ones sooner
NEEDED = ("rows", "factorise", "solve", "leave_out", "forces", "divide", "push", "slips")
ARRAYS = {  # the first axis is that of the stages
    "vdot": "3 nb 6",
    "lam": "3 nr",
    "eta": "3 nr",
    "y": "3 nb 6",
    "rate": "3 nb 6",  # r_i - r_0 and theta_i
    "off": "3 nr",  # A v + phi_t
    "old_vdot": "3 nb 6",
    "old_lam": "3 nr",  # those of the last accepted step
}


def choose_newton_tolerance(rtol: float) -> float:
    """Return the tolerance [m] of Newton's iteration, and of the constraints: a thousandth of ``rtol``.

    It is at least 1e-13 and at most 1e-10.
    """
    return max(1e-13, min(1e-10, 1e-3 * rtol))


def make_radau_method(problem: Problem, rtol: float, code: str) -> Method:
    """Make the Radau method, for ``host.integrate``.

    ``rtol`` sets the tolerance of its iteration; ``code`` is the solver's option.
    """
    tolerance, notes = choose_tolerance(choose_newton_tolerance(rtol), problem)
    of_system = partial(prepare, system=problem.system, tolerance=tolerance, code=code)
    counters = ("rejected", "iterations", "factorisations")
    notes += ("code of the mechanism",) if code == "mechanism" else ()
    return Method(of_system, step, finish, start, order=4.0, counters=counters, notes=notes)


def prepare(kernel: Kernel, control: np.ndarray, *, system: MultibodySystem, tolerance: float, code: str) -> Any:
    """Make the bundle of a step: kernels of the stages without spring-dampers, and the springs as soft rows.

    In its scheme, ``before`` is the length of the last step; ``exact`` is 1 once a start was moved back.
    """
    stages, made = stack_kernels(remove_springs(system), 3, NEEDED, code)
    springs = make_soft_rows(system, len(kernel.lam), A, made)
    scheme = make_record(tolerance=tolerance, before=0.0, changed=0.0, exact=0)
    return add_entries(
        make_step(
            kernel,
            control,
            arrays=ARRAYS,
            entries=tuple(ENTRIES),
            stages=stages,
            springs=springs,
            scheme=scheme,
            a=A,
            c=C,
            inverse=inverse(A),
            estimate=ERROR,
        )
    )


def start(s):
    """Store vdot and lam of index 1 at the start, and minus the springs' tensions, as those of a last step's stages."""
    k, g = s.kernel, s.stages
    run(k.accelerate)
    s.control.factorisations += 1
    for i in range(3):
        copy(k.r, g.r[i])
        copy(k.R, g.R[i])
        copy(k.v, g.v[i])
        copy(k.v_dot, s.old_vdot[i])
        copy(k.lam, s.old_lam[i])
    run(s.measure_springs)
    for i in range(3):
        clear(s.springs.old[i])
        add_scaled(-1.0, s.springs.tension[i], s.springs.old[i])


def step(s):
    """Solve for the stages of a step of ``control.h``, and set ``control.error`` to its estimated error.

    Where the iteration does not converge, the error is set so that the step is halved. A start whose distance from the
    constraints makes every step fail is moved onto them, and the step is rejected.
    """
    c = s.control
    c.error = (SAFETY / 0.5) ** c.order
    _extrapolate_stages(s, c.h)
    for i in range(3):
        s.stages.t[i, 0] = c.t + s.c[i] * c.h
    converged = iterate(s, _sweep, _classify, MOST_ITERATIONS)
    if converged:
        _set_poses(s, c.h, converged)  # not True, for which numba would compile another function
        c.error = estimate_error(s, c.h, c.rtol)
        if c.error > 1.0 and close_start(s):
            s.scheme.exact = 1


def finish(s):
    """Set the kernel to the last stage, and store the stages for the next estimate."""
    k, g = s.kernel, s.stages
    copy(g.r[2], k.r)
    copy(g.R[2], k.R)
    copy(g.v[2], k.v)
    copy(s.vdot[2], k.v_dot)
    copy(s.lam[2], k.lam)
    copy(s.vdot, s.old_vdot)
    copy(s.lam, s.old_lam)
    copy(s.springs.p, s.springs.old)
    s.scheme.before = s.control.h


@compile_inline
def _extrapolate_stages(s, h):
    """Estimate vdot, lam and p by the parabola through the last step's stages; set eta = 0 and poses by the start's v.

    In the first step they are those of the start.
    """
    last = s.scheme.before
    clear(s.vdot)
    clear(s.lam)
    clear(s.eta)
    clear(s.springs.p)
    for i in range(3):
        x = 1.0 + s.c[i] * h / last if last > 0.0 else s.c[i]
        for j in range(3):
            m, n = (j + 1) % 3, (j + 2) % 3
            w = (x - s.c[m]) * (x - s.c[n]) / ((s.c[j] - s.c[m]) * (s.c[j] - s.c[n]))
            for b in range(len(s.kernel.v)):
                add_scaled(w, s.old_vdot[j, b], s.vdot[i, b])
            add_scaled(w, s.old_lam[j], s.lam[i])
            add_scaled(w, s.springs.old[j], s.springs.p[i])
        for b in range(len(s.kernel.v)):
            for a in range(6):
                s.y[i, b, a] = s.c[i] * h * s.kernel.v[b, a]


@compile_inline
def _set_poses(s, h, with_slack):
    """Set velocities and poses of the stages from their accelerations ``vdot``, for a step of h [s].

    With ``with_slack``, the slack z is that of eta with the rows of the last iterate; else it is zero.
    """
    g = s.stages
    for i in range(3):
        clear(g.w[i])
        if with_slack:
            copy(s.eta[i], g.x[i])
            run(g.push[i])
        for b in range(len(s.kernel.v)):
            for a in range(6):
                x = s.kernel.v[b, a]
                for j in range(3):
                    x += h * s.a[i, j] * s.vdot[j, b, a]
                g.v[i, b, a] = x
            y, v, d, rate = s.y[i, b], g.v[i, b], g.w[i, b], s.rate[i, b]
            rate[0], rate[1], rate[2] = v[0] + d[0], v[1] + d[1], v[2] + d[2]
            rate[3], rate[4], rate[5] = theta_dot(y[3], y[4], y[5], v[3] + d[3], v[4] + d[4], v[5] + d[5])
    for i in range(3):
        for b in range(len(s.kernel.v)):
            for a in range(6):
                x = 0.0
                for j in range(3):
                    x += h * s.a[i, j] * s.rate[j, b, a]
                s.y[i, b, a] = x
        displace_poses(s.kernel.r, s.kernel.R, s.y[i], g.r[i], g.R[i])


@compile_inline
def _classify(s, i, size, last):
    """Return SETTLED, GO_ON, STALE or FAILED by the size of the residuals in this sweep, ``size``, and in the last.

    It has failed where ``size`` is not finite, or has doubled from the third sweep on, above the tolerance. It is
    settled within the tolerance; an ``exact`` iteration goes on there while it gains a digit (``classify_by_fall``).
    """
    if not np.isfinite(size) or (i > 1 and size > take_larger(2.0 * last, s.scheme.tolerance)):
        return FAILED
    if s.scheme.exact:
        return classify_by_fall(s, i, size, last)
    return SETTLED if size <= s.scheme.tolerance else GO_ON


@compile_inline
def _sweep(s, i, stale):
    """Correct vdot, lam, eta and p of all stages once; return the size of the residuals [m; without unit].

    The first sweep factorises S, and computes the response of the springs; ``i`` counts sweeps.
    """
    h, first = s.control.h, i == 0
    s.control.iterations += 1
    s.control.factorisations += first
    _set_poses(s, h, not first)
    g, size = s.stages, 0.0
    for i in range(3):
        run(g.rows[i])
        copy(g.v[i], g.w[i])
        run(g.slips[i])
        for a in range(s.off.shape[1]):
            s.off[i, a] = -g.x[i, a]
        size = take_larger(size, take_larger(find_largest(g.phi[i]), h * find_largest(s.off[i])))
    run(s.measure_springs)
    if first:
        run(g.factorise[1])
        for i in range(3):
            copy(s.lam[i], g.rhs[1])
            run(g.leave_out[1])
            copy(g.rhs[1], s.lam[i])
        run(s.prepare_springs)
    for i in range(3):
        size = take_larger(size, h * h * _correct_stage(s, g, h, i))
    s.scheme.changed = 0.0
    run(s.correct_springs)
    return take_larger(size, h * h * s.scheme.changed)


@compile_inline
def _correct_stage(s, g, h, i):
    """Correct vdot, lam and eta of stage i, with the pull of springs as it is; return the largest change of vdot."""
    right = g.rhs[1]
    run(g.forces[i])
    copy(g.force[i], g.w[i])
    run(g.divide[i])
    for b in range(len(s.kernel.v)):
        add_scaled(-1.0, s.vdot[i, b], g.w[i, b])
    copy(s.lam[i], g.x[i])
    run(g.push[i])
    for b in range(len(s.vdot[i])):
        add_scaled(1.0, s.springs.pull[i, b], g.w[i, b])
    set_rates(g, i)
    for a in range(len(right)):
        by_v = 0.0
        for j in range(3):
            by_v += s.inverse[i, j] * s.off[j, a]
        right[a] = -by_v / h - g.x[i, a]
    run(g.solve[1])
    copy(right, g.x[i])
    add_scaled(1.0, g.x[i], s.lam[i])
    run(g.push[i])
    for a in range(len(right)):
        by_q = 0.0
        for j in range(3):
            by_q += s.inverse[i, j] * g.phi[j, a]
        right[a] = s.off[i, a] - by_q / h
    run(g.solve[1])
    add_scaled(1.0, right, s.eta[i])
    for b in range(len(s.kernel.v)):
        add_scaled(1.0, g.w[i, b], s.vdot[i, b])
    return find_largest(g.w[i])
