"""One step by Newton's method, Eqs. (78), (79), and the march over a fixed grid of steps with cut-back and regrowth.

The linear system is the proximal saddle ``[[J_vv, -D'], [A, (Xi M_bar)^-1]]``: with Xi infinite it is Sect. 4.2, with a
finite penalty it is one correction and one augmentation (84), (85) of Sect. 4.3 at once.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from .block_lu import factor, solve
from .directions import direction
from .jacobian import assemble
from .residual import balance, complete, end_forces, move, residual_norm, start_forces
from .small import INNER, JIT, dot, turned_by

CONVERGED, LOOSE, SLOW, NOT_FINITE, SINGULAR_MATRIX = 0, 1, 2, 3, 4


class Penalty(NamedTuple):
    """Augmented Lagrangian settings; ``active`` 0 is the plain weak form."""

    active: int
    nested: int  # 1: the paper's nested loop, Newton to convergence, then (85)
    xi: float
    max_augmentations: int  # of the nested loop
    accept: float  # [sqrt(J)] (81) at which a step counts as done though (81) does not reach the tolerance
    correct_pose: int  # 1: poses corrected to phi = 0 after every step
    soft: float  # xi (omega dt)^2 of the nested loop at singular configurations
    singular_turn: float = np.inf  # [rad] limit on the turn in a step once a singular configuration has been met


class Work(NamedTuple):
    """Scratch and factors of a run."""

    blocks: np.ndarray
    T: np.ndarray
    body: np.ndarray
    constraint: np.ndarray
    x: np.ndarray
    diagonal: np.ndarray  # (nrows,) (Xi M_bar)^-1
    xi: np.ndarray  # (1,) penalty
    nu_kept: np.ndarray  # (nrows,) multiplier of the nested loop
    tally: np.ndarray  # counters, see COUNTERS
    max_turn: np.ndarray  # (1,) [rad] a step in which a body would turn further is cut
    held: np.ndarray  # [step of the kept factorisation, 0 when none]
    norm: np.ndarray  # [(80), (81)] at the end of the last step
    pivots: np.ndarray  # (nrows,) pivots of the constraint rows times M_bar
    log_det: np.ndarray  # [sum of their log10, its change at the last factorisation]


SINKING = -0.05  # decades: a determinant that falls so fast may be on its way to zero, and is watched step by step

COUNTERS = ("newton_iterations", "residuals", "factorisations", "solves", "step_cuts", "augmentations", "loose_steps")


@njit(**INNER)
def constraint_norm(m1):
    """(81): sqrt(phi_dot . M_bar phi_dot) [sqrt(J)]."""
    total = 0.0
    for k in range(len(m1.phi_dot)):
        total += m1.m_bar[k] * m1.phi_dot[k] * m1.phi_dot[k]
    return np.sqrt(total)


@njit(**JIT)
def evaluate(model, m0, m1, rows, dt, settings, penalty, work):
    """Residual of the present estimate; its norm (80)."""
    move(m0, m1, dt)
    complete(model, m1, settings)
    if penalty.nested:  # (84): mu - xi psi in place of mu
        for k in range(len(rows.nu1)):
            rows.nu1[k] = work.nu_kept[k] - work.xi[0] * m1.m_bar[k] * m1.phi_dot[k]
    end_forces(m0, m1, rows, dt, settings)
    balance(model, m0, m1, rows, dt, settings, work.body, work.constraint)
    if penalty.nested:
        work.constraint[:] = 0.0
    work.tally[1] += 1
    return residual_norm(model, m1, work.body, work.constraint)


@njit(**JIT)
def refresh(model, m0, m1, rows, dt, settings, penalty, index, pattern, f, work):
    """Assemble and factor the saddle at the present estimate."""
    for k in range(len(work.diagonal)):
        work.diagonal[k] = 1.0 / (work.xi[0] * m1.m_bar[k]) if penalty.active else 0.0
    assemble(model, m0, m1, rows, dt, settings, work.diagonal, index, work.blocks, work.T)
    work.tally[2] += 1
    bad = factor(pattern, work.blocks, f)
    work.held[0] = 0.0 if bad else dt
    if penalty.active and work.xi[0] == penalty.xi:  # soft steps weigh the redundant rows otherwise
        scaled_pivots(model, m1, pattern, f, work.pivots)
        total = np.sum(np.log10(work.pivots))
        work.log_det[1] = total - work.log_det[0]
        work.log_det[0] = total
    return bad


@njit(**INNER)
def scaled_pivots(model, m, pattern, f, out):
    """|Pivots| of the constraint rows times M_bar.

    Their product is det(A M^-1 D' + (Xi M_bar)^-1) in scaled rows: a constant 1/xi for each redundant row times the
    squares of the singular values, so near a loss of rank it falls by sigma^2 whatever the elimination order.
    """
    for j in range(len(model.end)):
        at = pattern.joint_at[j]
        for k in range(model.row[j + 1] - model.row[j]):
            out[model.row[j] + k] = f.pivot[at + k] * m.m_bar[model.row[j] + k]


@njit(**JIT)
def correct(model, m1, rows, pattern, f, work):
    """Newton correction (78) with the kept factorisation."""
    x = work.x
    for b in range(len(model.mass)):
        at = pattern.body_at[b]
        for k in range(6):
            x[at + k] = -work.body[b, k]
    for j in range(len(model.end)):
        at = pattern.joint_at[j]
        for k in range(model.row[j + 1] - model.row[j]):
            x[at + k] = -work.constraint[model.row[j] + k]
    solve(pattern, f, x)
    for b in range(len(model.mass)):
        at = pattern.body_at[b]
        for k in range(6):
            m1.v[b, k] += x[at + k]
    for j in range(len(model.end)):
        at = pattern.joint_at[j]
        for k in range(model.row[j + 1] - model.row[j]):
            rows.nu1[model.row[j] + k] += x[at + k]
    work.tally[0] += 1
    work.tally[3] += 1


@njit(**INNER)
def newton(model, m0, m1, rows, dt, settings, penalty, index, pattern, f, work):
    """Drive the residual below the tolerance. A kept factorisation is renewed when it no longer contracts."""
    before = np.inf
    both = settings.carry_sigma and not settings.corrective  # else (80) implies (81), or (81) cannot hold
    for iteration in range(settings.max_newton + 1):
        norm = evaluate(model, m0, m1, rows, dt, settings, penalty, work)
        work.norm[0] = norm
        if not np.isfinite(norm):
            return NOT_FINITE
        if norm < settings.tolerance and (not both or constraint_norm(m1) < settings.tolerance):
            return CONVERGED
        if iteration == settings.max_newton:
            break
        stale = work.held[0] != dt or settings.refresh <= 0.0 or norm > settings.refresh * before
        stale = stale or (iteration == 0 and work.log_det[1] < SINKING)
        if stale and refresh(model, m0, m1, rows, dt, settings, penalty, index, pattern, f, work) > 0:
            return SINGULAR_MATRIX
        before = norm
        correct(model, m1, rows, pattern, f, work)
    work.held[0] = 0.0
    return SLOW


@njit(**INNER)
def attempt(model, m0, m1, rows, history, dt, settings, penalty, index, pattern, f, work):
    """One step from ``m0`` into ``m1``, first estimate included.

    Augmented Lagrangian: the proximal saddle does Newton's correction and the augmentation at once. Near a singular
    configuration it need not converge, for the violation phi = O(dt^2) makes phi_dot = 0 inconsistent along the
    direction that is being lost. There the step is done again by the nested loop with a penalty so low that this
    direction is left to the multiplier carried from the steps before, and counts as done at ``penalty.accept``.
    """
    start_forces(m0, rows, settings)
    first_estimate(m0, m1, rows, history, dt, settings)
    work.xi[0] = penalty.xi
    if not penalty.nested:
        outcome = newton(model, m0, m1, rows, dt, settings, penalty, index, pattern, f, work)
        work.norm[1] = constraint_norm(m1)
        if outcome == CONVERGED or not penalty.active:
            return outcome
        first_estimate(m0, m1, rows, history, dt, settings)
        work.held[0] = 0.0
        work.xi[0] = min(penalty.xi, soft_penalty(m0, dt, penalty))
    return nested_loop(model, m0, m1, rows, dt, settings, penalty, index, pattern, f, work)


@njit(**INNER)
def correct_pose(model, m1, settings, penalty, pattern, f, work):
    """Least change of the poses that takes phi to zero (one correction with the kept factorisation).

    At a singular configuration phi = O(dt^2) is not harmless: with phi along the lost direction the mechanism cannot
    pass it, and misses by sqrt(phi).
    """
    if work.held[0] == 0.0 or penalty.correct_pose == 0:
        return
    x = work.x
    x[:] = 0.0
    for j in range(len(model.end)):
        at = pattern.joint_at[j]
        for k in range(model.row[j + 1] - model.row[j]):
            x[at + k] = -m1.phi[model.row[j] + k]
    solve(pattern, f, x)
    for b in range(len(model.mass)):
        at = pattern.body_at[b]
        for k in range(3):
            m1.r[b, k] += x[at + k]
        turned_by(m1.R, b, x[at + 3], x[at + 4], x[at + 5], m1.R)
    work.tally[3] += 1
    complete(model, m1, settings)


@njit(**INNER)
def soft_penalty(m0, dt, penalty):
    """xi with xi (omega dt)^2 = ``penalty.soft``: above about 0.3 the penalised matrix turns indefinite."""
    omega2 = 0.0
    for b in range(len(m0.v)):
        omega2 = max(omega2, m0.v[b, 3] ** 2 + m0.v[b, 4] ** 2 + m0.v[b, 5] ** 2)
    return penalty.soft / (omega2 * dt * dt) if omega2 > 0.0 else penalty.xi


@njit(**INNER)
def nested_loop(model, m0, m1, rows, dt, settings, penalty, index, pattern, f, work):
    """The paper's loop: Newton to convergence at a fixed multiplier, then (85), until phi_dot is small enough."""
    inner = Penalty(1, 1, penalty.xi, penalty.max_augmentations, penalty.accept, 0, penalty.soft, np.inf)
    work.nu_kept[:] = rows.nu1
    for _ in range(penalty.max_augmentations):
        outcome = newton(model, m0, m1, rows, dt, settings, inner, index, pattern, f, work)
        work.norm[1] = constraint_norm(m1)
        if outcome != CONVERGED:
            return outcome
        work.nu_kept[:] = rows.nu1  # (85): mu - xi psi
        work.tally[5] += 1
        if work.norm[1] < settings.tolerance:
            return CONVERGED
    return LOOSE if work.norm[1] < penalty.accept else SLOW


@njit(**INNER)
def first_estimate(m0, m1, rows, history, dt, settings):
    """Velocities and nu of the end, extrapolated from the last two steps (``history.ratio`` their step ratio)."""
    ratio = dt / history.last_dt[0] if history.last_dt[0] > 0.0 else 0.0
    for b in range(len(m0.v)):
        for k in range(6):
            m1.v[b, k] = m0.v[b, k] + ratio * (m0.v[b, k] - history.v[b, k])
    for k in range(len(rows.nu1)):
        if settings.keep_nu:
            rows.nu1[k] = rows.nu_start[k] + ratio * history.increment[k]
        else:
            rows.nu1[k] = ratio * (history.nu[k] + ratio * history.increment[k])


class History(NamedTuple):
    """What the first estimate of a step needs of the steps before."""

    v: np.ndarray  # (nb, 6) velocities one step before the present ones
    nu: np.ndarray  # (nrows,) nu1 of the last step
    increment: np.ndarray  # (nrows,) its change over the step before (0 after a change of the step)
    last_dt: np.ndarray  # (1,)


@njit(**INNER)
def accept(m0, m1, rows, history, dt, settings, force):
    """Carry the end of a step over to the next start; ``force`` receives the mean row force of the step."""
    same = history.last_dt[0] == dt
    for k in range(len(rows.nu1)):
        nu0 = settings.gauge * rows.nu1[k] + rows.nu_start[k]
        force[k] = (rows.nu1[k] - nu0) / dt + 0.5 * (rows.G0[k] + rows.G1[k])
        if settings.keep_nu:
            history.increment[k] = rows.nu1[k] - rows.nu_start[k]
            rows.nu_start[k] = rows.nu1[k]
        else:
            history.increment[k] = rows.nu1[k] - history.nu[k] if same else 0.0
        history.nu[k] = rows.nu1[k]
        if settings.corrective:
            mu1 = rows.nu1[k] / m1.m_bar[k]
            rows.lam0[k] += 0.5 * dt * (rows.mu0[k] + mu1)  # (67)
            rows.mu0[k] = mu1
        if settings.carry_sigma:
            rows.sigma0[k] = m1.m_bar[k] * m1.phi_dot[k]  # (62)
    history.v[:, :] = m0.v
    history.last_dt[0] = dt


@njit(**JIT)
def start_mu(model, m, rows, choice):
    """mu0 = c . M v / M_bar: the velocity along c_R; for c = (e_k, 0) it is the velocity of C."""
    work = np.empty((4, 3))
    for j in range(len(model.end)):
        for row in range(model.row[j], model.row[j + 1]):
            direction(model, m, j, row, choice, work)
            total = 0.0
            for e in range(2):
                b = model.end[j, e]
                if b >= 0:
                    for q in range(3):
                        total += m.c[row, e, q] * model.mass[b] * m.v[b, q]
                        total += m.c[row, e, 3 + q] * dot(model.J[b, q], m.v[b, 3:])
            rows.mu0[row] = total / m.m_bar[row]
            rows.nu_start[row] = total
