"""March over the grid t = 0, dt, 2 dt, ...: every accepted step recorded, a step that fails is halved, then regrown.

A grid step is split in 2^level parts; ``pos`` parts are done. Level grows by one where Newton's method fails and falls
by one after a success at an even ``pos``, so the grid is met again exactly.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from .small import INNER, JIT
from .step import CONVERGED, LOOSE, accept, attempt, correct_pose

FINISHED, BUFFER_FULL, UNDERFLOW = 0, 1, 2


class Clock(NamedTuple):
    """Where the march stands."""

    grid: np.ndarray  # (3,) int: grid step, pos, level
    dt: float
    t_end: float
    max_level: int


class Record(NamedTuple):
    """Accepted steps of one call."""

    t: np.ndarray  # (room,)
    r: np.ndarray  # (room, nb, 3)
    R: np.ndarray  # (room, nb, 3, 3)
    v: np.ndarray  # (room, nb, 6)
    force: np.ndarray  # (room, nrows) mean over the step that ends here
    newton: np.ndarray  # (room,) corrections
    level: np.ndarray  # (room,)
    xi: np.ndarray  # (room,)
    log_det: np.ndarray  # (room,) ``Work.log_det``
    norm: np.ndarray  # (room, 2): (80), (81)


@njit(**INNER)
def fastest(m):
    """Largest |Omega| of all bodies [rad/s]."""
    square = 0.0
    for b in range(len(m.v)):
        square = max(square, m.v[b, 3] ** 2 + m.v[b, 4] ** 2 + m.v[b, 5] ** 2)
    return np.sqrt(square)


@njit(**JIT)
def time_of(clock):
    """Time of the last accepted step [s]; products, not sums, so rounding does not pile up."""
    base = clock.grid[0] * clock.dt
    length = min(clock.dt, clock.t_end - base)
    return base + length * (clock.grid[1] / 2.0 ** clock.grid[2])


@njit(**INNER)
def copy_motion(source, target):
    """target := source, field by field."""
    target.r[:] = source.r
    target.R[:] = source.R
    target.v[:] = source.v
    target.arm[:] = source.arm
    target.arm_dot[:] = source.arm_dot
    target.u[:] = source.u
    target.u_dot[:] = source.u_dot
    target.n[:] = source.n
    target.n_dot[:] = source.n_dot
    target.phi[:] = source.phi
    target.phi_dot[:] = source.phi_dot
    target.force[:] = source.force
    target.c[:] = source.c
    target.m_bar[:] = source.m_bar
    target.f_bar[:] = source.f_bar
    target.c_bar[:] = source.c_bar
    target.k_bar[:] = source.k_bar


@njit(**JIT)
def march(model, m0, m1, rows, history, settings, penalty, index, pattern, f, work, clock, record):
    """Steps until ``record`` is full, the end is reached, or the step would have to be cut too often."""
    current, other = m0, m1
    swapped = False
    done = 0
    outcome = FINISHED
    grid = clock.grid
    while True:
        base = grid[0] * clock.dt
        if base >= clock.t_end * (1.0 - 1e-14):
            break
        if done == len(record.t):
            outcome = BUFFER_FULL
            break
        length = min(clock.dt, clock.t_end - base)
        if clock.t_end - base - clock.dt < 1e-9 * clock.dt:  # no sliver of a last step
            length = clock.t_end - base
        dt = length / 2.0 ** grid[2]
        if fastest(current) * dt > work.max_turn[0] and grid[2] < clock.max_level:
            work.tally[4] += 1
            grid[1] *= 2
            grid[2] += 1
            continue
        corrections = work.tally[0]
        result = attempt(model, current, other, rows, history, dt, settings, penalty, index, pattern, f, work)
        if result != CONVERGED and result != LOOSE:
            work.held[0] = 0.0
            work.tally[4] += 1
            if grid[2] >= clock.max_level:
                outcome = UNDERFLOW
                break
            grid[1] *= 2
            grid[2] += 1
            continue
        if result == LOOSE:
            work.tally[6] += 1
            work.held[0] = 0.0
            if not penalty.nested:  # a step of the nested loop is loose when it runs out of augmentations, too
                work.max_turn[0] = min(work.max_turn[0], penalty.singular_turn)
        correct_pose(model, other, settings, penalty, pattern, f, work)
        accept(current, other, rows, history, dt, settings, record.force[done])
        record.level[done] = grid[2]
        grid[1] += 1
        while grid[2] > 0 and grid[1] % 2 == 0:
            grid[1] //= 2
            grid[2] -= 1
            if grid[1] % 2 == 1:
                break
        if grid[1] == 1 and grid[2] == 0:
            grid[0] += 1
            grid[1] = 0
        record.t[done] = base + length if grid[1] == 0 else base + length * (grid[1] / 2.0 ** grid[2])
        record.r[done] = other.r
        record.R[done] = other.R
        record.v[done] = other.v
        record.newton[done] = work.tally[0] - corrections
        record.xi[done] = work.xi[0]
        record.norm[done] = work.norm
        record.log_det[done] = work.log_det[0]
        done += 1
        current, other = other, current
        swapped = not swapped
    if swapped:
        copy_motion(current, m0)
    return outcome, done


def empty_record(room: int, nb: int, nrows: int) -> Record:
    """Room for ``room`` steps."""
    return Record(
        t=np.empty(room), r=np.empty((room, nb, 3)), R=np.empty((room, nb, 3, 3)), v=np.empty((room, nb, 6)),
        force=np.empty((room, nrows)), newton=np.zeros(room, dtype=np.int64), level=np.zeros(room, dtype=np.int64),
        xi=np.empty(room), log_det=np.empty(room), norm=np.empty((room, 2)),
    )  # fmt: skip
