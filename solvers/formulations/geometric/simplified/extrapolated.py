"""Extrapolation of ODE-GC's reversible step in even powers of h, error-controlled (compiled).

From one start, n = 1, 2, ..., K steps of H/n; changes y_n = (r - r0, log(R0^T R), v) of the end in Aitken and Neville's
scheme in H^2 (Hairer, Norsett, Wanner, Solving ODEs I, II.9): order 2 K, estimate T_KK - T_K,K-1 of order 2 K - 1. Each
accepted step is projected onto phi = 0 and A v = 0.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from ..arrays import Model
from ..choices import Settings
from ..index1.kernel import HOT, Kernel, accelerate, project
from ..index1.rkmk import FINISHED, FULL, LEAST, MOST, NOT_FINITE, SAFETY, SHORTEST, UNDERFLOW, keep
from ..newton import COUNTERS, NEWTON
from ..vectors import JIT, ONCE, copy, turned_by
from .march import accept
from .march import start as begin
from .rows import arms
from .state import Lean, empty_lean
from .step import one_step, poses

WIDEST = 2.5  # [rad] of a turn in one step: its logarithm is unique below pi
NEAR, FORGET = 0.7, 1.05  # of a step that did not converge: how close the next ones come, and its growth a step


class Scheme(NamedTuple):
    """The step's choices, and K."""

    settings: Settings
    columns: int


class Step(NamedTuple):
    """Room for one step."""

    lean: Lean
    counts: np.ndarray
    r: np.ndarray  # (nb, 3) start
    R: np.ndarray  # (nb, 3, 3)
    v: np.ndarray  # (nb, 6)
    v_dot: np.ndarray  # (nb, 6) of index 1 there
    lam: np.ndarray  # (nrows,)
    table: np.ndarray  # (K, nb, 12) last row of the scheme
    work: np.ndarray  # (nb, 6)
    entry: np.ndarray  # (2, 12) of the scheme
    failed: np.ndarray  # (1,) [s] shortest step that lately did not converge


def empty_step(model: Model, columns: int) -> Step:
    """Arrays of one step."""
    nb = len(model.mass)
    return Step(
        empty_lean(model), np.zeros(len(COUNTERS), dtype=np.int64), np.zeros((nb, 3)), np.zeros((nb, 3, 3)),
        np.zeros((nb, 6)), np.zeros((nb, 6)), np.zeros(int(model.row[-1])), np.zeros((columns, nb, 12)),
        np.zeros((nb, 6)), np.zeros((2, 12)), np.full(1, np.inf),
    )  # fmt: skip


def start(k: Kernel, step: Step) -> None:
    """Poses and velocities of ``k``, acceleration and multipliers of index 1."""
    mine = step.lean.k
    mine.r[:], mine.R[:], mine.v[:] = k.r, k.R, k.v
    begin(step.lean)
    _remember(step)


@njit(**JIT)
def _remember(step):
    """A step starts where ``lean.k`` stands."""
    k = step.lean.k
    copy(k.r, step.r)
    copy(k.R, step.R)
    copy(k.v, step.v)
    copy(k.v_dot, step.v_dot)
    copy(k.lam, step.lam)


@njit(**ONCE)
def _attempt(step, settings, H, n):
    """n steps of H / n from the start; whether all converge."""
    lean, h = step.lean, H / n
    copy(step.r, lean.k.r)
    copy(step.R, lean.k.R)
    copy(step.v, lean.k.v)
    copy(step.v_dot, lean.acceleration[0])
    copy(step.lam, lean.impulse[0])
    lean.past[0], lean.middle[0] = 1, 0.0
    arms(lean, settings)
    for i in range(n):
        middle = (i + 0.5) * h
        if one_step(lean, settings, h, middle, step.counts) < 0.0:
            return False
        poses(lean, h)
        accept(lean, settings, h, middle)
    return True


@njit(**HOT)
def _change(step, b, out):
    """out (12,) := (r - r0, log(R0^T R), v) of body b; whether the turn is below ``WIDEST``."""
    k, R = step.lean.k, step.R[b]
    for a in range(3):
        out[a] = k.r[b, a] - step.r[b, a]
        i, j = (a + 1) % 3, (a + 2) % 3
        x = 0.0  # entry (j, i) of R0^T R less entry (i, j): twice the sine times the axis
        for c in range(3):
            x += R[c, j] * k.R[b, c, i] - R[c, i] * k.R[b, c, j]
        out[3 + a] = 0.5 * x
    cosine = -1.0
    for a in range(3):
        for c in range(3):
            cosine += R[c, a] * k.R[b, c, a]
    sine = math.sqrt(out[3] ** 2 + out[4] ** 2 + out[5] ** 2)
    angle = math.atan2(sine, 0.5 * cosine)
    scale = angle / sine if sine > 1e-8 else 1.0
    for a in range(3):
        out[3 + a] *= scale
    for a in range(6):
        out[6 + a] = k.v[b, a]
    return angle < WIDEST


@njit(**ONCE)
def _extrapolate(step, settings, H, columns):
    """The scheme's last row T_K,1 .. T_K,K into ``table``; whether all steps converge."""
    table, new, old = step.table, step.entry[0], step.entry[1]
    for j in range(columns):
        if not _attempt(step, settings, H, j + 1):
            return False
        for b in range(len(step.r)):
            if not _change(step, b, new):
                return False
            for m in range(j + 1):  # ``new`` is T_j,m, and ``table`` has T_j-1,m still
                for a in range(12):
                    old[a] = table[m, b, a]
                    table[m, b, a] = new[a]
                if m < j:
                    ratio = (j + 1.0) / (j - m)
                    for a in range(12):
                        new[a] += (new[a] - old[a]) / (ratio * ratio - 1.0)
    return True


@njit(**ONCE)
def _error(step, columns, rtol):
    """RMS of the last correction over ``rtol (1 + |y|)``; angles over ``rtol``."""
    total = 0.0
    for b in range(len(step.r)):
        for a in range(12):
            best = step.table[columns - 1, b, a]
            size = 1.0
            if a < 3:
                size += abs(step.r[b, a] + best)
            elif a >= 6:
                size += abs(best)
            total += ((best - step.table[columns - 2, b, a]) / (rtol * size)) ** 2
    return math.sqrt(total / (12.0 * len(step.r)))


@njit(**JIT)
def march(model, blocks, k, step, s, control, record):
    """Steps until the record is full or the end is reached; returns (outcome, steps recorded)."""
    done, K, lean = 0, s.columns, step.lean
    while done < len(record.t):
        t, h = control.clock[0], min(control.clock[1], control.max_step)
        left = control.t_end - t
        if left <= SHORTEST * max(abs(t), 1e-300):
            return FINISHED, done
        if h >= left * (1.0 - 1e-12):
            h = left
        elif 2.0 * h > left:
            h = 0.5 * left  # two even steps instead of one and a sliver
        if h < SHORTEST * max(abs(t), control.t_end * 1e-6):
            return UNDERFLOW, done
        converges = _extrapolate(step, s.settings, h, K)
        error = _error(step, K, control.rtol) if converges else np.inf
        if not error <= 1.0:
            control.tally[1] += 1
            if not converges:
                step.failed[0] = h
            cut = max(LEAST, SAFETY * error ** (-1.0 / control.order)) if math.isfinite(error) else 0.5
            control.clock[1] = h * min(cut, 0.9)
            continue
        for b in range(len(step.r)):
            y = step.table[K - 1, b]
            for a in range(3):
                lean.k.r[b, a] = step.r[b, a] + y[a]
            turned_by(step.R[b], (y[3], y[4], y[5]), lean.k.R[b])
            for a in range(6):
                lean.k.v[b, a] = y[6 + a]
        accelerate(model, lean.blocks, lean.k)
        project(model, lean.blocks, lean.k, step.work)
        lean.rank[0] = accelerate(model, lean.blocks, lean.k)
        lean.past[1] = 1
        keep(lean.k, lean.k.lam, record, done)
        _remember(step)
        if not np.isfinite(lean.k.v[0, 0]):
            return NOT_FINITE, done
        grown = h * min(MOST, max(LEAST, SAFETY * max(error, 1e-10) ** (-1.0 / control.order)))
        if grown >= step.failed[0]:
            grown = min(grown, max(0.5 * h, NEAR * step.failed[0]))
            step.failed[0] *= FORGET
        control.clock[0] = control.t_end if h == left else t + h
        control.clock[1] = grown
        control.tally[0] = step.counts[NEWTON]
        record.t[done] = control.clock[0]
        done += 1
    return FULL, done
