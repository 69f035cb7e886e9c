"""The step of ODE-GC by a simplified Newton method on S = A M^-1 A^T, for gravity as the only applied force (compiled).

Given v1 and nu1: poses by (66), impulses of (74) in space with nu0 = gauge nu1 + nu_start, B = dt/2::

    w   = P0 + dt f - dt/2 (D0 f_bar0 + D1 f_bar1) + (D1 - B D_dot1) nu1 - (D0 + B D_dot0) nu0
    v_n = M^-1 R1^T w,   S x = -A1 v_n,   nu1 += x / (1 - gauge),   v1 = v_n + M^-1 A1^T x

The method contracts by O(dt omega), and the change of v1 in the norm of M is the residual (80) that was there before.
So a step is done when the change is below the tolerance. S is factored anew where the change falls too slowly; where
that does not help, or the rank of the rows is not that of the start, the step does not converge. Redundant rows get no
multiplier: the motion is that of the proximal saddle.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from ....harness.mechanics.system import MultibodySystem
from ..compiled.algebra import copy, turned_by
from ..compiled.entries import inner, run
from ..compiled.evaluation import times_inverse_mass
from ..compiled.kernel import Kernel
from .gc_wrenches import make_wrenches

DEPTH = 4  # past steps from which the next one is extrapolated
MOST = 30  # iterations a step
REFRESHES = 2  # factors of S in a step
SINKING = -0.05  # decades: a determinant that falls so fast may be on its way to zero, and is watched step by step
ALONG_A, ALONG_MASS, TRANSLATION = range(3)  # c of Eq. (31): a/(a . a), M^-1 a/(a . M^-1 a), (e_k, 0)

SCHEME = np.dtype(
    [(name, "f8") for name in ("gauge", "b_term", "tolerance", "refresh", "log_det", "fall")]
    + [(name, "i8") for name in ("direction", "use_f_bar", "keep_nu", "known", "factored", "rank")]
)


class Step(NamedTuple):
    """Scheme and room of one step; suffix 0: its start."""

    control: Any
    kernel: Kernel
    scheme: Any  # record: the free choices; log10 det S and its last change; steps known of the past, whether there is
    # a factor, the rank of the rows at the start
    wrenches0: int  # entry: w += D0 x0 + D_dot0 y0
    wrenches1: int  # entry: w += D1 x1 + D_dot1 y1
    weight: Any  # (nb, 3) m g
    r0: Any  # (nb, 3)
    R0: Any  # (nb, 3, 3)
    v0: Any  # (nb, 6)
    known: Any  # (nb, 6) the part of w that the end does not change
    x0: Any  # (nrows,)
    y0: Any
    x1: Any
    y1: Any
    f_bar0: Any  # (nrows,) Eq. (30)
    f_bar: Any
    nu: Any
    nu_start: Any
    acceleration: Any  # (DEPTH, nb, 6) means over the last steps, in turn
    impulse: Any  # (DEPTH, nrows) (nu1 - nu0) / dt of these steps
    middle: Any  # (DEPTH,) [s] their middles
    share: Any  # (DEPTH,) theirs in the estimate of the next step


class Made(NamedTuple):
    """A step's bundle, and what keeps its entries alive."""

    step: Step
    keeps: tuple[Any, ...]


def make_step(system: MultibodySystem, kernel: Kernel, control: np.ndarray, **choices: float) -> Made:
    """Arrays of one step; ``choices`` are fields of ``SCHEME``."""
    nb, nr = len(kernel.mass), len(kernel.lam)
    scheme = np.zeros((), dtype=SCHEME)
    for name, value in choices.items():
        scheme[name] = value
    r0, R0, v0 = np.zeros((nb, 3)), np.zeros((nb, 3, 3)), np.zeros((nb, 6))
    x0, y0, x1, y1 = (np.zeros(nr) for _ in range(4))
    start = make_wrenches(system, kernel, (r0, R0, v0), x0, y0, kernel.w)
    end = make_wrenches(system, kernel, (kernel.r, kernel.R, kernel.v), x1, y1, kernel.w)
    step = Step(
        control, kernel, scheme, start.entry, end.entry, system.mass[:, None] * system.gravity, r0, R0, v0,
        np.zeros((nb, 6)), x0, y0, x1, y1, *(np.zeros(nr) for _ in range(4)), np.zeros((DEPTH, nb, 6)),
        np.zeros((DEPTH, nr)), np.zeros(DEPTH), np.zeros(DEPTH),
    )  # fmt: skip
    return Made(step, (start, end))


@inner
def begin_march(s):
    """Acceleration and multipliers of index 1 at the start stand for a step before the first."""
    run(s.kernel.accelerate)
    s.scheme.rank = s.kernel.state.rank
    take_past(s, s.kernel.v_dot, s.kernel.lam)
    s.scheme.factored = 0
    find_f_bar(s)


@inner
def take_past(s, v_dot, lam):
    """One step of the past alone, with these means."""
    copy(v_dot, s.acceleration[0])
    copy(lam, s.impulse[0])
    s.scheme.known = 1
    s.middle[0] = 0.0


@inner
def find_f_bar(s):
    """Eq. (30) with gravity, at the rows of ``k``."""
    if not s.scheme.use_f_bar:
        return
    k = s.kernel
    for j in range(len(k.body)):
        for a in range(k.row[j], k.row[j + 1]):
            size = force = 0.0
            for e in range(2):
                b, sign = k.body[j, e], 1.0 - 2.0 * e
                if b < 0 or (s.scheme.direction == TRANSLATION and e == 1):
                    continue
                f, x, y = k.way[a], k.X[e, a], k.Y[e, a]
                square = f[0] * f[0] + f[1] * f[1] + f[2] * f[2]
                pull = sign * (f[0] * s.weight[b, 0] + f[1] * s.weight[b, 1] + f[2] * s.weight[b, 2])
                if s.scheme.direction == ALONG_A:
                    size += square + x[0] * x[0] + x[1] * x[1] + x[2] * x[2]
                    force += pull
                elif s.scheme.direction == ALONG_MASS:
                    size += square / k.mass[b] + x[0] * y[0] + x[1] * y[1] + x[2] * y[2]
                    force += pull / k.mass[b]
                else:
                    size, force = 1.0, pull
            s.f_bar[a] = force / size


@inner
def move_poses(s, h):
    """Poses (66) of the end from its velocities."""
    k, half = s.kernel, 0.5 * h
    for b in range(len(k.mass)):
        for a in range(3):
            k.r[b, a] = s.r0[b, a] + half * (s.v0[b, a] + k.v[b, a])
        turned_by(
            s.R0[b], half * (s.v0[b, 3] + k.v[b, 3]), half * (s.v0[b, 4] + k.v[b, 4]), half * (s.v0[b, 5] + k.v[b, 5]),
            k.R[b],
        )  # fmt: skip


@inner
def _begin(s, h):
    """The start of a step of h from ``k``, whose f_bar is at hand."""
    k = s.kernel
    copy(k.r, s.r0)
    copy(k.R, s.R0)
    copy(k.v, s.v0)
    copy(s.f_bar, s.f_bar0)
    for b in range(len(k.mass)):
        v, J = k.v[b], k.J[b]
        l0 = J[0, 0] * v[3] + J[0, 1] * v[4] + J[0, 2] * v[5]
        l1 = J[1, 0] * v[3] + J[1, 1] * v[4] + J[1, 2] * v[5]
        l2 = J[2, 0] * v[3] + J[2, 1] * v[4] + J[2, 2] * v[5]
        for a in range(3):
            k.w[b, a] = k.mass[b] * v[a] + h * s.weight[b, a]
            k.w[b, 3 + a] = k.R[b, a, 0] * l0 + k.R[b, a, 1] * l1 + k.R[b, a, 2] * l2
    for a in range(len(s.x0)):
        s.x0[a], s.y0[a] = -0.5 * h * s.f_bar[a], 0.0
    run(s.wrenches0)
    copy(k.w, s.known)


@inner
def _estimate(s, h, t):
    """v1 and nu1 with acceleration and row forces extrapolated to the middle of the step, at ``t``."""
    k, known = s.kernel, min(s.scheme.known, DEPTH)
    for d in range(known):
        s.share[d] = h
        for c in range(known):
            if c != d:
                s.share[d] *= (t - s.middle[c]) / (s.middle[d] - s.middle[c])
    for b in range(len(k.mass)):
        for a in range(6):
            x = s.v0[b, a]
            for d in range(known):
                x += s.share[d] * s.acceleration[d, b, a]
            k.v[b, a] = x
    for a in range(len(s.nu)):
        x = s.nu_start[a]
        for d in range(known):
            x += s.share[d] * s.impulse[d, a]
        s.nu[a] = x / (1.0 - s.scheme.gauge)


@inner
def _find_impulses(s, h):
    """w of the present estimate, then velocities v_n; rows are those of its poses."""
    k, B = s.kernel, 0.5 * h * s.scheme.b_term
    move_poses(s, h)
    run(k.rows)
    find_f_bar(s)
    for a in range(len(s.nu)):
        nu0 = s.scheme.gauge * s.nu[a] + s.nu_start[a]
        s.x0[a], s.y0[a] = -nu0, -B * nu0
        s.x1[a], s.y1[a] = s.nu[a] - 0.5 * h * s.f_bar[a], -B * s.nu[a]
    copy(s.known, k.w)
    run(s.wrenches0)
    run(s.wrenches1)


@inner
def _to_velocities(k):
    """w := M^-1 R^T w"""
    for b in range(len(k.mass)):
        R, x, y, z = k.R[b], k.w[b, 3], k.w[b, 4], k.w[b, 5]
        for a in range(3):
            k.w[b, 3 + a] = R[0, a] * x + R[1, a] * y + R[2, a] * z
    times_inverse_mass(k.mass, k.J_inv, k.w)


@inner
def _factor(s):
    """S at the poses of ``k``, whose rows are at hand; returns whether it has the rank of the start."""
    k, total = s.kernel, 0.0
    run(k.factorise)
    s.control.factorisations += 1
    s.scheme.factored = 1
    for col in range(len(k.blocks.joint)):
        for c in range(k.blocks.size[col]):
            inverse = k.L[k.blocks.start[col], c, c]
            if inverse > 0.0:
                total -= math.log10(inverse * inverse * k.diagonal[k.blocks.row[col] + c])
    s.scheme.fall = total - s.scheme.log_det
    s.scheme.log_det = total
    return k.state.rank == s.scheme.rank


@inner
def _take_velocities(k):
    """v := w; the square of the change in the norm of M [J]."""
    total = 0.0
    for b in range(len(k.mass)):
        d0, d1, d2 = k.w[b, 0] - k.v[b, 0], k.w[b, 1] - k.v[b, 1], k.w[b, 2] - k.v[b, 2]
        total += k.mass[b] * (d0 * d0 + d1 * d1 + d2 * d2)
        d0, d1, d2 = k.w[b, 3] - k.v[b, 3], k.w[b, 4] - k.v[b, 4], k.w[b, 5] - k.v[b, 5]
        J = k.J[b]
        total += d0 * (J[0, 0] * d0 + J[0, 1] * d1 + J[0, 2] * d2)
        total += d1 * (J[1, 0] * d0 + J[1, 1] * d1 + J[1, 2] * d2)
        total += d2 * (J[2, 0] * d0 + J[2, 1] * d1 + J[2, 2] * d2)
    copy(k.w, k.v)
    return total


@inner
def take_step(s, h, t):
    """One step of h whose middle is at t: the last change of v1 [sqrt(J)], or -1 where it does not converge."""
    k, g = s.kernel, s.scheme
    _begin(s, h)
    _estimate(s, h, t)
    before, refreshed = np.inf, 0
    if g.fall < SINKING:  # on its way to a loss of rank: seen step by step
        g.factored = 0
    for _ in range(MOST):
        _find_impulses(s, h)
        if g.factored == 0:
            refreshed += 1
            if not _factor(s):
                return -1.0
        _to_velocities(k)
        run(k.slips)
        copy(k.x, k.rhs)
        run(k.solve)
        for a in range(len(s.nu)):
            s.nu[a] += k.rhs[a] / (1.0 - g.gauge)
        copy(k.rhs, k.x)
        run(k.push)
        change = math.sqrt(_take_velocities(k))
        s.control.iterations += 1
        if not np.isfinite(change):
            return -1.0
        if change < g.tolerance:
            return change
        if change > g.refresh * before:
            if refreshed == REFRESHES and change > 0.5 * before:
                return -1.0
            if refreshed < REFRESHES:
                g.factored = 0
        before = change
    return -1.0


@inner
def accept_step(s, h, t):
    """The step of h just made, its middle at t, becomes the past: its means, for the estimate of those that follow."""
    k = s.kernel
    s.scheme.known += 1
    d = (s.scheme.known - 1) % DEPTH
    for b in range(len(k.mass)):
        for a in range(6):
            s.acceleration[d, b, a] = (k.v[b, a] - s.v0[b, a]) / h
    run(k.rows)
    find_f_bar(s)
    for a in range(len(s.nu)):
        s.impulse[d, a] = ((1.0 - s.scheme.gauge) * s.nu[a] - s.nu_start[a]) / h
        if s.scheme.keep_nu:
            s.nu_start[a] = s.nu[a]
    s.middle[d] = t
