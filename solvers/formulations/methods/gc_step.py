"""The step of ODE-GC by a simplified Newton method on S = A M^-1 A^T, for gravity as the only applied force (compiled).

Given v1 and nu1: poses by (66), impulses of (74) in space with nu0 = gauge nu1 + nu_start, B = dt/2::

    w   = P0 + dt f - dt/2 (D0 f_bar0 + D1 f_bar1) + (D1 - B D_dot1) nu1 - (D0 + B D_dot0) nu0
    v_n = M^-1 R1^T w,   S x = -A1 v_n,   nu1 += x / (1 - gauge),   v1 = v_n + M^-1 A1^T x

The method contracts by O(dt omega), and the change of v1 in the norm of M is the residual (80) before it. So a step is
done when the change is below the tolerance. S is factorised anew where the change falls too slowly; where that does not
help, or the rank of the rows differs from that at the start, the step does not converge. Redundant rows get no
multiplier: the motion is that of the proximal saddle.
"""

import math
from typing import Any

import numpy as np

from ....harness.mechanics.system import MultibodySystem
from ..compiled.algebra import clear, copy, multiply, multiply_transposed, turn_rotation
from ..compiled.bundles import make_bundle, make_record
from ..compiled.entries import BoundFunction, compile_inline, run
from ..compiled.kernel import Kernel
from ..compiled.mechanism import list_choice_arrays, make_choosing_program, make_mechanism_code
from ..compiled.row_choice import NEVER
from ..generated import Program
from .choices import DIAGNOSTICS, Settings
from .gc_wrenches import WrenchLoops

EARLY = 0.1  # replaces ``refresh``: by code a factor costs less than an iteration
DEPTH, DEEP = 4, 7  # past steps from which the next one is estimated: by loops over joints, by code
MOST = 30  # iterations a step: more help those that converge slowly, fewer end hopeless ones sooner
REFRESHES = 2  # factors of S in a step
ON_OTHER_ROWS = 8  # the same after rows were chosen anew: an estimate from other rows is farther off
PASSES = 2  # passes of the pose correction: the factor is that of the step's first estimate
NEEDED = ("rows", "factorise", "solve")  # entries that loops need; code has its own
SINKING = -0.05  # decades a step: a determinant that falls so fast may approach zero, and is computed in each step

ARRAYS = {  # suffix 0: the start of the step
    "u": "nb 6",  # r_dot, omega
    "load": "nb 6",
    "nu_start": "nr",
    "nu": "nr",
    "f_bar": "nr",
    "f_bar0": "nr",
    "slip": "nr",  # M_bar phi_dot^2
    "r0": "nb 3",
    "R0": "nb 3 3",
    "v0": "nb 6",
    "known": "nb 6",  # the part of w that the end does not change
    "acceleration": "depth nb 6",  # means over the last steps, in turn
    "impulse": "depth nr",  # (nu1 - nu0) / dt of these steps
    "middle": "depth",
    "share": "depth",  # [s] their middles; their weights in the estimate of the next step
    "found": "2",  # rank and log10 det S of the last factor
    "square": "1",  # [J] of the last change
}
ENTRIES = (
    "impulses",
    "rates",
    "loads",
    "start",  # entries of ``gc_wrenches``
    "begin",  # ``known``, ``f_bar0`` and other results of the start of a step
    "factor",  # S at the poses of the kernel, ``found``
    "iterate",  # v and nu at the poses of the kernel, ``square``
    "correct",  # poses onto phi = 0, with the factor at hand
)


def make_step(system: MultibodySystem, kernel: Kernel, control: np.ndarray, choices: Settings) -> Any:
    """Make the bundle of one step: its arrays, and entries by loops or by code; no step is taken."""
    nb, depth = len(kernel.mass), DEEP if choices.whole else DEPTH
    scheme = make_record(
        # log10 det S and its last change; steps known of the past, whether there is a factor, the rank of the rows at
        # the start, whether the next step has begun
        **choices.numbers(),
        log_det=0.0,
        fall=0.0,
        known=0,
        factored=0,
        rank=0,
        begun=0,
    )
    weight = system.mass[:, None] * system.gravity
    numbers = np.concatenate(
        (weight, system.mass[:, None], kernel.J_inv.reshape(nb, 9), kernel.J.reshape(nb, 9)), axis=1
    )
    step = make_bundle(
        "Step",
        ARRAYS,
        {"nb": nb, "nr": len(kernel.lam), "depth": depth},
        ENTRIES,
        control=control,
        kernel=kernel,
        scheme=scheme,
        diagnostics=np.zeros(len(DIAGNOSTICS)),
        plan=np.array([0.0, 0.0, choices.gauge]),
        numbers=numbers,
    )
    if choices.whole:
        return _set_code_entries(system, step, choices)
    loops = WrenchLoops(system, kernel)
    loops.step = step
    made = loops.entries(choices.direction, use_f_bar=bool(choices.use_f_bar))
    step = step._replace(start=made.pop("begin"), **made)
    correct = BoundFunction(correct_poses, kernel) if choices.closes_pose else Program([])
    return step._replace(
        begin=BoundFunction(begin_by_loops, step),
        factor=BoundFunction(factor_by_loops, step),
        iterate=BoundFunction(iterate_by_loops, step),
        correct=correct,
    )


def _set_code_entries(system: MultibodySystem, s: Any, choices: Settings) -> Any:
    """Return the step ``s`` with ``begin``, ``factor``, ``iterate`` and ``correct`` set to code for this mechanism.

    The code computes the same equations as the loops; its functions and the order of their arguments are those of
    ``rows.simplified_step``. ``iterate`` makes one simplified Newton step and copies v and nu back; ``correct`` moves
    the poses onto phi = 0 in ``PASSES`` passes, or does nothing without ``closes_pose``.
    ``s.scheme["refresh"]`` becomes ``EARLY`` in place, since by code a factor costs less than an iteration. With
    ``choices.active`` no rows are chosen anew: where kept rows become dependent, the proximal saddle takes over. Raises
    ``NoMechanismCode`` where the mechanism has no code.
    """
    k, names, given = s.kernel, ("gauge", "b_term", "direction", "use_f_bar", "keep_nu"), choices.numbers()
    s.scheme["refresh"] = EARLY
    if choices.active:
        k = k._replace(dense=k.dense[:0])
    bounds, shares = list_choice_arrays(k)
    code, _, (kept, size) = make_mechanism_code(system, k, "iterate", **{name: given[name] for name in names})
    start, factor, poses = np.zeros(kept), np.zeros(size), [k.t, k.r, k.R]
    moved, v, nu = [np.zeros_like(k.r), np.zeros_like(k.R)], np.zeros_like(k.v), np.zeros_like(s.nu)

    def program(*calls: tuple[str, list[np.ndarray]]) -> Program:
        return Program([(code.address(name), arrays) for name, arrays in calls], (code, k))

    correct = ("correct", [*poses, factor, *moved]), ("copy_poses", [*moved, *poses[1:]])
    return s._replace(
        begin=program(("begin", [k.t, s.plan, k.r, k.R, k.v, s.nu_start, s.known, start, s.slip, s.f_bar0])),
        factor=make_choosing_program(k, code, "factor", [*poses, *bounds, factor, s.found, *shares], poses),
        iterate=program(
            ("iterate", [k.t, s.plan, k.r, k.R, k.v, s.known, start, s.nu, factor, v, nu, s.square]),
            ("copy", [v, nu, k.v, s.nu]),
        ),
        correct=program(*correct * PASSES * choices.closes_pose),
    )


@compile_inline
def begin_march(s):
    """Prepare the first step: acceleration and multipliers of index 1 replace those of an earlier step.

    The rank of S there becomes that of the march.
    """
    run(s.kernel.accelerate)
    run(s.factor)
    s.scheme.rank = s.found[0]
    s.scheme.factored = 0
    restart(s, s.kernel.v_dot, s.kernel.lam)


@compile_inline
def refresh_factor(s):
    """Keep the factor of S that ``accelerate`` has made for the next step, or make it by code; return its rank."""
    s.scheme.factored = 1
    if s.scheme.whole:
        run(s.factor)
        return s.found[0]
    return float(s.kernel.state.rank)


@compile_inline
def restart(s, v_dot, lam):
    """Restart the estimate of the next step from ``v_dot`` and ``lam`` alone, as means of a step before it."""
    copy(v_dot, s.acceleration[0])
    copy(lam, s.impulse[0])
    s.scheme.known = 1
    s.middle[0] = 0.0


@compile_inline
def _spin(k, u):
    """Set u := (r_dot, R Omega), the velocities of ``k`` in space."""
    for b in range(len(k.mass)):
        omega = multiply(k.R[b], k.v[b, 3], k.v[b, 4], k.v[b, 5])
        for a in range(3):
            u[b, a], u[b, 3 + a] = k.v[b, a], omega[a]


@compile_inline
def move_poses(s):
    """Set the poses (66) at the end of the step from the velocities at both ends."""
    k, half = s.kernel, s.plan[0]
    for b in range(len(k.mass)):
        for a in range(3):
            k.r[b, a] = s.r0[b, a] + half * (s.v0[b, a] + k.v[b, a])
        turn_rotation(
            s.R0[b],
            half * (s.v0[b, 3] + k.v[b, 3]),
            half * (s.v0[b, 4] + k.v[b, 4]),
            half * (s.v0[b, 5] + k.v[b, 5]),
            k.R[b],
        )


@compile_inline
def begin_step(s, h):
    """Begin a step of h [s] at the state of the kernel: copy it, and compute what does not depend on the end."""
    k = s.kernel
    s.plan[0], s.plan[1] = 0.5 * h, 0.5 * h * s.scheme.b_term
    copy(k.r, s.r0)
    copy(k.R, s.R0)
    copy(k.v, s.v0)
    run(s.begin)


def begin_by_loops(s):
    """Compute the impulses ``known`` of a step, which do not depend on its end, by loops over joints."""
    k, h = s.kernel, 2.0 * s.plan[0]
    for b in range(len(k.mass)):
        v = k.v[b]
        p = multiply(k.J[b], v[3], v[4], v[5])
        L = multiply(k.R[b], p[0], p[1], p[2])
        for a in range(3):
            k.w[b, a], k.w[b, 3 + a] = k.mass[b] * v[a] + h * s.numbers[b, a], L[a]
    _spin(k, s.u)
    run(s.start)
    copy(s.f_bar, s.f_bar0)
    copy(k.w, s.known)


@compile_inline
def _estimate(s, h, t):
    """Estimate v1 and nu1 of a step of h [s].

    Accelerations and row forces of earlier steps are extrapolated to its middle, at ``t`` [s].
    """
    k, known = s.kernel, min(s.scheme.known, len(s.middle))
    for d in range(known):
        s.share[d] = h
        for c in range(known):
            if c != d:
                s.share[d] *= (t - s.middle[c]) / (s.middle[d] - s.middle[c])
    share = 1.0 / (1.0 - s.scheme.gauge)
    copy(s.v0, k.v)
    for a in range(len(s.nu)):
        s.nu[a] = share * s.nu_start[a]
    for d in range(known):
        weight = s.share[d]
        for a in range(k.v.size):
            k.v.flat[a] += weight * s.acceleration[d].flat[a]
        for a in range(len(s.nu)):
            s.nu[a] += share * weight * s.impulse[d, a]


@compile_inline
def _to_velocities(s):
    """Convert the impulses w to velocities, w := M^-1 R^T w; set ``u`` to these in space, and ``load`` to 0."""
    k = s.kernel
    for b in range(len(k.mass)):
        p = multiply_transposed(k.R[b], k.w[b, 3], k.w[b, 4], k.w[b, 5])
        Omega = multiply(k.J_inv[b], p[0], p[1], p[2])
        omega = multiply(k.R[b], Omega[0], Omega[1], Omega[2])
        for a in range(3):
            k.w[b, a] /= k.mass[b]
            s.load[b, a] = s.load[b, 3 + a] = 0.0
            k.w[b, 3 + a], s.u[b, a], s.u[b, 3 + a] = Omega[a], k.w[b, a], omega[a]


def factor_by_loops(s):
    """Factorise S at the poses of the kernel by loops; set ``found`` to its rank and the log10 of a determinant.

    The determinant is that of the kept rows of S, scaled to a unit diagonal.
    """
    k, total = s.kernel, 0.0
    run(k.rows)
    run(k.factorise)
    for col in range(len(k.blocks.joint)):
        for c in range(k.blocks.size[col]):
            inverse = k.L[k.blocks.start[col], c, c]
            if inverse > 0.0:
                total -= math.log10(inverse * inverse * k.diagonal[k.blocks.row[col] + c])
    s.found[0], s.found[1] = k.state.rank, total


@compile_inline
def _factor(s):
    """Factorise S at the poses of the kernel; return whether it has the rank of the march's start.

    nu of rows left out of the factor is set to zero.
    """
    run(s.factor)
    copy(s.nu, s.kernel.rhs)
    run(s.kernel.leave_out)
    copy(s.kernel.rhs, s.nu)
    s.control.factorisations += 1
    s.scheme.factored = 1
    s.scheme.fall = s.found[1] - s.scheme.log_det
    s.scheme.log_det = s.found[1]
    return s.found[0] == s.scheme.rank


def iterate_by_loops(s):
    """Correct v and nu of the end once by loops over joints; set ``square`` [J] to the square of the change of v."""
    k, share = s.kernel, 1.0 / (1.0 - s.scheme.gauge)
    _spin(k, s.u)
    copy(s.known, k.w)
    run(s.impulses)
    _to_velocities(s)
    run(s.rates)
    run(k.solve)
    for a in range(len(s.nu)):
        s.nu[a] += share * k.rhs[a]
    run(s.loads)
    s.square[0] = _take_velocities(s)


@compile_inline
def _take_velocities(s):
    """Set v := w + M^-1 R^T load; return the square of its change in the norm of M [J]."""
    k, total = s.kernel, 0.0
    for b in range(len(k.mass)):
        m = s.load[b]
        t = multiply_transposed(k.R[b], m[3], m[4], m[5])
        turn = multiply(k.J_inv[b], t[0], t[1], t[2])
        for a in range(3):
            x = k.w[b, a] + m[a] / k.mass[b]
            d = x - k.v[b, a]
            total += k.mass[b] * d * d
            k.v[b, a] = x
        d0, d1, d2 = k.w[b, 3] + turn[0], k.w[b, 4] + turn[1], k.w[b, 5] + turn[2]
        x, y, z = d0 - k.v[b, 3], d1 - k.v[b, 4], d2 - k.v[b, 5]
        k.v[b, 3], k.v[b, 4], k.v[b, 5] = d0, d1, d2
        p = multiply(k.J[b], x, y, z)
        total += x * p[0]
        total += y * p[1]
        total += z * p[2]
    return total


@compile_inline
def take_step(s, h, t):
    """Solve the step begun, of h [s] with its middle at t; return the last change of v1 [sqrt(J)].

    Return -1 where it does not converge, or where S has not the rank of the march's start.
    """
    g = s.scheme
    _estimate(s, h, t)
    change, before, refreshed = np.inf, np.inf, 0
    if g.fall < SINKING or g.rank < len(s.nu):
        # near a loss of rank, or with redundant rows, whose factor is exact at its own poses alone
        g.factored = 0
    for _ in range(MOST + 1):
        move_poses(s)
        if change < g.tolerance:
            return change
        if g.factored == 0:
            refreshed += 1
            if not _factor(s):
                return -1.0
        run(s.iterate)
        change = math.sqrt(s.square[0])
        s.control.iterations += 1
        s.control.residuals += 1
        s.control.solves += 1
        if not np.isfinite(change):
            return -1.0
        if change >= g.tolerance and change > g.refresh * before:
            most = REFRESHES if s.kernel.state.chosen == NEVER else ON_OTHER_ROWS
            if refreshed >= most and change > 0.5 * before:
                return -1.0
            if refreshed < most:
                g.factored = 0
        before = change
    return -1.0


@compile_inline
def accept_step(s, h, t):
    """Store the means of the step of h [s] just solved, with its middle at t, for the estimate of the next ones."""
    k = s.kernel
    s.scheme.known += 1
    d = (s.scheme.known - 1) % len(s.middle)
    for b in range(len(k.mass)):
        for a in range(6):
            s.acceleration[d, b, a] = (k.v[b, a] - s.v0[b, a]) / h
    for a in range(len(s.nu)):
        s.impulse[d, a] = ((1.0 - s.scheme.gauge) * s.nu[a] - s.nu_start[a]) / h
        if s.scheme.keep_nu:
            s.nu_start[a] = s.nu[a]
    s.middle[d] = t


def correct_poses(k):
    """Correct the poses by the least change, in the norm of M, that reduces phi to zero, with the present factor."""
    for _ in range(PASSES):
        run(k.rows)
        for a in range(len(k.rhs)):
            k.rhs[a] = -k.phi[a]
        run(k.solve)
        for a in range(len(k.rhs)):
            k.x[a] = k.rhs[a]
        clear(k.w)
        run(k.push)
        for b in range(len(k.mass)):
            for a in range(3):
                k.r[b, a] += k.w[b, a]
            turn_rotation(k.R[b], k.w[b, 3], k.w[b, 4], k.w[b, 5], k.R[b])
