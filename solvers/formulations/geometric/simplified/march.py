"""March of the simplified method over whole steps of the grid."""

from numba import njit

from ..index1.kernel import HOT, accelerate, add_rows_back, clear, rows, solve
from ..newton import NEWTON
from ..vectors import JIT, close_rotations, copy, turned_by
from .rows import arms, constraint_norm
from .state import DEPTH
from .step import one_step, poses

FINISHED, BUFFER_FULL, HARD = 0, 1, 2
PASSES = 2  # of the pose correction: the factor is that of the step's first estimate


@njit(**JIT)
def start(lean):
    """Acceleration and row forces at the start take the place of a step before the first."""
    lean.rank[0] = accelerate(lean.model, lean.blocks, lean.k)
    copy(lean.k.v_dot, lean.acceleration[0])
    copy(lean.k.lam, lean.impulse[0])
    lean.past[0], lean.past[1] = 1, 0


@njit(**HOT)
def newest(lean):
    """Place of the last step among the ``DEPTH`` kept."""
    return (lean.past[0] - 1) % DEPTH


@njit(**HOT)
def correct_poses(lean):
    """Least change of the poses, in the norm of M, that takes phi to zero: one pass with the factor at hand."""
    model, k = lean.model, lean.k
    rows(model, k)
    for i in range(len(k.rhs)):
        k.rhs[i] = -k.phi[i]
    solve(lean.blocks, k, k.rhs)
    clear(lean.w)
    add_rows_back(model, k, k.rhs, lean.w)
    for b in range(len(model.mass)):
        for q in range(3):
            k.r[b, q] += lean.w[b, q]
        turned_by(k.R[b], (lean.w[b, 3], lean.w[b, 4], lean.w[b, 5]), k.R[b])


@njit(**HOT)
def accept(lean, settings, h, middle):
    """The step of h just made becomes the past: its means, for the estimate of those that follow."""
    k = lean.k
    lean.past[0] += 1
    d = newest(lean)
    for b in range(len(lean.model.mass)):
        for q in range(6):
            lean.acceleration[d, b, q] = (k.v[b, q] - lean.v0[b, q]) / h
    arms(lean, settings)
    for i in range(len(lean.nu)):
        lean.impulse[d, i] = ((1.0 - settings.gauge) * lean.nu[i] - lean.nu_start[i]) / h
        if settings.keep_nu:
            lean.nu_start[i] = lean.nu[i]
    lean.middle[d] = middle


@njit(**JIT)
def march(lean, settings, grid, dt, t_end, counts, record):
    """Whole steps of the grid until ``record`` is full, the end is reached, or one does not converge (nothing of it
    stays); returns the outcome and the number of steps recorded.
    """
    k, done, model = lean.k, 0, lean.model
    arms(lean, settings)
    while True:
        base = grid[0] * dt
        if base >= t_end * (1.0 - 1e-14):
            return FINISHED, done
        if done == len(record.t):
            return BUFFER_FULL, done
        h = min(dt, t_end - base)
        if t_end - base - dt < 1e-9 * dt:  # no sliver of a last step
            h = t_end - base
        before = counts[NEWTON]
        change = one_step(lean, settings, h, base + 0.5 * h, counts)
        if change < 0.0:
            copy(lean.r0, k.r)
            copy(lean.R0, k.R)
            copy(lean.v0, k.v)
            lean.past[1] = 0
            return HARD, done
        poses(lean, h)
        if settings.penalty.correct_pose:
            for _ in range(PASSES):
                correct_poses(lean)
        close_rotations(k.R)
        accept(lean, settings, h, base + 0.5 * h)
        for j in range(len(model.body)):
            for i in range(model.row[j], model.row[j + 1]):
                record.reaction[done, i] = lean.impulse[newest(lean), i]
                if i < model.row[j] + 3:
                    q = i - model.row[j]
                    record.reaction[done, i] -= 0.5 * (lean.f_bar0[j, q] + lean.f_bar[j, q])
        grid[0] += 1
        record.t[done] = base + h
        copy(k.r, record.r[done])
        copy(k.R, record.R[done])
        copy(k.v, record.v[done])
        record.newton[done] = counts[NEWTON] - before
        record.norm[done, 0] = change
        record.norm[done, 1] = constraint_norm(lean, settings)
        record.xi[done] = settings.penalty.xi
        record.log_det[done] = lean.log_det[0]
        done += 1
