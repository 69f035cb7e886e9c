"""Extrapolation of ODE-GC's reversible step in even powers of h, error-controlled (compiled).

From one start, n = 1, 2, ..., K steps of H/n are taken; the changes y_n = (r - r0, log(R0^T R), v) at the end are
extrapolated by Aitken and Neville's scheme in H^2 (Hairer, Norsett, Wanner, Solving ODEs I, II.9): order 2 K, with the
error estimate T_KK - T_K,K-1 of order 2 K - 1. Each accepted step is projected onto phi = 0 and A v = 0.
"""

import math
from typing import Any

import numpy as np

from ....harness.mechanics.system import MultibodySystem
from ..compiled.algebra import copy, turn_rotation
from ..compiled.bundles import make_bundle, make_record
from ..compiled.entries import compile_inline, run
from ..compiled.host import Method
from ..compiled.kernel import Kernel
from .choices import Settings
from .gc_step import NEEDED, accept_step, begin_march, begin_step, find_end, make_step, refresh_factor, restart

# "Half" and "twice": tried on a free body, a pendulum, a top and a chain, each at rtol 1e-7 or 1e-8 and at 1e-3.
# [rad] largest turn in one step: its logarithm is unique below pi. Half rejects 2 more of a top's 25 steps at 1e-3;
# twice changes none.
WIDEST = 2.5
# share of a step that did not converge, up to which the next ones may grow; that limit's growth a step.
# At 1e-3 half of the first takes 5 to 8 % more iterations, twice up to 25 % more with five times the rejections; at
# 1e-8 neither changes one. Half of the second shortens steps until they underflow; twice is as twice of the first.
NEAR, FORGET = 0.7, 1.05

ARRAYS = {  # start of the whole step, accelerations and multipliers of index 1
    "r": "nb 3",
    "R": "nb 3 3",
    "v": "nb 6",
    "v_dot": "nb 6",
    "lam": "nr",
    "new": "12",
    "old": "12",
}


def make_extrapolated_method(system: MultibodySystem, choices: Settings, columns: int) -> Method:
    """Make the extrapolated method of order 2 ``columns``, for ``host.integrate``."""
    arrays = ARRAYS | {"table": f"{columns} nb 12"}  # last row of the scheme

    def prepare(kernel: Kernel, control: np.ndarray) -> Any:
        """Make the bundle of a step for this kernel and control."""
        step = make_step(system, kernel, control, choices)
        # [s] shortest step that lately did not converge; as asked
        memory = make_record(failed=math.inf, max_step=float(control["max_step"]))
        sizes = {"nb": len(kernel.mass), "nr": len(kernel.lam)}
        return make_bundle("Extrapolated", arrays, sizes, step=step, memory=memory)

    counters = ("rejected", "iterations", "factorisations")
    return Method(
        prepare,
        step,
        finish,
        start,
        order=2.0 * columns - 1.0,
        counters=counters,
        needs=() if choices.whole else NEEDED,
        code="mechanism" if choices.whole else "kernel",
    )


def start(m):
    """Compute acceleration and multipliers of index 1 at the start, and store the start for repetitions of the step."""
    begin_march(m.step)
    _store_start(m)


def step(m):
    """Compute the extrapolated end of a step of ``control.h`` in ``table``, and set ``control.error``.

    The error is infinite, and the step stored as failed, where an iteration does not converge or a body turns too far.
    """
    c = m.step.control
    c.error = _measure_error(m, c.rtol) if _extrapolate(m, c.h) else np.inf
    if not math.isfinite(c.error):
        m.memory.failed = c.h


def finish(m):
    """Set the kernel to the extrapolated end, projected onto the constraints, and store it as the next start.

    ``control.max_step`` becomes ``NEAR`` times the step that failed lately, a limit that grows by ``FORGET`` a step; it
    is at least half of this step, and at most what was asked.
    """
    k, c, best = m.step.kernel, m.step.control, m.table[len(m.table) - 1]
    for b in range(len(m.r)):
        for a in range(3):
            k.r[b, a] = m.r[b, a] + best[b, a]
        turn_rotation(m.R[b], best[b, 3], best[b, 4], best[b, 5], k.R[b])
        for a in range(6):
            k.v[b, a] = best[b, 6 + a]
    run(k.accelerate)
    run(k.project)
    run(k.accelerate)
    m.step.scheme.rank = refresh_factor(m.step)
    _store_start(m)
    c.max_step = min(m.memory.max_step, max(0.5 * c.h, NEAR * m.memory.failed))
    m.memory.failed *= FORGET


@compile_inline
def _store_start(m):
    """Store poses, velocities, accelerations and multipliers of the kernel as the start of the next step."""
    k = m.step.kernel
    copy(k.r, m.r)
    copy(k.R, m.R)
    copy(k.v, m.v)
    copy(k.v_dot, m.v_dot)
    copy(k.lam, m.lam)


@compile_inline
def _take_steps(m, H, n):
    """Take ``n`` steps of H / n [s] from the stored start, until one fails; return whether all converge."""
    s, k, h = m.step, m.step.kernel, H / n
    copy(m.r, k.r)
    copy(m.R, k.R)
    copy(m.v, k.v)
    restart(s, m.v_dot, m.lam)
    for i in range(n):
        middle = (i + 0.5) * h
        begin_step(s, h)
        if find_end(s, h, middle) < 0.0:
            return False
        accept_step(s, h, middle)
    return True


@compile_inline
def _find_change(m, b, out):
    """Set out (12,) := (r - r0, log(R0^T R), v) of body ``b``: its change of pose since the step's start, its velocity.

    Return whether the rotation is below ``WIDEST``.
    """
    k, R, cosine = m.step.kernel, m.R[b], -1.0
    for a in range(3):
        out[a] = k.r[b, a] - m.r[b, a]
        i, j = (a + 1) % 3, (a + 2) % 3
        x = 0.0  # entry (j, i) of R0^T R less entry (i, j): twice the sine times the axis
        for c in range(3):
            x += R[c, j] * k.R[b, c, i] - R[c, i] * k.R[b, c, j]
            cosine += R[c, a] * k.R[b, c, a]
        out[3 + a] = 0.5 * x
    sine = math.sqrt(out[3] ** 2 + out[4] ** 2 + out[5] ** 2)
    angle = math.atan2(sine, 0.5 * cosine)
    scale = angle / sine if sine > 1e-8 else 1.0
    for a in range(3):
        out[3 + a] *= scale
    for a in range(6):
        out[6 + a] = k.v[b, a]
    return angle < WIDEST


@compile_inline
def _extrapolate(m, H):
    """Compute the last row T_K,1 .. T_K,K of the scheme in ``table``, over H [s].

    Return whether all steps converge and no body turns too far.
    """
    for j in range(len(m.table)):
        if not _take_steps(m, H, j + 1):
            return False
        for b in range(len(m.r)):
            if not _find_change(m, b, m.new):
                return False
            for q in range(j + 1):  # ``new`` is T_j,q, and ``table`` has T_j-1,q still
                copy(m.table[q, b], m.old)
                copy(m.new, m.table[q, b])
                if q < j:
                    ratio = (j + 1.0) / (j - q)
                    for a in range(12):
                        m.new[a] += (m.new[a] - m.old[a]) / (ratio * ratio - 1.0)
    return True


@compile_inline
def _measure_error(m, rtol):
    """Return the step's error relative to its tolerance: the RMS of T_K,K - T_K,K-1 over ``rtol (1 + |y|)``.

    The tolerance of angles is ``rtol``.
    """
    total, K = 0.0, len(m.table)
    for b in range(len(m.r)):
        for a in range(12):
            best = m.table[K - 1, b, a]
            size = 1.0
            if a < 3:
                size += abs(m.r[b, a] + best)
            elif a >= 6:
                size += abs(best)
            total += ((best - m.table[K - 2, b, a]) / (rtol * size)) ** 2
    return math.sqrt(total / (12.0 * len(m.r)))
