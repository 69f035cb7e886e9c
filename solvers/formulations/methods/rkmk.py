"""Runge-Kutta-Munthe-Kaas steps on index 1, error-controlled, each accepted step projected (compiled).

In a step from (r0, R0): y = (r, theta, v) with R = R0 exp(theta), theta = 0 at the start, and::

    r' = v,   theta' = dexp^-1(theta) Omega,   v' = index-1 acceleration

The inverse differential is exact for each body, so the order is that of the tableau for any pair (Munthe-Kaas 1999).
The last stage is at the end of the step and serves as the next one's first, although the projection moves the point:
that change is of the order of the error, O(h^(p+1)).
"""

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

from ....harness.base.tableaux import Tableau
from ....harness.mechanics.types import Problem, StepControl, Trajectory
from ...plain import rkmk
from ..compiled.algebra import clear, copy, orthogonalise_rotations, theta_dot, turn_rotation
from ..compiled.bundles import make_step
from ..compiled.entries import compile_inline, run
from ..compiled.host import WITH_PLAIN, MarchedSolver, Method, code_option
from .explicit_stages import evaluate_stages

ARRAYS = {  # columns are r (3), theta (3), v (6)
    "start": "nb 12",
    "R": "nb 3 3",  # at the start of the step
    "y": "nb 12",
    "sums": "2 nb 12",  # sums of slopes: one estimate of the error, or two (E5, E3) that DOP853 combines
}


@dataclass(frozen=True)
class ExplicitPair(MarchedSolver):
    """A solver by an embedded Runge-Kutta pair."""

    code: str = code_option(*WITH_PLAIN)

    control: ClassVar[str] = "rtol"
    tableau: ClassVar[Tableau]
    pair: ClassVar[str]  # its name in solvers/plain

    def _make_method(self, problem: Problem, control: StepControl) -> Method:
        """Return the method of the pair with the option ``code``."""
        return replace(make_pair_method(self.tableau), code=self.code)

    def _integrate_plain(self, problem: Problem, control: StepControl) -> Trajectory:
        """Integrate by the pair in plain NumPy."""
        return rkmk.integrate(problem, control, self.pair)


def make_pair_method(tableau: Tableau) -> Method:
    """Make the method of an embedded pair, first same as last, for ``host.integrate``."""
    t, arrays = tableau, ARRAYS | {"slopes": f"{len(tableau.b) + 1} nb 12"}
    return Method(
        partial(make_step, arrays=arrays, a=t.a, b=t.b, c=t.c, estimate=t.error),
        step,
        finish,
        start,
        order=float(t.order),
        counters=("evaluations", "rejected", "factorisations"),
    )


def start(s):
    """Compute the first slope, and the multipliers of index 1, at the start."""
    _set_start(s)
    copy(s.start, s.y)
    _compute_slope(s, s.kernel.t[0], 0)


def step(s):
    """Compute the stages of a step of ``control.h``, and set ``control.error``; leave the kernel at the last stage."""
    c, n = s.control, len(s.b)
    evaluate_stages(s, s, c.t, c.h, 1, _set_stage, _compute_slope)
    _compute_slope(s, c.t + c.h, n)
    c.error = _measure_error(s, c.h, c.rtol)


def finish(s):
    """Project the end onto the constraints; make the last slope the first one, with the projected velocities."""
    k, n = s.kernel, len(s.b)
    run(k.project)
    orthogonalise_rotations(k.R)  # rotations, exact to rounding, for the start of the next step
    _set_start(s)
    for b in range(len(k.mass)):
        for a in range(6):
            s.slopes[0, b, a] = k.v[b, a]
            s.slopes[0, b, 6 + a] = s.slopes[n, b, 6 + a]


@compile_inline
def _set_start(s):
    """Set the start of the next step to the state of the kernel: r, theta = 0, v, and R."""
    for b in range(len(s.y)):
        for a in range(3):
            s.start[b, a], s.start[b, 3 + a] = s.kernel.r[b, a], 0.0
        for a in range(6):
            s.start[b, 6 + a] = s.kernel.v[b, a]
    copy(s.kernel.R, s.R)


@compile_inline
def _compute_slope(s, t, out):
    """Compute the slope y' at ``y`` and time t [s] from accelerations of index 1; store it as slope ``out``."""
    k = s.kernel
    k.t[0] = t
    for b in range(len(s.y)):
        for a in range(3):
            k.r[b, a] = s.y[b, a]
        turn_rotation(s.R[b], s.y[b, 3], s.y[b, 4], s.y[b, 5], k.R[b])
        for a in range(6):
            k.v[b, a] = s.y[b, 6 + a]
    run(k.accelerate)
    s.control.evaluations += 1
    s.control.factorisations += 1
    for b in range(len(s.y)):
        y = s.y[b]
        x = theta_dot(y[3], y[4], y[5], y[9], y[10], y[11])
        s.slopes[out, b, 3], s.slopes[out, b, 4], s.slopes[out, b, 5] = x
        for a in range(3):
            s.slopes[out, b, a] = y[6 + a]
        for a in range(6):
            s.slopes[out, b, 6 + a] = k.v_dot[b, a]


@compile_inline
def _set_stage(s, weights, n, h):
    """Set y := start + h sum_i weights[i] slopes[i] over the first ``n`` slopes, with h [s]."""
    _sum_slopes(s, weights, n, s.y)
    for b in range(len(s.y)):
        for a in range(12):
            s.y[b, a] = s.start[b, a] + h * s.y[b, a]


@compile_inline
def _sum_slopes(s, weights, n, out):
    """Set out (nb, 12) := sum_i weights[i] slopes[i] over the first ``n`` slopes; slopes of weight 0 are not read."""
    clear(out)
    for i in range(n):
        w, slope = weights[i], s.slopes[i]
        if w != 0.0:
            for b in range(len(out)):
                for a in range(12):
                    out[b, a] += w * slope[b, a]


@compile_inline
def _measure_error(s, h, rtol):
    """Return the step's error relative to its tolerance: the RMS of the estimate over ``rtol (1 + |y|)``.

    The tolerance of angles is ``rtol``. With two estimates E5, E3 it is E5^2 / sqrt(E5^2 + 0.01 E3^2), as in DOP853.
    """
    first = second = 0.0
    two, n = len(s.estimate) == 2, s.estimate.shape[1]
    for e in range(len(s.estimate)):
        _sum_slopes(s, s.estimate[e], n, s.sums[e])
    for b in range(len(s.y)):
        for a in range(12):
            scale = rtol if 3 <= a < 6 else rtol * (1.0 + max(abs(s.start[b, a]), abs(s.y[b, a])))
            first += (s.sums[0, b, a] / scale) ** 2
            second += (s.sums[1, b, a] / scale) ** 2
    size = 12.0 * len(s.y)
    if not two:
        return h * math.sqrt(first / size)
    if first == 0.0 and second == 0.0:
        return 0.0
    return h * first / math.sqrt((first + 0.01 * second) * size)
