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

The matrix of the iteration is M alone: it does not converge with springs for which h^2 k/m is of order one or more.
``s`` is the bundle of a step, ``k`` its kernel.
"""

from functools import partial

from ....harness.mechanics.types import Problem
from ..compiled.algebra import clear, copy, find_largest, take_larger
from ..compiled.bundles import make_record, make_step
from ..compiled.entries import compile_inline, run
from ..compiled.host import Method, choose_tolerance
from ..compiled.marching import STUCK
from .iteration import MOST_ITERATIONS, classify_by_fall, iterate
from .products import add_scaled, displace_poses, set_rates
from .stiff_springs import make_explainer

COUNTERS = ("iterations", "factorisations")
ARRAYS = {
    "r0": "nb 3",
    "R0": "nb 3 3",
    "v0": "nb 6",
    "vdot0": "nb 6",
    "a0": "nb 6",  # the scheme's own acceleration
    "slack": "nb 6",  # M^-1 A^T eta
    "dq": "nb 6",
    "lam": "nr",
    "eta": "nr",
}


def make_alpha_method(
    problem: Problem,
    tolerance: float,
    *,
    beta: float,
    gamma: float,
    alpha_m: float = 0.0,
    alpha_f: float = 0.0,
    shift: float = 0.0,
    stabilised: bool = False,
    projected: bool = False,
) -> Method:
    """Make the generalised-alpha method with these coefficients, for ``host.integrate``.

    The coefficients are those of the equations above. ``tolerance`` is that of phi and of the last correction of poses
    [m; without unit]; ``shift`` times the diagonal of S is added to it; ``stabilised`` also solves A v = 0, with a
    second multiplier; ``projected`` projects velocities and accelerations after each step.
    """
    tolerance, notes = choose_tolerance(tolerance, problem)
    scheme = make_record(
        alpha_m=alpha_m,
        alpha_f=alpha_f,
        beta=beta,
        gamma=gamma,
        tolerance=tolerance,
        shift=shift,
        stabilised=stabilised,
        projected=projected,
    )
    of_system = partial(make_step, arrays=ARRAYS, scheme=scheme)  # ``v_dot`` of the kernel is vdot
    return Method(of_system, step, finish, start, counters=COUNTERS, notes=notes, explain=make_explainer(problem))


def start(s):
    """Set vdot and a to the acceleration of index 1 at the start, and set the shift of S.

    The estimate of lam stays 0: where no redundant row is dropped, corrections from 0 share the load among them.
    """
    run(s.kernel.accelerate)
    s.control.factorisations += 1
    copy(s.kernel.v_dot, s.a0)
    s.kernel.state.shift = s.scheme.shift


def step(s):
    """Solve the step of ``control.h`` by Newton's iteration; set ``control.status`` = STUCK if it does not converge."""
    c, k, h = s.control, s.kernel, s.control.h
    k.t[0] = c.t + h
    copy(k.r, s.r0)
    copy(k.R, s.R0)
    copy(k.v, s.v0)
    copy(k.v_dot, s.vdot0)
    clear(s.slack)
    if not iterate(s, _sweep, classify_by_fall, MOST_ITERATIONS):
        c.status = STUCK


def finish(s):
    """Set the end of the step: its poses and velocities, the scheme's acceleration, and ``lam``.

    If ``projected``, velocities and accelerations are projected onto the constraints.
    """
    k = s.kernel
    _predict(s, k, s.control.h)
    for b in range(len(s.a0)):
        for a in range(6):
            s.a0[b, a] = _compute_scheme_acceleration(s, b, a)
    if s.scheme.projected:
        _project(s, k)
    copy(s.lam, k.lam)


@compile_inline
def _sweep(s, i, stale):
    """Correct vdot, lam and eta once; return the size of the residuals [m; without unit].

    S is that of the first estimate of q_1 or, where it is ``stale``, of the present one; ``i`` counts corrections.
    """
    k, h = s.kernel, s.control.h
    s.control.iterations += 1
    _predict(s, k, h)
    run(k.rows)
    if i == 0 or stale:
        run(k.factorise)
        s.control.factorisations += 1
    return _correct(s, k, h)


@compile_inline
def _compute_scheme_acceleration(s, b, a):
    """Return component ``a`` (0 to 5) of the scheme's acceleration a_1 of body ``b``, from the present vdot."""
    c = s.scheme
    known = c.alpha_f * s.vdot0[b, a] - c.alpha_m * s.a0[b, a]
    return ((1.0 - c.alpha_f) * s.kernel.v_dot[b, a] + known) / (1.0 - c.alpha_m)


@compile_inline
def _predict(s, k, h):
    """Set velocities and poses of ``k`` to those that the present vdot gives at the end of the step of ``h`` [s]."""
    c = s.scheme
    for b in range(len(s.v0)):
        for a in range(6):
            v0, a0, a1 = s.v0[b, a], s.a0[b, a], _compute_scheme_acceleration(s, b, a)
            k.v[b, a] = v0 + h * ((1.0 - c.gamma) * a0 + c.gamma * a1)
            s.dq[b, a] = h * (v0 + h * ((0.5 - c.beta) * a0 + c.beta * a1)) + s.slack[b, a]
    displace_poses(s.r0, s.R0, s.dq, k.r, k.R)


@compile_inline
def _correct(s, k, h):
    """Correct vdot, lam and eta with the rows in the kernel; return the size of the residuals [m; without unit].

    It is the largest of phi, of the change of poses by the correction of vdot and, if stabilised, of A v in length.
    """
    c = s.scheme
    ratio = (1.0 - c.alpha_f) / (1.0 - c.alpha_m)
    on_q, on_v = ratio * c.beta * h * h, ratio * c.gamma * h  # beta' h^2 and gamma' h
    size = find_largest(k.phi)
    if c.stabilised:
        copy(k.v, k.w)
        run(k.slips)
        for a in range(len(s.eta)):
            s.eta[a] = -k.x[a]
        size = take_larger(size, on_q / on_v * find_largest(s.eta))
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
    size = take_larger(size, on_q * find_largest(k.w))
    if c.stabilised:
        copy(s.eta, k.rhs)
        copy(s.slack, k.w)
        _push_solution(k)
        copy(k.w, s.slack)
    return size


@compile_inline
def _push_solution(k):
    """Set ``k.x`` := S^-1 rhs, and add M^-1 A^T x to ``k.w``."""
    run(k.solve)
    copy(k.rhs, k.x)
    run(k.push)


@compile_inline
def _project(s, k):
    """Project v onto A v + phi_t = 0, then vdot onto A vdot = -gamma, along M^-1 A^T; set a to the projected vdot.

    Each is done twice, as S is that of an estimate. The projection of vdot adds a reaction of the order of h to M vdot,
    which is also added to ``lam``.
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
