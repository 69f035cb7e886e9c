"""Index 1 at one state: accelerations, multipliers, projections."""

import numpy as np
from numba import njit

from ...vectors import INNER, JIT, copy, turn, turned_by
from .cholesky import factorise, solve
from .forces import add_gyroscopic, applied
from .products import add_rows_back, clear, minus_rates, times_inverse_mass, times_rows
from .room import HOT
from .rows import rows

PASSES, ROUNDING = 100, 1e-15  # as in ``mechanics.lent``; here, since compiled code is keyed by this folder's files


@njit(**HOT)
def _index_1(model, blocks, k):
    applied(model, k)
    add_gyroscopic(model, k)
    copy(k.force, k.v_dot)
    times_inverse_mass(model, k.v_dot)
    for a in range(len(k.lam)):
        k.lam[a] = -k.gamma[a]
    times_rows(model, k, k.v_dot, -1.0, k.lam)
    solve(blocks, k, k.lam)
    add_rows_back(model, k, k.lam, k.v_dot)
    if len(model.coupled):
        _take_back(model, blocks, k)


@njit(**INNER)
def _take_back(model, blocks, k):
    """``v_dot`` and ``lam`` of M instead of M' = M + P: M' v_dot - A^T lam = f + P v_dot, by changes that fall to
    rounding; NaN where they do not (module ``mechanics.lent``).
    """
    copy(k.v_dot, k.change)
    for _ in range(PASSES):
        for b in range(len(model.mass)):
            T = turn(model.coupled[b], k.change[b, 3:])
            for a in range(3):
                k.change[b, a], k.change[b, 3 + a] = 0.0, T[a]
        times_inverse_mass(model, k.change)
        for a in range(len(k.rhs)):
            k.rhs[a] = 0.0
        times_rows(model, k, k.change, -1.0, k.rhs)
        solve(blocks, k, k.rhs)
        add_rows_back(model, k, k.rhs, k.change)
        change = size = 0.0
        for b in range(len(model.mass)):
            for a in range(6):
                k.v_dot[b, a] += k.change[b, a]
                if a >= 3:
                    change, size = max(change, abs(k.change[b, a])), max(size, abs(k.v_dot[b, a]))
        for a in range(len(k.lam)):
            k.lam[a] += k.rhs[a]
        if not change > ROUNDING * size:
            return
    for b in range(len(model.mass)):
        for a in range(6):
            k.v_dot[b, a] = np.nan


@njit(**HOT)
def accelerate(model, blocks, k):
    """Index 1: ``v_dot`` and ``lam`` at the poses and velocities of ``k``; returns the rank."""
    rows(model, k)
    rank = factorise(model, blocks, k)
    _index_1(model, blocks, k)
    return rank


@njit(**INNER)
def reactions(model, blocks, k):
    """``accelerate`` with the factor of these poses at hand; once a step and not inlined, which compiles faster."""
    rows(model, k)
    _index_1(model, blocks, k)


@njit(**JIT)
def evaluate(model, blocks, k):
    """``accelerate``, to be called from Python: compiled once for all methods."""
    return accelerate(model, blocks, k)


@njit(**HOT)
def project(model, blocks, k, work):
    """Poses onto phi = 0, then velocities onto A v + phi_t = 0, along M^-1 A^T, factor at hand; ``work`` (nb, 6).

    One pass each: what is left is the square of what there was, as long as ``k.L`` belongs to poses nearby.
    """
    for a in range(len(k.rhs)):
        k.rhs[a] = -k.phi[a]
    solve(blocks, k, k.rhs)
    clear(work)
    add_rows_back(model, k, k.rhs, work)
    for b in range(len(model.mass)):
        for a in range(3):
            k.r[b, a] += work[b, a]
        turned_by(k.R[b], (work[b, 3], work[b, 4], work[b, 5]), k.R[b])
    rows(model, k)
    minus_rates(model, k, k.v, k.rhs)
    solve(blocks, k, k.rhs)
    add_rows_back(model, k, k.rhs, k.v)
