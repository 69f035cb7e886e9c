"""The march of all methods: times of steps, error control, reversible control, recording (compiled).

At ``control.t`` [s] the step of a method tries ``control.h``. It sets ``status``, and ``error`` where that controls the
step size. Its finish follows an accepted step, and sets the state and ``lam`` to be recorded.

Reversible step control (Hairer and Soederlind 2005, SIAM J. Sci. Comput. 26)::

    h = dt / z,  z_(n+1/2) = z_(n-1/2) + dt G(y_n),  G = d/dt ln(1/s),  1/s = (1 + sum_b |Omega_b / rate|^4)^(1/4)

so that z follows 1/s, which is at least 1, and the backward motion takes the same steps. G takes the accelerations at
y_n.

A fixed step that fails is halved, up to ``most_cuts`` times, and grown back: a step of the grid 0, dt, 2 dt, ... is
split in 2^level parts, of which ``place`` are done. The level falls by one after a success at an even ``place``, so
that the grid points are met exactly. A step that fails leaves the kernel at its start.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from .algebra import copy, find_largest, orthogonalise_rotations
from .entries import compile_inline, run
from .kernel import Kernel

FULL, FINISHED, UNDERFLOW, NOT_FINITE, STUCK, TURNED = range(6)  # outcomes; a step's status is 0 or one of them
# change of step: the share of the longest step that the estimate allows, and the bounds of the change. On ten runs of
# rkmk_dopri5 half of the first takes 4 to 6 times the evaluations, all steps being shorter; twice takes 2 to 6 times as
# many, most steps being rejected. Half of the second changes none, twice brings one rejection. Half of the third takes
# up to 12 % more evaluations, as the first step is short, twice up to 7 % fewer.
SAFETY, LEAST, MOST = 0.9, 0.2, 5.0
SHORTEST = 1e-14  # share of the time below which a step no longer advances it

CONTROL = np.dtype(
    [
        (name, "f8")
        for name in (
            "t",
            "t_end",
            "h",
            "dt",
            "next_step",
            "max_step",
            "rtol",
            "order",
            "error",
            "last_error",
            "rate",
            "pace",
        )
    ]
    + [
        (name, "i8")
        for name in (
            "adaptive",
            "paced",
            "steps",
            "evaluations",
            "rejected",
            "iterations",
            "factorisations",
            "status",
            "outcome",
            "recorded",
            "grid",
            "place",
            "level",
            "most_cuts",
            "cuts",
            "residuals",
            "solves",
            "augmentations",
            "loose_steps",
        )
    ]
)


class Record(NamedTuple):
    """Accepted steps: times, poses, velocities, reactions and diagnostics."""

    t: Any  # (n,)
    r: Any  # (n, nb, 3)
    R: Any  # (n, nb, 3, 3)
    v: Any  # (n, nb, 6)
    lam: Any  # (n, nrows) in the kernel's order
    diagnostics: Any  # (n, n_diagnostics) diagnostics of the method for each


class March(NamedTuple):
    """The bundle of a march: control, kernel, record, diagnostics, and the entries of the step and its finish."""

    control: Any  # record
    kernel: Kernel
    record: Record
    diagnostics: Any  # (n_diagnostics,) diagnostics of the last step
    step: Any  # entry: a trial step
    finish: Any  # entry: after an accepted one


def make_control(**values: float) -> np.ndarray:
    """Make the record of a march's state and settings with these values, all others 0."""
    control = np.zeros((), dtype=CONTROL)
    for name, value in values.items():
        control[name] = value
    return control


def allocate_record(n: int, nb: int, nrows: int, n_diagnostics: int = 0) -> Record:
    """Make zero arrays for ``n`` steps of ``nb`` bodies, ``nrows`` constraint rows, ``n_diagnostics`` diagnostics."""
    return Record(
        np.zeros(n),
        np.zeros((n, nb, 3)),
        np.zeros((n, nb, 3, 3)),
        np.zeros((n, nb, 6)),
        np.zeros((n, nrows)),
        np.zeros((n, n_diagnostics)),
    )


def march(m):
    """March until the record is full, the end is reached or a step fails, and record every accepted step.

    ``m`` is a ``March``. ``control.outcome`` becomes the reason, ``control.recorded`` the number of steps recorded.
    """
    c, k, done = m.control, m.kernel, 0
    c.outcome = FULL
    while done < len(m.record.t):
        end = _next_end(c, k)
        if c.outcome != FULL:
            break
        c.status = 0
        run(m.step)
        if c.status != 0:
            c.cuts += 1
            if c.level < c.most_cuts:
                c.place *= 2
                c.level += 1
                continue
            c.outcome = c.status
            break
        if c.adaptive and not _accept_step(c):
            if c.outcome != FULL:
                break
            continue
        run(m.finish)
        if not np.isfinite(find_largest(k.v)):
            c.outcome = NOT_FINITE
            break
        if c.adaptive:
            _choose_next_step(c)
        else:
            _advance_on_grid(c)
        c.t = end
        c.steps += 1
        m.record.t[done] = end
        orthogonalise_rotations(k.R)
        copy(k.r, m.record.r[done])
        copy(k.R, m.record.R[done])
        copy(k.v, m.record.v[done])
        copy(k.lam, m.record.lam[done])
        copy(m.diagnostics, m.record.diagnostics[done])
        done += 1
    c.recorded = done


@compile_inline
def _next_end(c, k):
    """Set ``c.h`` [s] to the step to try, by the error, on the fixed grid or by reversible control; return its end [s].

    ``c`` is the control, ``k`` the kernel. ``c.outcome`` becomes FINISHED at the end of the march, or UNDERFLOW where
    an adaptive step is too short to advance time.
    """
    if c.adaptive:
        t, h, left = c.t, min(c.next_step, c.max_step), c.t_end - c.t
        if left <= SHORTEST * max(abs(t), 1e-300):
            c.outcome = FINISHED
        if h >= left * (1.0 - 1e-12):
            c.h = left
            return c.t_end
        if 2.0 * h > left:
            h = 0.5 * left  # two even steps instead of one and a sliver
        if h < SHORTEST * max(abs(t), c.t_end * SHORTEST):
            c.outcome = UNDERFLOW
        c.h = h
        return t + h
    if c.rate == 0.0:
        base = c.grid * c.dt
        left = c.t_end - base
        if left <= 1e-9 * c.dt:
            c.outcome = FINISHED
            return c.t_end
        whole = left if left < (1.0 + 1e-9) * c.dt else c.dt  # no sliver of a last step
        parts = 1 << c.level
        part = whole / parts
        c.t, c.h = base + c.place * part, part
        if c.place + 1 < parts:
            return base + (c.place + 1) * part
        return c.t_end if whole == left else (c.grid + 1) * c.dt
    end = _advance_pace(c, k)
    if not end > c.t:
        c.outcome = FINISHED
    c.h = end - c.t
    return end


@compile_inline
def _advance_on_grid(c):
    """Count one part of a step of the fixed grid as done; while ``place`` is then even, parts double in length."""
    c.place += 1
    while c.level > 0 and c.place % 2 == 0:
        c.place //= 2
        c.level -= 1
    if c.place == 1 and c.level == 0:
        c.grid += 1
        c.place = 0


@compile_inline
def _advance_pace(c, k):
    """Advance z = dt / h (``c.pace``) of reversible step control; return the time [s] at which the next step ends.

    At the end of the march the present time is returned. A step is at most ten times dt.
    """
    fourth, power = c.rate**4, 0.0
    for b in range(len(k.v)):
        w0, w1, w2 = k.v[b, 3], k.v[b, 4], k.v[b, 5]
        square = w0 * w0 + w1 * w1 + w2 * w2
        power += square * (w0 * k.v_dot[b, 3] + w1 * k.v_dot[b, 4] + w2 * k.v_dot[b, 5])
        fourth += square * square
    G = power / fourth
    if c.paced:
        c.pace += c.dt * G
    else:
        c.paced = 1
        c.pace = fourth**0.25 / c.rate + 0.5 * c.dt * G
    if c.t >= c.t_end:
        return c.t
    h = c.dt / max(c.pace, 0.1)
    # a remainder of a hundredth of a step is added to the last one
    return c.t_end if c.t + 1.01 * h >= c.t_end else c.t + h


@compile_inline
def _accept_step(c):
    """Return whether the step's error is at most 1; if not, count a rejection and shorten the next try.

    Where the next try would be too short, ``c.outcome`` becomes UNDERFLOW, or NOT_FINITE if the error is not finite.
    """
    if c.error <= 1.0:
        return True
    c.rejected += 1
    finite = math.isfinite(c.error)
    cut = max(LEAST, SAFETY * c.error ** (-1.0 / c.order)) if finite else LEAST
    c.next_step = c.h * min(cut, 0.9)
    if c.next_step < SHORTEST * max(c.t, c.t_end * 1e-6):
        c.outcome = UNDERFLOW if finite else NOT_FINITE
    return False


@compile_inline
def _choose_next_step(c):
    """Set the next step from the errors of this step and the last (PI controller), within ``LEAST`` and ``MOST``."""
    grow = SAFETY * max(c.error, 1e-10) ** (-0.7 / c.order) * c.last_error ** (0.4 / c.order)
    c.next_step = c.h * min(MOST, max(LEAST, grow))
    c.last_error = max(c.error, 1e-4)
