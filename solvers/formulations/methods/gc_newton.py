"""ODE-GC's step by the full Newton method (compiled): residual (74), (75), correction (78), (79), tests (80), (81).

With nu = M_bar mu, P = (m r_dot, R J Omega), D nu the spatial wrench of the rows and D_dot nu its rate (B of Eq. 71)::

    (74)  P1 - P0 - (D1 nu1 - D0 nu0) + dt/2 (D_dot0 nu0 + D_dot1 nu1) - dt/2 (w0 + w1) = 0
    (75)  phi_dot1 + [dt/2 ((C_bar phi_dot + K_bar phi)_0 + (...)_1) - sigma0] / M_bar1 = 0

w is the applied wrench plus D G with G = C_bar mu + K_bar lam - f_bar; nu0 = gauge nu1 + nu_start; rotational rows of
(74) are rotated back by R1^T. Joints bring their part by functions of ``rows.wrenches``. The linear system is the
proximal saddle ``[[J_vv, -D'], [A, (Xi M_bar)^-1]]``: with Xi infinite it is that of Sect. 4.2; with a finite penalty
it is one correction and one augmentation (84), (85) of Sect. 4.3 at once. ``step`` is the bundle of ``make_step``, its
``scheme`` has settings and state, and its ``terms`` have one value for each row.
"""

import math
from functools import partial
from typing import Any

import numpy as np

from ....harness.base.generated import Code, Program
from ....harness.mechanics.system import MultibodySystem
from ..compiled.algebra import clear, copy, multiply, multiply_transposed, set_dexp, turn_rotation
from ..compiled.block_lu import factor, solve
from ..compiled.bundles import make_bundle
from ..compiled.entries import BoundFunction, compile_inline, compile_separately, run
from ..compiled.host import Method
from ..compiled.kernel import ElementGroup, Kernel, Loops, list_places
from ..compiled.marching import NOT_FINITE, STUCK
from ..compiled.saddle_pattern import analyse_saddle
from .choices import AFTER_CORRECTION, CORRECTED, DETERMINANT, ITERATIONS, LEVEL, PENALTY, RESIDUAL, SLIP, Settings
from .gc_step import SINKING, allocate_step, move_poses, set_plan
from .iteration import FAILED, GO_ON, SETTLED, STALE, iterate

COUNTERS = ("iterations", "residuals", "factorisations", "solves", "cuts", "augmentations", "loose_steps")
NEEDED = ("applied_forces", "applied_slopes", "spring_slopes")  # entries of the kernel
CONVERGED, LOOSE, FAILED_STEP = range(3)
# "Half" and "twice": tried on two four-bar cells, a grid, Bricard's and Bennett's linkages and a mechanism with joints
# declared twice; three of the five keep their bits whatever is changed.
# decades of the determinant below its largest, where rows that lose rank look like redundant ones. Half filters in
# fewer steps of the joints declared twice, 27 % fewer solutions, and moves their end by 5e-10 m; twice changes none.
NEAR = 3.0
# passes of the filter; with a penalty of 1e3 each reduces the rest a hundredfold. Half and twice change none.
MOST_PASSES = 6
# share of the tolerance: phi_dot that the next pass of the filter would remove. Half: 1 to 3 % more solutions; twice: 2
# to 4 % fewer.
SMALL_LEAK = 0.1
# an augmentation that leaves more of phi_dot raises xi (Powell; Bertsekas); half and twice change no bit of a pendulum
# and a top with the nested loop at a penalty of 1e3
ENOUGH = 0.25

TERMS = (  # values of all rows, in the kernel's order; suffix 0: at the start of the step, 1: at its end
    *("nu_start", "lam0", "mu0", "sigma0", "phi0", "phi_dot0", "f_bar0", "c_bar0", "k_bar0", "G0"),
    *("nu", "phi1", "phi_dot1", "m_bar", "f_bar1", "c_bar1", "k_bar1", "G1"),
    *("residual", "on_phi_dot", "on_phi"),  # (75) over M_bar, and its factors of phi_dot1 and phi1
    *("on_D", "on_D_dot", "dG", "stiffness"),  # factors of D1 and D_dot1 in (74); dG1/dnu1; -d(on_D)/dnu1
    *("nu_kept", "left", "softness"),  # nu of the nested loop; part of (75) that no velocity changes; (Xi M_bar)^-1
    *("nu_old", "nu_change"),  # nu of the last step, and its change (0 after a change of the step)
)
ARRAYS = {
    "c_R": "2 nr 6",  # on both ends, 0 on the ground
    "T": "nb 9",  # dt/2 dexp: the end turns by T dOmega1
    "r0": "nb 3",
    "R0": "nb 3 3",
    "v0": "nb 6",
    "force0": "nb 6",
    "known": "nb 6",  # the part of (74) that the end does not change, in space
    "residual": "nb 6",  # (74)
    "v_old": "nb 6",  # velocities one step before the present ones
    "passed": "nr",  # correction of nu before a pass of the filter of redundant rows
}
STATE = {  # fields of the scheme beside settings: ``xi``, the penalty of the present step, and
    "factored": 0.0,  # length of the step that the factor is of, 0: none
    "norm": 0.0,  # norm (80)
    "slip": 0.0,  # norm (81)
    "log_det": 0.0,  # log10 of the determinant
    "fall": 0.0,  # its last change
    "highest": -np.inf,  # its largest
    "last": 0.0,  # length of the last step, 0: none
    "nested": 0,  # 1 inside the nested loop
    "outcome": 0,  # of the last try
    "corrections": 0,  # iterations before it
}
OF_JOINTS = {  # functions of ``rows.wrenches.newton_loops``, with Z0 = D0 + B D_dot0
    "measure": "kernel (t, r, R, v, force) -> terms (phi1, phi_dot1, m_bar, f_bar1)",
    "direction": "kernel (t, r, R, v) -> c_R",
    "begin": "kernel (t, r, R, v), plan, terms (nu_start, G0) -> known += Z0 nu_start - dt/2 D0 G0; Z0 kept",
    "balance": "kernel (t, r, R, v), plan, terms -> residual += gauge Z0 nu + D1 on_D + D_dot1 on_D_dot, in the body",
    "slopes": "kernel, plan, T, terms -> blocks of the saddle, Eq. (79): column, row; bodies +=",
}
TERMS_READ = ("nu", "on_D", "on_D_dot", "nu_start", "G0", "stiffness", "on_phi_dot", "on_phi")  # by all of them
TERMS_MEASURED = ("phi1", "phi_dot1", "m_bar", "f_bar1")


def make_newton_method(system: MultibodySystem, settings: Settings) -> Method:
    """Make ODE-GC's method by full Newton iterations with these choices, for ``host.integrate``."""
    return Method(
        partial(make_step, system=system, settings=settings),
        take_step,
        finish,
        start,
        counters=COUNTERS,
        most_cuts=settings.max_cuts,
        diagnostic_names=settings.diagnostic_names,
        explain=explain,
        needs=NEEDED,
    )


def make_step(kernel: Kernel, control: np.ndarray, *, system: MultibodySystem, settings: Settings) -> Any:
    """Make the bundle of one step: its arrays, the pattern of its matrix, and compiled entries; no step is taken."""
    nr, pair_at = len(kernel.lam), {(int(a), int(b)): n for n, (a, b) in enumerate(kernel.pair)}
    forces = [(getattr(system, f"{kind}_i"), getattr(system, f"{kind}_j")) for kind in ("spring", "torsion", "user")]
    pushed = {(int(a), int(b)) for ends in forces for a, b in zip(*ends, strict=True)}
    apart = [n for (a, b), n in pair_at.items() if a != b and (settings.couple or pushed & {(a, b), (b, a)})]
    saddle, lu = analyse_saddle(kernel.body, kernel.row, kernel.pair, np.array(apart, dtype=np.int64))
    couples = [[[pair_at.get((int(a), int(b)), -1) for b in ends] for a in ends] for ends in kernel.body]
    rows_of_joints = np.diff(kernel.row)
    step = allocate_step(
        kernel,
        control,
        settings,
        ARRAYS,
        STATE | {"xi": settings.penalty, "pushed": bool(pushed or len(system.load_i))},
        (*(part.__name__ for part in PARTS), *OF_JOINTS, "factor_saddle", "solve_saddle"),
        terms=make_bundle("Terms", dict.fromkeys(TERMS, "nr"), {"nr": nr}),
        ends=np.repeat(kernel.body, rows_of_joints, axis=0),  # bodies of each row
        # of a row's end e by its end i: pairs of the kernel
        couple=np.repeat(np.array(couples, dtype=np.int64).reshape(-1, 2, 2), rows_of_joints, axis=0),
        saddle=saddle,
        lu=lu,
        # places of velocities and of rows in ``lu.x``
        body_at=(lu.body_at[:, None] + np.arange(6)).ravel(),
        row_at=np.repeat(lu.joint_at - kernel.row[:-1], rows_of_joints) + np.arange(nr),
        correction=np.zeros_like(lu.x),  # of all unknowns, in the order of ``lu.x``
    )
    step = step._replace(factor_saddle=BoundFunction(factor, lu), solve_saddle=BoundFunction(solve, lu))
    step = step._replace(**bind_joints(system, step, settings))
    unused = [part for part, used in OPTIONAL.items() if not getattr(settings, used)]
    for part in PARTS:
        step = step._replace(**{part.__name__: Program([]) if part in unused else BoundFunction(part, step)})
    return step


def bind_joints(system: MultibodySystem, step: Any, settings: Settings) -> dict[str, Any]:
    """Return programs for the functions ``OF_JOINTS`` by name, on the arrays of a ``step``; all read the same."""
    kernel, loops = step.kernel, Loops(system, step.kernel)
    couple, symmetric = bool(settings.couple), settings.gauge != 0.0
    inertia = np.concatenate((kernel.mass[:, None], kernel.J.reshape(-1, 9), kernel.J_inv.reshape(-1, 9)), axis=1)
    bodies = (kernel.r, 3), (kernel.R, 9), (kernel.v, 6), (kernel.force, 6), (inertia, 19), (step.T, 9)

    def list_arrays(group: ElementGroup, code: Code) -> dict[str, list[Any]]:
        """Return the arguments of each function for a group of joints, with memory for the Z0 kept."""
        own, six = group.rows, slice(6 * group.rows.start, 6 * group.rows.stop)
        kept = np.zeros((len(kernel.lam[own]), len(group.ends), 6))  # of each joint in turn
        read, measured = ([getattr(step.terms, name)[own] for name in of] for of in (TERMS_READ, TERMS_MEASURED))
        given = [kernel.t, step.plan, group.numbers, kept, *read, *list_places(group, *bodies)]
        blocks = [part[e, six] for part in (step.saddle.column, step.saddle.row) for e in group.ends]
        return {
            "measure": [*given, *measured],
            "direction": [*given, *(step.c_R[e, own] for e in group.ends)],
            "begin": [*given, *([kept] if symmetric else []), *list_places(group, (step.known, 6))],
            "balance": [*given, *list_places(group, (step.residual, 6))],
            "slopes": [*given, *blocks, *loops.list_blocks(step.saddle.bodies, group, couple)],
        }

    choices = {"symmetric": symmetric, "use_f_bar": bool(settings.use_f_bar), "couple": couple}
    return loops.bind("wrenches.newton_loops", OF_JOINTS, list_arrays, settings.direction, **choices)


def explain(step: Any, outcome: int) -> str:
    """Return the message for an ``outcome`` of a march that failed: the tolerance missed, and the norms reached."""
    cuts = step.scheme["max_cuts"]
    if outcome == NOT_FINITE:
        return f"not a finite number with the step cut {cuts} times"
    tolerance, residual, phi_dot = (step.scheme[name] for name in ("tolerance", "norm", "slip"))
    return (
        f"Newton's method does not reach {tolerance:g} sqrt(J) with the step cut {cuts} times "
        f"(residual {residual:.3g}, constraint norm {phi_dot:.3g})"
    )


def start(step):
    """Compute the terms of the equations at the start of the march; mu0 is 0 or, with ``velocity``, c . M v / M_bar."""
    kernel, terms = step.kernel, step.terms
    clear(terms.nu)
    run(step.complete)
    if step.scheme.velocity:  # mu0 = c . M v / M_bar: the velocity along c_R
        run(step.direction)
        for a in range(len(terms.nu)):
            total = 0.0
            for e in range(2):
                b = step.ends[a, e]
                if b >= 0:
                    c, v, J = step.c_R[e, a], kernel.v[b], kernel.J[b]
                    for q in range(3):
                        total += kernel.mass[b] * c[q] * v[q]
                        total += c[3 + q] * (J[q, 0] * v[3] + J[q, 1] * v[4] + J[q, 2] * v[5])
            terms.mu0[a] = total / terms.m_bar[a]
            terms.nu_start[a] = total
    run(step.keep_end)


def take_step(step):
    """Take a step of ``control.h``; where it fails, set ``control.status`` and reset the kernel to the step's start.

    A step in which a body would turn further than ``max_turn`` is not tried as long as it may be cut: it has failed.
    """
    control, scheme, kernel, omega2 = step.control, step.scheme, step.kernel, 0.0
    scheme.corrections = control.iterations
    for b in range(len(kernel.v)):
        omega2 = max(omega2, kernel.v[b, 3] ** 2 + kernel.v[b, 4] ** 2 + kernel.v[b, 5] ** 2)
    if math.sqrt(omega2) * control.h > scheme.max_turn and control.level < control.most_cuts:
        control.status = STUCK
        return
    copy(kernel.r, step.r0)
    copy(kernel.R, step.R0)
    copy(kernel.v, step.v0)
    scheme.outcome = _attempt(step, omega2)
    if scheme.outcome == FAILED_STEP:
        scheme.factored = 0.0
        copy(step.r0, kernel.r)
        copy(step.R0, kernel.R)
        copy(step.v0, kernel.v)
        kernel.t[0] = control.t
        control.status = STUCK if np.isfinite(scheme.norm) else NOT_FINITE


def finish(step):
    """Accept the end of the step: set ``lam`` to the mean row force, carry mu, lam and sigma, and set diagnostics.

    With ``closes_pose`` the poses are corrected first, unless the factor is void, as after a loose step.
    """
    control, scheme, terms, h = step.control, step.scheme, step.terms, step.control.h
    if scheme.outcome == LOOSE:
        control.loose_steps += 1
        scheme.factored = 0.0
        if not scheme.always_nested:  # a step of the nested loop is loose when it runs out of augmentations, too
            scheme.max_turn = min(scheme.max_turn, scheme.singular_turn)
    if scheme.factored != 0.0 and scheme.closes_pose:
        run(step.correct_pose)
    same = scheme.last == h
    for a in range(len(terms.nu)):
        nu0 = scheme.gauge * terms.nu[a] + terms.nu_start[a]
        step.kernel.lam[a] = (terms.nu[a] - nu0) / h + 0.5 * (terms.G0[a] + terms.G1[a])
        if scheme.keep_nu:
            terms.nu_change[a] = terms.nu[a] - terms.nu_start[a]
            terms.nu_start[a] = terms.nu[a]
        else:
            terms.nu_change[a] = terms.nu[a] - terms.nu_old[a] if same else 0.0
        terms.nu_old[a] = terms.nu[a]
        if scheme.corrective:
            mu1 = terms.nu[a] / terms.m_bar[a]
            terms.lam0[a] += 0.5 * h * (terms.mu0[a] + mu1)  # (67)
            terms.mu0[a] = mu1
        if scheme.carry_sigma:
            terms.sigma0[a] = terms.m_bar[a] * terms.phi_dot1[a]  # (62)
    copy(step.v0, step.v_old)
    scheme.last = h
    run(step.keep_end)
    step.diagnostics[ITERATIONS] = control.iterations - scheme.corrections
    step.diagnostics[LEVEL] = control.level
    step.diagnostics[RESIDUAL] = scheme.norm
    step.diagnostics[SLIP] = scheme.slip
    if scheme.active:
        step.diagnostics[PENALTY] = scheme.xi
        step.diagnostics[DETERMINANT] = scheme.log_det


def keep_end(step):
    """Make the end of the step the start of the next one: copy forces and terms of suffix 1 to those of suffix 0."""
    terms = step.terms
    copy(step.kernel.force, step.force0)
    copy(terms.phi1, terms.phi0)
    copy(terms.phi_dot1, terms.phi_dot0)
    copy(terms.f_bar1, terms.f_bar0)
    copy(terms.c_bar1, terms.c_bar0)
    copy(terms.k_bar1, terms.k_bar0)


@compile_separately
def _attempt(step, omega2):
    """Try one step from its start to its end, first estimate included; return CONVERGED, LOOSE or FAILED_STEP.

    Near a singular configuration the proximal saddle may not converge, as phi = O(dt^2) makes phi_dot = 0 inconsistent
    along the direction that is being lost. There the step is repeated by the nested loop, with a penalty so low that
    this direction is left to the multiplier carried from earlier steps, and it counts as done at ``accept``. ``omega2``
    [rad^2/s^2] is the largest |Omega|^2 of all bodies.
    """
    scheme, h = step.scheme, step.control.h
    if scheme.xi != scheme.penalty:  # the last step was a soft one: its factor is not that of this step
        scheme.factored = 0.0
    scheme.xi = scheme.penalty
    run(step.begin_step)
    run(step.estimate)
    if not scheme.always_nested:
        scheme.nested = 0
        if _newton(step) and (not scheme.redundant or scheme.slip < scheme.accept):
            return CONVERGED
        if not scheme.active:
            return FAILED_STEP
        run(step.estimate)
        scheme.factored = 0.0
        if omega2 > 0.0:  # above about 0.3 of xi (omega dt)^2 the penalised matrix turns indefinite
            scheme.xi = min(scheme.penalty, scheme.soft / (omega2 * h * h))
    return _nested_loop(step)


@compile_inline
def _nested_loop(step):
    """Repeat Newton's iteration at a fixed multiplier, then (85), as the paper does; return the outcome of the step.

    It is CONVERGED where (81) meets the tolerance, LOOSE where it meets ``accept`` after the last round, FAILED_STEP
    else. Where (81) falls too little, the penalty grows.
    """
    scheme, terms, before = step.scheme, step.terms, np.inf
    copy(terms.nu, terms.nu_kept)
    scheme.nested = 1
    for n in range(scheme.max_augmentations):
        if not _newton(step):
            return FAILED_STEP
        copy(terms.nu, terms.nu_kept)  # (85): mu - xi psi
        step.control.augmentations += 1
        if scheme.slip < scheme.tolerance:
            return CONVERGED
        if scheme.growth > 1.0 and scheme.slip > ENOUGH * before:
            scheme.xi *= scheme.growth
            scheme.factored = 0.0
            if scheme.lambda_bar and n + 1 < scheme.max_augmentations:  # else the end that was found stays
                _begin_again(step)
        before = scheme.slip
    return LOOSE if scheme.slip < scheme.accept else FAILED_STEP


@compile_inline
def _begin_again(step):
    """Compute G0, with lam - xi phi of Eq. (84), anew after a change of xi; the velocities of the end are kept."""
    kernel = step.kernel
    copy(kernel.v, step.residual)  # ``evaluate`` computes it next
    copy(step.r0, kernel.r)
    copy(step.R0, kernel.R)
    copy(step.v0, kernel.v)
    run(step.begin_step)
    copy(step.residual, kernel.v)


@compile_separately
def _newton(step):
    """Correct the end of the step until it passes the tests (80), (81); return whether it does.

    With ``final`` CORRECTED it is corrected once more then. After a failure the factor is void.
    """
    clear(step.terms.left)
    if iterate(step, _sweep, _classify, step.scheme.max_newton + 1):
        return step.scheme.final != CORRECTED or np.isfinite(_sweep(step, 1, False))
    step.scheme.factored = 0.0
    return False


@compile_inline
def _sweep(step, i, stale):
    """Correct the end of the step, but for ``i`` = 0, and evaluate it; return the norm (80) of its residual [sqrt(J)].

    NaN is returned for a singular matrix. The matrix is that of an earlier estimate, of this step or of one before,
    unless that is ``stale``, of another length of step, or ``refresh`` is 0.
    """
    scheme = step.scheme
    if i > 0:
        if stale or scheme.factored != step.control.h or scheme.refresh <= 0.0:
            run(step.refresh)
            if step.lu.state.singular:
                return np.nan
        run(step.correct)
    run(step.evaluate)
    return scheme.norm


@compile_inline
def _classify(step, i, norm, last):
    """Return SETTLED, GO_ON, STALE or FAILED by the norms (80) of this iterate and of the ``last`` one.

    Settled is what passes (80), and (81) where that says more. The matrix is stale where the norm falls slowly, or at
    the first iterate where its determinant sinks. FAILED is a norm that is not finite.
    """
    scheme = step.scheme
    if not np.isfinite(norm):
        return FAILED
    # without sigma (80) implies (81), with C_bar or K_bar (81) cannot hold, and Sect. 4.3 asks (81) after (85)
    both = scheme.carry_sigma and not scheme.corrective and not scheme.nested
    enough = i > 0 or scheme.final != AFTER_CORRECTION
    if enough and norm < scheme.tolerance and (not both or scheme.slip < scheme.tolerance):
        return SETTLED
    slow = scheme.refresh > 0.0 and norm > scheme.refresh * last
    return STALE if slow or (i == 0 and scheme.fall < SINKING) else GO_ON


def begin_step(step):
    """Compute G0, and ``known``, the part of (74) that the end of the step does not change; set the plan and time."""
    scheme, kernel, terms, half = step.scheme, step.kernel, step.terms, 0.5 * step.control.h
    set_plan(step, step.control.h)
    for a in range(len(terms.nu)):
        terms.G0[a] = -scheme.use_f_bar * terms.f_bar0[a]
        if scheme.corrective:
            lam_bar = terms.lam0[a] - (scheme.xi * terms.phi0[a] if scheme.lambda_bar else 0.0)
            terms.G0[a] += terms.c_bar0[a] * terms.mu0[a] + terms.k_bar0[a] * lam_bar
    for b in range(len(kernel.mass)):
        v, f, out = step.v0[b], step.force0[b], step.known[b]
        p = multiply(kernel.J[b], v[3], v[4], v[5])
        L = multiply(step.R0[b], p[0] + half * f[3], p[1] + half * f[4], p[2] + half * f[5])
        for q in range(3):
            out[q], out[3 + q] = -kernel.mass[b] * v[q] - half * f[q], -L[q]
    kernel.t[0] = step.control.t
    run(step.begin)


def estimate(step):
    """Estimate velocities and nu at the end: extrapolated linearly from the last steps, or those of the start.

    The start is taken in the first step of a march, and in every step where ``extrapolate`` is 0.
    """
    scheme, terms = step.scheme, step.terms
    ratio = scheme.extrapolate * step.control.h / scheme.last if scheme.last > 0.0 else 0.0
    for i in range(step.v0.size):
        step.kernel.v.flat[i] = step.v0.flat[i] + ratio * (step.v0.flat[i] - step.v_old.flat[i])
    for a in range(len(terms.nu)):
        if scheme.keep_nu:
            terms.nu[a] = terms.nu_start[a] + ratio * terms.nu_change[a]
        else:
            terms.nu[a] = ratio * (terms.nu_old[a] + ratio * terms.nu_change[a])


def complete(step):
    """Compute the forces and the terms of suffix 1 from the poses and velocities of the kernel.

    These are phi, phi_dot, M_bar and f_bar and, if ``corrective``, C_bar and K_bar, with a negative K_bar of springs
    set to 0.
    """
    kernel, scheme, terms, c_R = step.kernel, step.scheme, step.terms, step.c_R
    run(kernel.applied_forces)
    run(step.measure)
    if scheme.by_forces:
        run(kernel.spring_slopes)
        run(step.direction)
    for a in range(len(terms.nu) if scheme.corrective else 0):
        by_rate, by_pose = 0.0, 0.0
        for e in range(2):
            for i in range(2):
                pair = step.couple[a, e, i]
                if scheme.by_forces and pair >= 0:
                    for q in range(6):
                        for p in range(6):
                            weight = c_R[e, a, q] * c_R[i, a, p]
                            by_rate -= weight * kernel.by_rate[pair, q, p]
                            by_pose -= weight * kernel.by_pose[pair, q, p]
        # a negative K_bar drives phi away exponentially
        terms.c_bar1[a] = by_rate + scheme.c_bar * terms.m_bar[a]
        terms.k_bar1[a] = max(by_pose, 0.0) + scheme.k_bar * terms.m_bar[a]


def evaluate(step):
    """Compute the residual of the present estimate of the end, and its norms ``norm`` (80) and ``slip`` (81) [sqrt(J)].

    (80): sqrt(R_v . M^-1 R_v + R_mu . M_bar R_mu), R_mu being (75) over M_bar; (81): sqrt(phi_dot . M_bar phi_dot).
    """
    scheme, kernel, terms, half = step.scheme, step.kernel, step.terms, 0.5 * step.control.h
    kernel.t[0] = step.control.t + step.control.h
    move_poses(step)
    run(step.complete)
    xi, by_lam = (scheme.xi, 2.0) if scheme.lambda_bar else (0.0, 1.0)  # nested: -xi dphi1 = dt/2 dmu1, too
    total, slip = 0.0, 0.0
    for a in range(len(terms.nu)):
        m_bar = terms.m_bar[a]
        slip += m_bar * terms.phi_dot1[a] * terms.phi_dot1[a]
        if scheme.nested:  # (84): mu - xi psi in place of mu
            terms.nu[a] = terms.nu_kept[a] - scheme.xi * m_bar * terms.phi_dot1[a]
        terms.G1[a] = -scheme.use_f_bar * terms.f_bar1[a]
        terms.dG[a], terms.on_phi_dot[a], terms.on_phi[a] = 0.0, 1.0, 0.0
        off = terms.phi_dot1[a]
        if scheme.carry_sigma:
            off -= terms.sigma0[a] / m_bar
        if scheme.corrective:
            mu1 = terms.nu[a] / m_bar
            lam1 = terms.lam0[a] + half * (terms.mu0[a] + mu1)  # (67)
            terms.G1[a] += terms.c_bar1[a] * mu1 + terms.k_bar1[a] * (lam1 - xi * terms.phi1[a])
            terms.dG[a] = (terms.c_bar1[a] + by_lam * half * terms.k_bar1[a]) / m_bar
            terms.on_phi_dot[a] = 1.0 + half * terms.c_bar1[a] / m_bar
            terms.on_phi[a] = half * terms.k_bar1[a] / m_bar
            before = terms.c_bar0[a] * terms.phi_dot0[a] + terms.k_bar0[a] * terms.phi0[a]
            after = terms.c_bar1[a] * terms.phi_dot1[a] + terms.k_bar1[a] * terms.phi1[a]
            off += half * (before + after) / m_bar
        terms.residual[a] = 0.0 if scheme.nested else off - terms.left[a]
        terms.on_D[a] = -terms.nu[a] - half * terms.G1[a]
        terms.on_D_dot[a] = step.plan.rate * terms.nu[a]
        terms.stiffness[a] = 1.0 + half * terms.dG[a]
        total += m_bar * terms.residual[a] * terms.residual[a]
    for b in range(len(kernel.mass)):
        v, f, out, w = kernel.v[b], kernel.force[b], step.residual[b], step.known[b]
        back, p = multiply_transposed(kernel.R[b], w[3], w[4], w[5]), multiply(kernel.J[b], v[3], v[4], v[5])
        for q in range(3):
            out[q] = w[q] + kernel.mass[b] * v[q] - half * f[q]
            out[3 + q] = back[q] - half * f[3 + q] + p[q]
    run(step.balance)
    for b in range(len(kernel.mass)):
        out = step.residual[b]
        turn = multiply(kernel.J_inv[b], out[3], out[4], out[5])
        for q in range(3):
            total += out[q] * out[q] / kernel.mass[b]
            total += out[3 + q] * turn[q]
    scheme.norm, scheme.slip = math.sqrt(total), math.sqrt(slip)
    step.control.residuals += 1


def assemble(step):
    """Assemble the matrix of Eq. (79) at the present estimate, the proximal saddle, in ``saddle``."""
    kernel, scheme, terms, half = step.kernel, step.scheme, step.terms, 0.5 * step.control.h
    K = step.saddle.bodies
    clear(K)
    for b in range(len(kernel.mass)):
        J, T, v, v0 = kernel.J[b], step.T[b], kernel.v[b], step.v0[b]
        set_dexp(half * (v0[3] + v[3]), half * (v0[4] + v[4]), half * (v0[5] + v[5]), half, T)
        p0, p1, p2 = multiply(J, v[3], v[4], v[5])
        for q in range(3):
            K[b, q, q] = kernel.mass[b]
            x, y, z = T[q], T[3 + q], T[6 + q]  # d(R J Omega) = R (J dOmega - J Omega x theta)
            K[b, 3, 3 + q] = J[0, q] - (p1 * z - p2 * y)
            K[b, 4, 3 + q] = J[1, q] - (p2 * x - p0 * z)
            K[b, 5, 3 + q] = J[2, q] - (p0 * y - p1 * x)
    run(step.slopes)
    for j in range(len(kernel.body)):
        first, n = kernel.row[j], kernel.row[j + 1] - kernel.row[j]
        for a in range(n):
            terms.softness[first + a] = 1.0 / (scheme.xi * terms.m_bar[first + a]) if scheme.active else 0.0
            step.saddle.joint[j, a * n + a] = terms.softness[first + a]
    if scheme.pushed:
        run(kernel.applied_slopes)
        for p in range(len(kernel.pair)):
            b = kernel.pair[p, 1]
            T, f, by_pose, by_rate = step.T[b], kernel.force[b], kernel.by_pose[p], kernel.by_rate[p]
            if b == kernel.pair[p, 0]:  # turned back after differentiation: R^T d(R torque) = d torque - torque x theta
                for q in range(3):
                    i, j = 3 + (q + 1) % 3, 3 + (q + 2) % 3
                    by_pose[i, j] += f[3 + q]
                    by_pose[j, i] -= f[3 + q]
            for a in range(6):
                x, y, z = by_pose[a, 3], by_pose[a, 4], by_pose[a, 5]
                for q in range(3):
                    K[p, a, q] -= half * (half * by_pose[a, q] + by_rate[a, q])
                    K[p, a, 3 + q] -= half * (x * T[q] + y * T[3 + q] + z * T[6 + q] + by_rate[a, 3 + q])


def refresh(step):
    """Assemble and factorise the matrix of Eq. (79) at the present estimate; ``lu.state.singular`` reports a failure.

    With a penalty, its determinant is monitored: the product of the constraint rows' |pivots| times M_bar, which is
    det(A M^-1 D' + (Xi M_bar)^-1) in scaled rows. Each redundant row gives a constant 1/xi; near a loss of rank the
    rest falls by the square of a singular value, whatever the elimination order.
    """
    scheme = step.scheme
    run(step.assemble)
    step.control.factorisations += 1
    run(step.factor_saddle)
    scheme.factored = 0.0 if step.lu.state.singular else step.control.h
    if scheme.active and scheme.xi == scheme.penalty:  # soft steps weigh the redundant rows differently
        total = 0.0
        for a in range(len(step.row_at)):
            total += math.log10(step.lu.pivot[step.row_at[a]] * step.terms.m_bar[a])
        scheme.fall = total - scheme.log_det
        scheme.log_det = total
        scheme.highest = max(scheme.highest, total)


def correct(step):
    """Apply Newton's correction (78) to velocities and nu, with the present factor.

    With redundant rows, away from a loss of rank, their part of the correction is removed first.
    """
    scheme, x = step.scheme, step.lu.x
    for i in range(len(step.body_at)):
        x[step.body_at[i]] = -step.residual.flat[i]
    for a in range(len(step.row_at)):
        x[step.row_at[a]] = -step.terms.residual[a]
    run(step.solve_saddle)
    step.control.solves += 1
    if scheme.redundant and not scheme.nested and scheme.log_det > scheme.highest - NEAR:
        run(step.leave_redundant)
    for i in range(len(step.body_at)):
        step.kernel.v.flat[i] += x[step.body_at[i]]
    for a in range(len(step.row_at)):
        step.terms.nu[a] += x[step.row_at[a]]
    step.control.iterations += 1


def leave_redundant(step):
    """Remove from a correction the nu of redundant rows, which A^T maps to zero; their residual goes to ``left``.

    Off the constraints, by phi = O(dt^3) within a step, such rows require velocities that do not exist. Each correction
    would raise their nu by xi phi_dot in vain, and (D0 + D1) nu = O(dt) nu would brake the motion. The saddle yields
    that part: with (Xi M_bar)^-1 dnu as the only right side it returns dnu where A^T dnu = 0, and almost nothing
    elsewhere. How little depends on xi, so this is repeated until it changes phi_dot by less than the tolerance.
    """
    terms, x, row_at = step.terms, step.lu.x, step.row_at
    copy(x, step.correction)
    for _ in range(MOST_PASSES):
        for a in range(len(row_at)):
            step.passed[a] = x[row_at[a]]
        clear(x)
        for a in range(len(row_at)):
            x[row_at[a]] = terms.softness[a] * step.passed[a]
        run(step.solve_saddle)
        step.control.solves += 1
        change = 0.0
        for a in range(len(row_at)):
            off = terms.softness[a] * (x[row_at[a]] - step.passed[a])
            change += terms.m_bar[a] * off * off
        if math.sqrt(change) < SMALL_LEAK * step.scheme.tolerance:
            break
    for a in range(len(row_at)):
        terms.left[a] -= terms.softness[a] * x[row_at[a]]
    for a in range(len(x)):
        x[a] = step.correction[a] - x[a]


def correct_pose(step):
    """Correct the poses of the end once with the present factor: to first order the least change onto phi = 0.

    With phi = O(dt^2) along the direction lost in a singular configuration the mechanism would miss it by sqrt(phi).
    """
    kernel, lu = step.kernel, step.lu
    clear(lu.x)
    for a in range(len(step.row_at)):
        lu.x[step.row_at[a]] = -step.terms.phi1[a]
    run(step.solve_saddle)
    for b in range(len(kernel.mass)):
        x = lu.x[lu.body_at[b] : lu.body_at[b] + 6]
        for q in range(3):
            kernel.r[b, q] += x[q]
        turn_rotation(kernel.R[b], x[3], x[4], x[5], kernel.R[b])
    step.control.solves += 1
    run(step.complete)


# entries, each after those that it runs
OPTIONAL = {leave_redundant: "redundant", correct_pose: "closes_pose"}  # and the settings in which they run
PARTS = (complete, evaluate, assemble, begin_step, estimate, refresh, leave_redundant, correct, correct_pose, keep_end)
