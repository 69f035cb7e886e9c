"""ODE-GC's step by a simplified Newton method on S = A M^-1 A^T, for gravity as the only applied force (compiled).

Given v1 and nu1: poses by (66), impulses of (74) in space with nu0 = gauge nu1 + nu_start, B = dt/2::

    w   = P0 + dt f - dt/2 (D0 f_bar0 + D1 f_bar1) + (D1 - B D_dot1) nu1 - (D0 + B D_dot0) nu0
    v_n = M^-1 R1^T w,   S x = -A1 v_n,   nu1 += x / (1 - gauge),   v1 = v_n + M^-1 A1^T x

The method contracts by O(dt omega), and the change of v1 in the norm of M is the residual (80) before it. So a step is
done when the change is below the tolerance. S is factorised anew where the change falls too slowly; where that does not
help, or the rank of the rows differs from that at the start, the step does not converge. Redundant rows get no
multiplier: the motion is that of the proximal saddle. Joints bring their part by loops, or the whole mechanism has code
for it, both of ``rows.wrenches``. ``step`` is the bundle of ``make_step``, and its ``scheme`` has settings and state.
"""

import math
from typing import Any

import numpy as np

from ....harness.base.generated import Code, Program
from ....harness.mechanics.system import MultibodySystem
from ..compiled import bundles
from ..compiled.algebra import clear, copy, multiply, multiply_transposed, turn_rotation
from ..compiled.bundles import make_record
from ..compiled.entries import BoundFunction, compile_inline, run
from ..compiled.evaluation import multiply_by_inverse_mass
from ..compiled.kernel import ElementGroup, Kernel, Loops, list_places
from ..compiled.mechanism import list_choice_arrays, make_choosing_program, make_mechanism_code
from ..compiled.row_choice import NEVER
from .choices import Settings
from .iteration import FAILED, GO_ON, SETTLED, STALE, iterate

# "Half" and "twice": tried on a free body, a pendulum, a top and a chain, each at its usual step and at one 10 to 50
# times as long, with 4,100 iterations in all, by loops over joints; EARLY and DEEP by code, without the free body.
# replaces ``refresh``: by code a factor costs less than an iteration. Half takes up to 40 % more factors and changes
# the iterations by 1 %; twice takes 16 to 64 % fewer factors, and 2 to 13 % more iterations.
EARLY = 0.1
# past steps from which the next one is estimated: by loops, by code. Half of the first takes 2 to 195 % more sweeps,
# twice from 38 % fewer to 69 % more; half of the second (3) takes 12 to 82 % more, twice from 21 % fewer to 84 % more.
DEPTH, DEEP = 4, 7
# iterations a step, the last not tested: more help those that converge slowly, fewer end hopeless ones sooner. Half
# saves the chain 6 % of its iterations in steps that are cut anyway; twice changes no run.
MOST = 31
# factors of S in a step. Half takes up to a third fewer factors and at most 3 % fewer iterations; twice up to 10 % more
# factors at long steps, and 3 % more iterations.
REFRESHES = 2
ON_OTHER_ROWS = 8  # the same after rows were chosen anew: an estimate from other rows is farther off
PASSES = 2  # passes of the pose correction: the factor is that of the step's first estimate
NEEDED = ("rows", "factorise", "solve")  # entries that loops need; code has its own
# decades a step: a determinant that falls so fast may approach zero, and is computed in each step. Half takes 11 % more
# factors on Bennett's linkage, twice 12 % fewer and 2 % more iterations; ends move by 3e-6 m.
SINKING = -0.05

ARRAYS = {  # suffix 0: the start of the step
    "r0": "nb 3",
    "R0": "nb 3 3",
    "v0": "nb 6",
    "known": "nb 6",  # the part of w that the end does not change
    "in_space": "nb 6",  # velocities r_dot, omega
    "load": "nb 6",
    "nu": "nr",
    "nu_start": "nr",
    "f_bar0": "nr",
    "slip": "nr",  # M_bar phi_dot^2
    "square": "1",  # [J] of the last change
}
PAST = {  # of the last steps, in turn
    "acceleration": "nb 6",
    "impulse": "nr",  # (nu1 - nu0) / dt
    "middle": "",  # [s]
    "weight": "",  # in the estimate of the next step
}
STATE = {
    "log_det": 0.0,  # log10 det S
    "fall": 0.0,  # its last change
    "known": 0,  # past steps known
    "factored": 0,  # 1 where there is a factor
    "refreshed": 0,  # factors in this step
    "rank": 0,  # of the rows at the start
    "begun": 0,  # 1 where the next step has begun
}
OF_JOINTS = {  # functions of ``rows.wrenches.wrench_loops``, with Z0 = D0 + B D_dot0
    "start": "kernel (t, r, R), plan, in_space -> known -= dt/2 D0 f_bar0; f_bar0, slip; Z0 kept for impulses",
    "impulses": "kernel (t, r, R), plan, in_space, nu -> kernel.w += (D1 - B D_dot1) nu - Z0 nu0 - dt/2 D1 f_bar1",
    "rates": "in_space -> kernel.rhs = -D1^T in_space, by D1 of impulses",
    "loads": "kernel.rhs -> load += D1 rhs",
}
PARTS = (
    "begin",  # ``known``, ``f_bar0`` and other results of the start of a step
    "factor",  # S at the poses of the kernel, ``found``
    "iterate",  # v and nu at the poses of the kernel, ``square``
    "correct",  # poses onto phi = 0, with the factor at hand
)


def allocate_step(
    kernel: Kernel, control: np.ndarray, settings: Settings, arrays: Any, state: Any, entries: Any, **given: Any
) -> Any:
    """Make the bundle of a step of ODE-GC: zero ``arrays``, ``given`` values, and ``entries`` still unset (0).

    Its record ``scheme`` has the settings and ``state``; its record ``plan`` has dt/2 (``half``), B = dt/2 times the
    switch of the B term (``rate``), both 0 at first, and the gauge.
    """
    given["scheme"] = make_record(**settings.numbers(), **state)
    given["plan"] = make_record(half=0.0, rate=0.0, gauge=settings.gauge)
    given["diagnostics"] = np.zeros(len(settings.diagnostic_names))
    return bundles.make_step(kernel, control, arrays=arrays, entries=entries, **given)


def make_step(system: MultibodySystem, kernel: Kernel, control: np.ndarray, settings: Settings) -> Any:
    """Make the bundle of one step: its arrays, and entries by loops or by code; no step is taken."""
    nb, mass, depth = len(kernel.mass), system.mass[:, None], DEEP if settings.whole else DEPTH
    past = {name: f"{depth} {shape}" for name, shape in PAST.items()}
    given = {
        "found": make_record(rank=0.0, log_det=0.0),  # of the last factor: its rank, log10 det S
        "bodies": np.hstack((mass * system.gravity, mass, kernel.J_inv.reshape(nb, 9), kernel.J.reshape(nb, 9))),
    }
    step = allocate_step(kernel, control, settings, ARRAYS | past, STATE, (*OF_JOINTS, *PARTS), **given)
    return (_bind_code if settings.whole else _bind_loops)(system, step, settings)


def _bind_loops(system: MultibodySystem, step: Any, settings: Settings) -> Any:
    """Return the step with entries by loops over joints and bodies; its poses are corrected only if ``closes_pose``."""
    kernel, loops, use_f_bar = step.kernel, Loops(system, step.kernel), bool(settings.use_f_bar)
    moving = (kernel.r, 3), (kernel.R, 9), (step.in_space, 6)

    def list_arrays(group: ElementGroup, code: Code) -> dict[str, list[Any]]:
        """Return the arguments of each function ``OF_JOINTS`` for a group of joints, with memory for entries kept."""
        sizes = np.zeros(2)
        code.function("sizes", 1)(sizes.ctypes.data)
        kept0, kept1 = (np.zeros((int(group.members[0]), int(size))) for size in sizes)
        given, own, rhs = [kernel.t, step.plan, group.numbers], group.rows, kernel.rhs[group.rows]
        weighed = list(list_places(group, *moving, (step.bodies, 22)))
        moved = weighed if use_f_bar else list_places(group, *moving)
        known, w, load, u = (list_places(group, (x, 6)) for x in (step.known, kernel.w, step.load, step.in_space))
        f_bar0 = [step.f_bar0[own]] if use_f_bar else []
        return {
            "start": [*given, *weighed, kept0, step.slip[own], *f_bar0, *known],
            "impulses": [*given, kept0, step.nu[own], step.nu_start[own], *moved, kept1, *w],
            "rates": [kept1, *u, rhs],
            "loads": [kept1, rhs, *load],
        }

    choices = {"use_f_bar": use_f_bar}
    step = step._replace(**loops.bind("wrenches.wrench_loops", OF_JOINTS, list_arrays, settings.direction, **choices))
    return step._replace(
        begin=BoundFunction(begin_by_loops, step),
        factor=BoundFunction(factor_by_loops, step),
        iterate=BoundFunction(iterate_by_loops, step),
        correct=BoundFunction(correct_by_loops, kernel) if settings.closes_pose else Program([]),
    )


def _bind_code(system: MultibodySystem, step: Any, settings: Settings) -> Any:
    """Return the step with entries by code for this mechanism, ``rows.wrenches.SimplifiedStep``: the same equations.

    ``refresh`` becomes ``EARLY``. With ``active`` no rows are chosen anew: where kept rows become dependent, the
    proximal saddle takes over. Raises ``NoMechanismCode`` where the mechanism has no code.
    """
    k, names, given = step.kernel, ("gauge", "b_term", "direction", "use_f_bar", "keep_nu"), settings.numbers()
    step.scheme["refresh"] = EARLY
    if settings.active:
        k = k._replace(dense=k.dense[:0])
    bounds, shares = list_choice_arrays(k)
    code, _, (kept, size) = make_mechanism_code(system, k, "iterate", **{name: given[name] for name in names})
    start, factor, poses, now = np.zeros(kept), np.zeros(size), [k.t, k.r, k.R], [k.t, step.plan, k.r, k.R, k.v]
    r, R, v, nu = (np.zeros_like(x) for x in (k.r, k.R, k.v, step.nu))

    def program(*calls: tuple[str, list[np.ndarray]]) -> Program:
        """Return the program of calls of the code's functions, given by name and arguments."""
        return Program([(code.address(name), arrays) for name, arrays in calls], (code, k))

    iterated = [step.known, start, step.nu, factor, v, nu, step.square]
    correct = ("correct", [*poses, factor, r, R]), ("copy_poses", [r, R, k.r, k.R])
    return step._replace(
        begin=program(("begin", [*now, step.nu_start, step.known, start, step.slip, step.f_bar0])),
        factor=make_choosing_program(k, code, "factor", [*poses, *bounds, factor, step.found, *shares], poses),
        iterate=program(("iterate", [*now, *iterated]), ("copy", [v, nu, k.v, step.nu])),
        correct=program(*correct * PASSES * settings.closes_pose),
    )


@compile_inline
def begin_march(step):
    """Prepare the first step from acceleration and multipliers of index 1, and store the rank of S for the march."""
    run(step.kernel.accelerate)
    run(step.factor)
    step.scheme.rank = step.found.rank
    step.scheme.factored = 0
    restart(step, step.kernel.v_dot, step.kernel.lam)


@compile_inline
def refresh_factor(step):
    """Keep the factor of S that ``accelerate`` has made for the next step, or make it by code; return its rank."""
    step.scheme.factored = 1
    if step.scheme.whole:
        run(step.factor)
        return step.found.rank
    return float(step.kernel.state.rank)


@compile_inline
def restart(step, v_dot, lam):
    """Restart the estimate of the next step from ``v_dot`` (nb, 6) and ``lam`` (nrows,), as means of one past step."""
    copy(v_dot, step.acceleration[0])
    copy(lam, step.impulse[0])
    step.scheme.known = 1
    step.middle[0] = 0.0


@compile_inline
def _turn_to_space(kernel, v, in_space):
    """Set in_space := (r_dot, R Omega), the velocities ``v`` (nb, 6) in space, with R of the kernel."""
    copy(v, in_space)
    for b in range(len(kernel.mass)):
        in_space[b, 3], in_space[b, 4], in_space[b, 5] = multiply(kernel.R[b], v[b, 3], v[b, 4], v[b, 5])


@compile_inline
def _convert_to_velocities(kernel, w):
    """Convert impulses ``w`` (nb, 6) in space to velocities, w := M^-1 R^T w, with R of the kernel."""
    for b in range(len(kernel.mass)):
        w[b, 3], w[b, 4], w[b, 5] = multiply_transposed(kernel.R[b], w[b, 3], w[b, 4], w[b, 5])
    multiply_by_inverse_mass(kernel.mass, kernel.J_inv, w)


@compile_inline
def set_plan(step, h):
    """Set the plan to that of a step of h [s]."""
    step.plan.half = 0.5 * h
    step.plan.rate = 0.5 * h * step.scheme.b_term


@compile_inline
def move_poses(step):
    """Set the poses (66) at the end of the step from the velocities at both ends."""
    kernel, half = step.kernel, step.plan.half
    for b in range(len(kernel.mass)):
        v0, v1 = step.v0[b], kernel.v[b]
        for a in range(3):
            kernel.r[b, a] = step.r0[b, a] + half * (v0[a] + v1[a])
        turn_rotation(step.R0[b], half * (v0[3] + v1[3]), half * (v0[4] + v1[4]), half * (v0[5] + v1[5]), kernel.R[b])


@compile_inline
def begin_step(step, h):
    """Begin a step of h [s] at the state of the kernel: copy it, and compute the terms that its end does not change."""
    set_plan(step, h)
    copy(step.kernel.r, step.r0)
    copy(step.kernel.R, step.R0)
    copy(step.kernel.v, step.v0)
    run(step.begin)


def begin_by_loops(step):
    """Compute ``known``, the part of w that the end of the step does not change, by loops over joints.

    ``f_bar0`` and ``slip`` of the start are computed, too.
    """
    kernel, h = step.kernel, 2.0 * step.plan.half
    for b in range(len(kernel.mass)):
        v = kernel.v[b]
        p = multiply(kernel.J[b], v[3], v[4], v[5])
        L = multiply(kernel.R[b], p[0], p[1], p[2])
        for a in range(3):
            step.known[b, a], step.known[b, 3 + a] = kernel.mass[b] * v[a] + h * step.bodies[b, a], L[a]
    _turn_to_space(kernel, kernel.v, step.in_space)
    run(step.start)


@compile_inline
def _estimate(step, h, t):
    """Estimate v1 and nu1 of a step of h [s]: accelerations and row forces of past steps, extrapolated to its middle t.

    The polynomial is Lagrange's, through as many past steps as are known, at their middles.
    """
    kernel, known = step.kernel, min(step.scheme.known, len(step.middle))
    for d in range(known):
        step.weight[d] = h
        for c in range(known):
            if c != d:
                step.weight[d] *= (t - step.middle[c]) / (step.middle[d] - step.middle[c])
    share = 1.0 / (1.0 - step.scheme.gauge)
    copy(step.v0, kernel.v)
    for a in range(len(step.nu)):
        step.nu[a] = share * step.nu_start[a]
    for d in range(known):
        weight = step.weight[d]
        for a in range(kernel.v.size):
            kernel.v.flat[a] += weight * step.acceleration[d].flat[a]
        for a in range(len(step.nu)):
            step.nu[a] += share * weight * step.impulse[d, a]


def factor_by_loops(step):
    """Factorise S at the poses of the kernel by loops; set ``found``: its rank and log10 of its determinant.

    The determinant is that of the rows kept, scaled to a diagonal of one.
    """
    kernel, blocks, total = step.kernel, step.kernel.blocks, 0.0
    run(kernel.rows)
    run(kernel.factorise)
    for col in range(len(blocks.joint)):
        for c in range(blocks.size[col]):
            inverse = kernel.L[blocks.start[col], c, c]
            if inverse > 0.0:
                total -= math.log10(inverse * inverse * kernel.diagonal[blocks.row[col] + c])
    step.found.rank = kernel.state.rank
    step.found.log_det = total


@compile_inline
def _factor(step):
    """Factorise S, and set nu of rows left out to zero; return whether S has the rank of the march's start.

    The determinant of S, and its change since the last factor, are stored in ``scheme``.
    """
    scheme, found = step.scheme, step.found
    run(step.factor)
    copy(step.nu, step.kernel.rhs)
    run(step.kernel.leave_out)
    copy(step.kernel.rhs, step.nu)
    step.control.factorisations += 1
    scheme.factored = 1
    scheme.fall = found.log_det - scheme.log_det
    scheme.log_det = found.log_det
    return found.rank == scheme.rank


def iterate_by_loops(step):
    """Correct v and nu of the end once by loops over joints; set ``square`` [J] to dv . M dv of the change of v."""
    kernel, share, total = step.kernel, 1.0 / (1.0 - step.scheme.gauge), 0.0
    _turn_to_space(kernel, kernel.v, step.in_space)
    copy(step.known, kernel.w)
    run(step.impulses)
    _convert_to_velocities(kernel, kernel.w)
    _turn_to_space(kernel, kernel.w, step.in_space)
    run(step.rates)
    run(kernel.solve)
    for a in range(len(step.nu)):
        step.nu[a] += share * kernel.rhs[a]
    clear(step.load)
    run(step.loads)
    _convert_to_velocities(kernel, step.load)
    for b in range(len(kernel.mass)):
        change = step.load[b]
        for a in range(6):
            x = kernel.w[b, a] + change[a]
            change[a] = x - kernel.v[b, a]
            kernel.v[b, a] = x
        p = multiply(kernel.J[b], change[3], change[4], change[5])
        for a in range(3):
            total += kernel.mass[b] * change[a] * change[a]
        for a in range(3):
            total += change[3 + a] * p[a]
    step.square[0] = total


def correct_by_loops(kernel):
    """Move the poses onto phi = 0 with the present factor, in ``PASSES`` passes."""
    for _ in range(PASSES):
        run(kernel.rows)
        run(kernel.close_joints)


@compile_inline
def find_end(step, h, t):
    """Find the end of the step begun, of h [s] with its middle at t [s]; return the last change of v1 [sqrt(J)].

    Return -1 where the iteration does not converge, or where the rank of S differs from that at the march's start.
    """
    scheme = step.scheme
    _estimate(step, h, t)
    move_poses(step)
    scheme.refreshed = 0
    if scheme.fall < SINKING or scheme.rank < len(step.nu):
        # a new factor near a loss of rank, or with redundant rows, whose factor is exact at its own poses alone
        scheme.factored = 0
    return math.sqrt(step.square[0]) if iterate(step, _sweep, _classify, MOST) else -1.0


@compile_inline
def _sweep(step, i, stale):
    """Correct v, nu and the poses of the end once; return the change of v [sqrt(J)], NaN where S has lost rank.

    S is factorised anew where it is ``stale`` or not that of this step; ``i`` counts sweeps.
    """
    control, scheme = step.control, step.scheme
    if stale or scheme.factored == 0:
        scheme.refreshed += 1
        if not _factor(step):
            return np.nan
    run(step.iterate)
    control.iterations += 1
    control.residuals += 1
    control.solves += 1
    move_poses(step)
    return math.sqrt(step.square[0])


@compile_inline
def _classify(step, i, change, last):
    """Return SETTLED, GO_ON, STALE or FAILED by the change of v [sqrt(J)] in this sweep and in the last.

    Where it falls slowly, S is stale until ``REFRESHES`` factors were made in this step, or more if rows were chosen
    anew; then the iteration fails unless the change is halved.
    """
    scheme = step.scheme
    if not np.isfinite(change) or i + 1 == MOST:
        return FAILED
    if change < scheme.tolerance:
        return SETTLED
    if change > scheme.refresh * last:
        if scheme.refreshed < (REFRESHES if step.kernel.state.chosen == NEVER else ON_OTHER_ROWS):
            return STALE
        if change > 0.5 * last:
            return FAILED
    return GO_ON


@compile_inline
def accept_step(step, h, t):
    """Store the mean acceleration and row forces of the step of h [s] just solved, whose middle is at t [s].

    The next steps are estimated by them. Where nu is carried (``keep_nu``), ``nu_start`` becomes nu of the end.
    """
    scheme = step.scheme
    scheme.known += 1
    d = (scheme.known - 1) % len(step.middle)
    for a in range(step.v0.size):
        step.acceleration[d].flat[a] = (step.kernel.v.flat[a] - step.v0.flat[a]) / h
    for a in range(len(step.nu)):
        step.impulse[d, a] = ((1.0 - scheme.gauge) * step.nu[a] - step.nu_start[a]) / h
        if scheme.keep_nu:
            step.nu_start[a] = step.nu[a]
    step.middle[d] = t
