"""One step, Sect. 4.2 or 4.3: first estimate, Newton's method or the nested loop, and what the next step needs."""

import numpy as np
from numba import njit

from .block_lu import solve
from .directions import direction
from .newton import AUGMENTATIONS, CONVERGED, LOOSE, SLOW, SOLVES, newton, put_rows
from .residual import complete, constraint_norm, start_forces
from .vectors import INNER, JIT, ONCE, add, copy, dot, turn, turned_by

ENOUGH = 0.25  # an augmentation that leaves more of phi_dot raises xi (Powell; Bertsekas)


@njit(**ONCE)
def nested_loop(run, step):
    """The paper's loop: Newton to convergence at a fixed multiplier, then (85), until phi_dot is small enough."""
    settings, work, before = run.settings, run.work, np.inf
    copy(step.rows.nu1, work.nu_kept)
    work.nested[0] = 1
    for _ in range(settings.penalty.max_augmentations):
        outcome = newton(run, step)
        work.norm[1] = constraint_norm(step.end)
        if outcome != CONVERGED:
            return outcome
        copy(step.rows.nu1, work.nu_kept)  # (85): mu - xi psi
        work.counts[AUGMENTATIONS] += 1
        if work.norm[1] < settings.tolerance:
            return CONVERGED
        if settings.penalty.growth > 1.0 and work.norm[1] > ENOUGH * before:
            work.xi[0] *= settings.penalty.growth
            work.factored_dt[0] = 0.0
        before = work.norm[1]
    return LOOSE if work.norm[1] < settings.penalty.accept else SLOW


@njit(**ONCE)
def attempt(run, step):
    """One step from its start to its end, first estimate included.

    Augmented Lagrangian: the proximal saddle does Newton's correction and the augmentation at once. Near a singular
    configuration it need not converge, for the violation phi = O(dt^2) makes phi_dot = 0 inconsistent along the
    direction that is being lost. There the step is done again by the nested loop with a penalty so low that this
    direction is left to the multiplier carried from the steps before, and counts as done at ``penalty.accept``.
    """
    penalty, work = run.settings.penalty, run.work
    start_forces(step, run.settings)
    first_estimate(step, run.history, run.settings)
    if work.xi[0] != penalty.xi:  # the last step was a soft one: its factor is not that of this step
        work.factored_dt[0] = 0.0
    work.xi[0] = penalty.xi
    if not penalty.nested:
        work.nested[0] = 0
        outcome = newton(run, step)
        work.norm[1] = constraint_norm(step.end)
        if outcome == CONVERGED or not penalty.active:
            return outcome
        first_estimate(step, run.history, run.settings)
        work.factored_dt[0] = 0.0
        omega2 = fastest_square(step.start)  # above about 0.3 of xi (omega dt)^2 the penalised matrix turns indefinite
        if omega2 > 0.0:
            work.xi[0] = min(penalty.xi, penalty.soft / (omega2 * step.dt * step.dt))
    return nested_loop(run, step)


@njit(**INNER)
def fastest_square(motion):
    """Largest |Omega|^2 of all bodies [1/s2]."""
    square = 0.0
    for b in range(len(motion.v)):
        square = max(square, dot(motion.v[b, 3:], motion.v[b, 3:]))
    return square


@njit(**INNER)
def first_estimate(step, history, settings):
    """Velocities and nu of the end, extrapolated from the last two steps or those of the start."""
    start, end, rows = step.start, step.end, step.rows
    ratio = settings.extrapolate * step.dt / history.dt[0] if history.dt[0] > 0.0 else 0.0
    for b in range(len(start.v)):
        for k in range(6):
            end.v[b, k] = start.v[b, k] + ratio * (start.v[b, k] - history.v[b, k])
    for k in range(len(rows.nu1)):
        if settings.keep_nu:
            rows.nu1[k] = rows.nu_start[k] + ratio * history.increment[k]
        else:
            rows.nu1[k] = ratio * (history.nu[k] + ratio * history.increment[k])


@njit(**ONCE)
def correct_pose(run, end):
    """Least change of the poses that takes phi to zero (one correction with the kept factorisation).

    At a singular configuration phi = O(dt^2) is not harmless: with phi along the lost direction the mechanism cannot
    pass it, and misses by sqrt(phi).
    """
    model, lu, x = run.model, run.lu, run.work.x
    if run.work.factored_dt[0] == 0.0 or run.settings.penalty.correct_pose == 0:
        return
    x[:] = 0.0
    put_rows(model, lu, end.phi, x)
    solve(lu, x)
    for b in range(len(model.mass)):
        at = lu.body_at[b]
        add(1.0, x[at:], end.r[b])
        turned_by(end.R[b], (x[at + 3], x[at + 4], x[at + 5]), end.R[b])
    run.work.counts[SOLVES] += 1
    complete(model, end, run.settings)


@njit(**INNER)
def accept(step, history, settings, reaction):
    """Carry the end of a step over to the next start; ``reaction`` receives the mean row force of the step."""
    end, rows, dt = step.end, step.rows, step.dt
    same = history.dt[0] == dt
    for k in range(len(rows.nu1)):
        nu0 = settings.gauge * rows.nu1[k] + rows.nu_start[k]
        reaction[k] = (rows.nu1[k] - nu0) / dt + 0.5 * (rows.G0[k] + rows.G1[k])
        if settings.keep_nu:
            history.increment[k] = rows.nu1[k] - rows.nu_start[k]
            rows.nu_start[k] = rows.nu1[k]
        else:
            history.increment[k] = rows.nu1[k] - history.nu[k] if same else 0.0
        history.nu[k] = rows.nu1[k]
        if settings.corrective:
            mu1 = rows.nu1[k] / end.m_bar[k]
            rows.lam0[k] += 0.5 * dt * (rows.mu0[k] + mu1)  # (67)
            rows.mu0[k] = mu1
        if settings.carry_sigma:
            rows.sigma0[k] = end.m_bar[k] * end.phi_dot[k]  # (62)
    copy(step.start.v, history.v)
    history.dt[0] = dt


@njit(**JIT)
def start_mu(model, motion, rows, choice):
    """mu0 = c . M v / M_bar: the velocity along c_R; for c = (e_k, 0) it is the velocity of C."""
    for j in range(len(model.body)):
        for row in range(model.row[j], model.row[j + 1]):
            direction(model, motion, j, row, choice)
            total = 0.0
            for e in range(2):
                b, c = model.body[j, e], motion.c[row, e]
                if b >= 0:
                    total += model.mass[b] * dot(c, motion.v[b]) + dot(c[3:], turn(model.J[b], motion.v[b, 3:]))
            rows.mu0[row] = total / motion.m_bar[row]
            rows.nu_start[row] = total
