"""Newton's method for the end of a step: residual (74), (75), correction (78), (79), tests (80), (81).

The linear system is the proximal saddle ``[[J_vv, -D'], [A, (Xi M_bar)^-1]]``: with Xi infinite it is Sect. 4.2, with a
finite penalty it is one correction and one augmentation (84), (85) of Sect. 4.3 at once.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from .arrays import Model
from .block_lu import factor, solve
from .choices import Settings
from .jacobian import assemble
from .pattern import LU, Saddle
from .residual import (
    balance,
    complete,
    constraint_balance,
    constraint_norm,
    end_forces,
    move,
    residual_norm,
)
from .vectors import INNER, ONCE

CONVERGED, LOOSE, SLOW, NOT_FINITE, SINGULAR_MATRIX = range(5)
COUNTERS = ("newton_iterations", "residuals", "factorisations", "solves", "step_cuts", "augmentations", "loose_steps")
NEWTON, RESIDUALS, FACTORISATIONS, SOLVES, CUTS, AUGMENTATIONS, LOOSE_STEPS = range(len(COUNTERS))
NEAR = 3.0  # decades of the determinant below its largest, where rows that lose rank look like redundant ones
SINKING = -0.05  # decades: a determinant that falls so fast may be on its way to zero, and is watched step by step


class History(NamedTuple):
    """What the first estimate of a step needs of the steps before."""

    v: np.ndarray  # (nb, 6) velocities one step before the present ones
    nu: np.ndarray  # (nrows,) nu1 of the last step
    increment: np.ndarray  # (nrows,) its change over the step before (0 after a change of the step)
    dt: np.ndarray  # (1,) last step


class Work(NamedTuple):
    """Newton's method: residuals, correction, and what it remembers."""

    R_v: np.ndarray  # (nb, 6)
    R_mu: np.ndarray  # (nrows,)
    x: np.ndarray  # correction, in elimination order
    xi: np.ndarray  # (1,) penalty of the present step
    nested: (
        np.ndarray
    )  # (1,) 1 inside the nested loop; not an argument, which numba would compile once for 0 and once for 1
    nu_kept: np.ndarray  # (nrows,) multiplier of the nested loop
    y: np.ndarray  # as x, the part of a correction along redundant rows
    left: np.ndarray  # (nrows,) what of (75) no velocity can change, see ``leave_redundant``
    counts: np.ndarray  # COUNTERS
    max_turn: np.ndarray  # (1,) [rad] a step in which a body would turn further is cut
    factored_dt: np.ndarray  # (1,) step of the kept factorisation, 0 when none
    norm: np.ndarray  # [(80), (81)] at the end of the last step
    log_det: np.ndarray  # [log10 of the determinant, its change, its largest], see ``log_determinant``


class Run(NamedTuple):
    """All that stays the same from step to step, or is overwritten."""

    model: Model
    settings: Settings
    history: History
    saddle: Saddle
    lu: LU
    work: Work


@njit(**ONCE)
def evaluate(run, step):
    """Residual of the present estimate; its norm (80)."""
    model, settings, rows, work = run.model, run.settings, step.rows, run.work
    move(step)
    complete(model, step.end, settings)
    if work.nested[0]:  # (84): mu - xi psi in place of mu
        for k in range(len(rows.nu1)):
            rows.nu1[k] = work.nu_kept[k] - work.xi[0] * step.end.m_bar[k] * step.end.phi_dot[k]
    end_forces(step, settings)
    balance(model, step, settings, work.R_v)
    if work.nested[0]:
        work.R_mu[:] = 0.0
    else:
        constraint_balance(step, settings, work.R_mu)
        for k in range(len(work.left)):
            work.R_mu[k] -= work.left[k]
    work.counts[RESIDUALS] += 1
    return residual_norm(model, step.end.m_bar, work.R_v, work.R_mu)


@njit(**ONCE)
def refresh(run, step):
    """Assemble and factor the saddle at the present estimate."""
    penalty, saddle, work, m_bar = run.settings.penalty, run.saddle, run.work, step.end.m_bar
    for k in range(len(m_bar)):
        saddle.softness[k] = 1.0 / (work.xi[0] * m_bar[k]) if penalty.active else 0.0
    assemble(run.model, step, run.settings, saddle)
    work.counts[FACTORISATIONS] += 1
    bad = factor(saddle.blocks, run.lu)
    work.factored_dt[0] = 0.0 if bad else step.dt
    if penalty.active and work.xi[0] == penalty.xi:  # soft steps weigh the redundant rows otherwise
        total = log_determinant(run.model, m_bar, run.lu)
        work.log_det[1] = total - work.log_det[0]
        work.log_det[0] = total
        work.log_det[2] = max(work.log_det[2], total)
    return bad


@njit(**INNER)
def log_determinant(model, m_bar, lu):
    """log10 of the product of the constraint rows' |pivots| times M_bar.

    It is det(A M^-1 D' + (Xi M_bar)^-1) in scaled rows: a constant 1/xi for each redundant row times the squares of
    the singular values, so near a loss of rank it falls by sigma^2 whatever the elimination order.
    """
    total = 0.0
    for j in range(len(model.body)):
        for k in range(model.row[j + 1] - model.row[j]):
            total += np.log10(lu.pivot[lu.joint_at[j] + k] * m_bar[model.row[j] + k])
    return total


@njit(**INNER)
def put_rows(model, lu, right, x):
    """Joints' part of a right side: x := -right."""
    for j in range(len(model.body)):
        for k in range(model.row[j + 1] - model.row[j]):
            x[lu.joint_at[j] + k] = -right[model.row[j] + k]


@njit(**ONCE)
def correct(run, step):
    """Newton correction (78) with the kept factorisation."""
    model, lu, work, x = run.model, run.lu, run.work, run.work.x
    for b in range(len(model.mass)):
        for k in range(6):
            x[lu.body_at[b] + k] = -work.R_v[b, k]
    put_rows(model, lu, work.R_mu, x)
    solve(lu, x)
    if run.settings.penalty.redundant and not work.nested[0] and work.log_det[0] > work.log_det[2] - NEAR:
        leave_redundant(run, x)
    for b in range(len(model.mass)):
        for k in range(6):
            step.end.v[b, k] += x[lu.body_at[b] + k]
    for j in range(len(model.body)):
        for k in range(model.row[j + 1] - model.row[j]):
            step.rows.nu1[model.row[j] + k] += x[lu.joint_at[j] + k]
    work.counts[NEWTON] += 1
    work.counts[SOLVES] += 1


@njit(**INNER)
def leave_redundant(run, x):
    """Take out of a correction the nu of redundant rows, which A^T sends to zero; what they ask for is ``left``.

    Such rows agree on the constraint manifold only: off it, by phi = O(dt^3) within a step, they ask for velocities
    that there are not. Each correction would raise their nu by xi phi_dot in vain, and D1 nu = 0 leaves (D0 + D1) nu
    = O(dt) nu, a spurious force that brakes the motion. The saddle itself tells that part: with
    (Xi M_bar)^-1 dnu as the only right side it returns dnu where A^T dnu = 0, and next to nothing elsewhere.
    """
    model, lu, work, y = run.model, run.lu, run.work, run.work.y
    y[:] = 0.0
    for j in range(len(model.body)):
        for k in range(model.row[j + 1] - model.row[j]):
            y[lu.joint_at[j] + k] = run.saddle.softness[model.row[j] + k] * x[lu.joint_at[j] + k]
    solve(lu, y)
    for j in range(len(model.body)):
        for k in range(model.row[j + 1] - model.row[j]):
            row = model.row[j] + k
            work.left[row] -= run.saddle.softness[row] * y[lu.joint_at[j] + k]
    for k in range(len(x)):
        x[k] -= y[k]
    work.counts[SOLVES] += 1


@njit(**INNER)
def newton(run, step):
    """Drive the residual below the tolerance. A kept factorisation is renewed when it no longer contracts."""
    settings, work, before = run.settings, run.work, np.inf
    # without sigma (80) implies (81), with C_bar or K_bar (81) cannot hold, and Sect. 4.3 asks (81) after (85)
    both = settings.carry_sigma and not settings.corrective and not work.nested[0]
    redundant = settings.penalty.redundant and not work.nested[0]
    work.left[:] = 0.0
    for iteration in range(settings.max_newton + 1):
        norm = evaluate(run, step)
        work.norm[0] = norm
        if not np.isfinite(norm):
            return NOT_FINITE
        if norm < settings.tolerance and (not both or constraint_norm(step.end) < settings.tolerance):
            return SLOW if redundant and not constraint_norm(step.end) < settings.penalty.accept else CONVERGED
        if iteration == settings.max_newton:
            break
        stale = work.factored_dt[0] != step.dt or settings.refresh <= 0.0 or norm > settings.refresh * before
        stale = stale or (iteration == 0 and work.log_det[1] < SINKING)
        if stale and refresh(run, step) > 0:
            return SINGULAR_MATRIX
        before = norm
        correct(run, step)
    work.factored_dt[0] = 0.0
    return SLOW
