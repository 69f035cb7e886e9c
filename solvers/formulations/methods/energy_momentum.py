"""Energy and momentum are kept by a mean-value step: Cayley's map, discrete gradients of rows and springs (compiled).

Simo and Wong 1991, Int. J. Numer. Meth. Eng. 31; discrete gradients: Gonzalez 1996, J. Nonlinear Sci. 6::

    r_1 = r_0 + h v_m,  R_1 = R_0 cay(h Omega_m),  v_m = (v_0 + v_1) / 2,  R_m = (R_0 + R_1) / 2 (no rotation)
    m (v_1 - v_0) = h (m g + sum F),   J (Omega_1 - Omega_0) + h Omega_m x J Omega_m = h R_m^-1 T,   phi(q_1) = 0

Rows A_m and forces of the mean are entries (modules ``rows.means``, ``compiled.means``): A_m v_m = (phi_1 - phi_0) / h.

Simplified Newton: S of the first estimate's A_m, P = h F, dv = v_0 + h M^-1 f + M^-1 A_m^T P - v_1,
S dP = -A_m dv - 2 phi / h. The multipliers F are those of the midpoint. A v at the ends may alternate from step to
step by O(h^2), and makes F alternate by O(h). Recorded at the end of the step is F + (F' - F'') / 2, from the last
three: the alternation cancels, and a straight line is continued. The matrix of the iteration leaves springs out.
``s`` is the bundle of a step, ``k`` its kernel, ``m`` the bundle of ``make_means``.
"""

from functools import partial
from typing import Any

import numpy as np

from ....harness.mechanics.system import MultibodySystem
from ....harness.mechanics.types import Problem
from ..compiled.algebra import clear, copy, find_largest, take_larger
from ..compiled.bundles import make_record, make_step
from ..compiled.entries import compile_inline, run
from ..compiled.host import Method, choose_tolerance
from ..compiled.kernel import Kernel
from ..compiled.marching import STUCK
from ..compiled.means import make_means
from ..compiled.mechanism import use_mean_code
from .iteration import MOST_ITERATIONS, classify_by_fall, iterate
from .products import add_scaled, set_rates
from .stiff_springs import make_explainer

ARRAYS = {
    "v0": "nb 6",
    "v": "nb 6",  # at the start and at the end
    "gain": "nb 6",  # v_1 - v_0, by which the next step's is estimated
    "F": "nr",
    "F1": "nr",
    "F2": "nr",  # multipliers of the midpoint, and of the midpoints of the two steps before
}


def make_mean_value_method(problem: Problem, tolerance: float, code: str) -> Method:
    """Make the mean-value method, for ``host.integrate``.

    ``tolerance`` is that of phi and of the last correction of poses [m; without unit]; ``code`` is the solver's option.
    """
    tolerance, notes = choose_tolerance(tolerance, problem)
    of_system = partial(prepare, system=problem.system, tolerance=tolerance, code=code)
    notes += ("code of the mechanism",) if code == "mechanism" else ()
    return Method(
        of_system,
        step,
        finish,
        start,
        counters=("iterations", "factorisations"),
        notes=notes,
        explain=make_explainer(problem),
    )


def prepare(kernel: Kernel, control: np.ndarray, *, system: MultibodySystem, tolerance: float, code: str) -> Any:
    """Make the bundle of a step: arrays, and programs of mean rows and forces by loops, or rows by code.

    ``code`` is "kernel" or "mechanism"; the latter raises ``NoMechanismCode`` where the mechanism has none.
    """
    means, scheme = make_means(system, kernel), make_record(tolerance=tolerance)
    if code == "mechanism":
        kernel = use_mean_code(system, kernel, means.h, means.r0, means.R0)
        means = means._replace(mean_rows=kernel.rows)
    return make_step(kernel, control, arrays=ARRAYS, means=means, scheme=scheme)


def start(s):
    """Set the multipliers of the midpoint and of two earlier ones to those of index 1 at the start, and phi_t to 0."""
    run(s.kernel.accelerate)
    s.control.factorisations += 1
    for F in (s.F, s.F1, s.F2):
        copy(s.kernel.lam, F)
    clear(s.kernel.slip)


def step(s):
    """Solve the step of ``control.h`` by Newton's iteration; set ``control.status`` = STUCK if it does not converge."""
    c, k, m = s.control, s.kernel, s.means
    k.t[0], m.h[0] = c.t + c.h, c.h
    copy(k.r, m.r0)
    copy(k.R, m.R0)
    copy(k.v, s.v0)
    copy(k.v, s.v)
    _add(1.0, s.gain, s.v)
    if not iterate(s, _sweep, classify_by_fall, MOST_ITERATIONS):
        c.status = STUCK


def finish(s):
    """Set poses, velocities and ``lam`` of the kernel to those at the end, and store those that the next steps need."""
    k = s.kernel
    _set_end(s, k, s.means)
    copy(s.v, k.v)
    copy(s.v, s.gain)
    _add(-1.0, s.v0, s.gain)
    for a in range(len(s.F)):
        k.lam[a] = s.F[a] + 0.5 * (s.F1[a] - s.F2[a])
    copy(s.F1, s.F2)
    copy(s.F, s.F1)


@compile_inline
def _sweep(s, i, stale):
    """Correct v and F once; return the size of the residuals [m; without unit].

    S is that of the first estimate of the mean rows or, where it is ``stale``, of the present ones; ``i`` counts
    corrections.
    """
    k, m = s.kernel, s.means
    s.control.iterations += 1
    _set_end(s, k, m)
    run(m.mean_rows)
    if i == 0 or stale:
        run(k.factorise)
        s.control.factorisations += 1
    return _correct(s, k, m)


@compile_inline
def _set_end(s, k, m):
    """Set ``k.v`` to the mean velocities, and the poses of ``k`` to q_1 that they lead to: R_1 by Cayley's map."""
    h = m.h[0]
    for b in range(len(k.v)):
        for a in range(6):
            k.v[b, a] = 0.5 * (s.v0[b, a] + s.v[b, a])
        x, y, z = 0.5 * h * k.v[b, 3], 0.5 * h * k.v[b, 4], 0.5 * h * k.v[b, 5]
        f = 2.0 / (1.0 + x * x + y * y + z * z)
        for a in range(3):
            k.r[b, a] = m.r0[b, a] + h * k.v[b, a]
            p, q, o = m.R0[b, a, 0], m.R0[b, a, 1], m.R0[b, a, 2]
            i, j, l = q * z - o * y, o * x - p * z, p * y - q * x  # row of R_0 hat(h Omega_m / 2)
            k.R[b, a, 0] = p + f * (i + j * z - l * y)
            k.R[b, a, 1] = q + f * (j + l * x - i * z)
            k.R[b, a, 2] = o + f * (l + i * y - j * x)


@compile_inline
def _correct(s, k, m):
    """Correct v and F with the mean rows in the kernel; return the size of the residuals [m; without unit].

    It is the larger of phi and of the change of velocities times h.
    """
    h = m.h[0]
    run(m.mean_forces)
    copy(k.force, k.w)
    run(k.divide)
    copy(s.F, k.x)
    run(k.push)
    for b in range(len(k.w)):
        for a in range(6):
            k.w[b, a] = s.v0[b, a] + h * k.w[b, a] - s.v[b, a]
    set_rates(k)
    for a in range(len(k.rhs)):
        k.rhs[a] = -2.0 / h * k.phi[a] - k.x[a]
    run(k.solve)
    copy(k.rhs, k.x)
    run(k.push)
    add_scaled(1.0 / h, k.x, s.F)
    _add(1.0, k.w, s.v)
    return take_larger(find_largest(k.phi), h * find_largest(k.w))


@compile_inline
def _add(weight, x, y):
    """Add ``weight`` times x to y, both (nb, 6)."""
    for b in range(len(x)):
        add_scaled(weight, x[b], y[b])
