"""March over the grid t = 0, dt, 2 dt, ...: every accepted step recorded, a step that fails is halved, then regrown.

A grid step is split in 2^level parts; ``pos`` parts are done. Level grows by one where Newton's method fails and falls
by one after a success at an even ``pos``, so the grid is met again exactly.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from .arrays import Step
from .newton import CONVERGED, CUTS, LOOSE, LOOSE_STEPS, NEWTON
from .step import accept, attempt, correct_pose, fastest_square
from .vectors import INNER, JIT, close_rotations, copy

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
    reaction: np.ndarray  # (room, nrows) mean over the step that ends here
    newton: np.ndarray  # (room,) corrections
    level: np.ndarray  # (room,)
    xi: np.ndarray  # (room,)
    log_det: np.ndarray  # (room,) ``Work.log_det``
    norm: np.ndarray  # (room, 2): (80), (81)


@njit(**JIT)
def time_of(clock):
    """Time of the last accepted step [s]; products, not sums, so rounding does not pile up."""
    base = clock.grid[0] * clock.dt
    length = min(clock.dt, clock.t_end - base)
    return base + length * (clock.grid[1] / 2.0 ** clock.grid[2])


@njit(**INNER)
def _cut(grid, counts):
    grid[1] *= 2
    grid[2] += 1
    counts[CUTS] += 1


@njit(**INNER)
def _advance(grid):
    """One part done; at an even place the parts grow."""
    grid[1] += 1
    while grid[2] > 0 and grid[1] % 2 == 0:
        grid[1] //= 2
        grid[2] -= 1
    if grid[1] == 1 and grid[2] == 0:
        grid[0] += 1
        grid[1] = 0


@njit(**JIT)
def march(run, step, clock, record):
    """Steps until ``record`` is full, the end is reached, or the step would have to be cut too often.

    Returns the outcome and the number of steps recorded; each of them swaps the start and the end of ``step``.
    """
    work, penalty, grid = run.work, run.settings.penalty, clock.grid
    start, end = step.start, step.end
    done = 0
    while True:
        base = grid[0] * clock.dt
        if base >= clock.t_end * (1.0 - 1e-14):
            return FINISHED, done
        if done == len(record.t):
            return BUFFER_FULL, done
        length = min(clock.dt, clock.t_end - base)
        if clock.t_end - base - clock.dt < 1e-9 * clock.dt:  # no sliver of a last step
            length = clock.t_end - base
        dt = length / 2.0 ** grid[2]
        if np.sqrt(fastest_square(start)) * dt > work.max_turn[0] and grid[2] < clock.max_level:
            _cut(grid, work.counts)
            continue
        start.t[0] = base + length * (grid[1] / 2.0 ** grid[2])
        present = Step(start, end, step.rows, dt)
        corrections = work.counts[NEWTON]
        outcome = attempt(run, present)
        if outcome != CONVERGED and outcome != LOOSE:
            work.factored_dt[0] = 0.0
            if grid[2] >= clock.max_level:
                work.counts[CUTS] += 1
                return UNDERFLOW, done
            _cut(grid, work.counts)
            continue
        if outcome == LOOSE:
            work.counts[LOOSE_STEPS] += 1
            work.factored_dt[0] = 0.0
            if not penalty.nested:  # a step of the nested loop is loose when it runs out of augmentations, too
                work.max_turn[0] = min(work.max_turn[0], penalty.singular_turn)
        correct_pose(run, end)
        close_rotations(end.R)
        accept(present, run.history, run.settings, record.reaction[done])
        record.level[done] = grid[2]
        _advance(grid)
        record.t[done] = base + length if grid[1] == 0 else base + length * (grid[1] / 2.0 ** grid[2])
        copy(end.r, record.r[done])
        copy(end.R, record.R[done])
        copy(end.v, record.v[done])
        copy(work.norm, record.norm[done])
        record.newton[done] = work.counts[NEWTON] - corrections
        record.xi[done] = work.xi[0]
        record.log_det[done] = work.log_det[0]
        done += 1
        start, end = end, start


def empty_record(room: int, nb: int, nrows: int) -> Record:
    """Room for ``room`` steps."""
    return Record(
        t=np.empty(room), r=np.empty((room, nb, 3)), R=np.empty((room, nb, 3, 3)), v=np.empty((room, nb, 6)),
        reaction=np.empty((room, nrows)), newton=np.zeros(room, dtype=np.int64), level=np.zeros(room, dtype=np.int64),
        xi=np.empty(room), log_det=np.empty(room), norm=np.empty((room, 2)),
    )  # fmt: skip
