"""Index 1 at one state: accelerations, multipliers, projections."""

import numpy as np
from numba import njit

from ...vectors import INNER, JIT, copy, dot, turn, turned_by
from .cholesky import factorise, solve
from .forces import add_gyroscopic, applied
from .products import add_rows_back, clear, minus_rates, times_inverse_mass, times_rows
from .room import HOT
from .rows import rows

# as in ``mechanics.lent``; here, since compiled code is keyed by this folder's files
ROUNDS, PASSES, ROUNDING, STILL, SINGULAR = 3, 100, 1e-15, 1e-9, 1e-12


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
    """``v_dot`` and ``lam`` of M instead of M' = M + P: M' v_dot - A^T lam = f + P v_dot, by conjugate gradients in the
    product x . P y of angular accelerations; NaN where M is singular (module ``mechanics.lent``).
    """
    x, left, p = k.spun, k.left, k.toward
    for b in range(len(model.mass)):
        for a in range(3):
            x[b, a] = k.v_dot[b, 3 + a]
    for n in range(ROUNDS + 1):
        _answer(model, blocks, k, x)
        for b in range(len(model.mass)):
            for a in range(3):
                left[b, a] = k.v_dot[b, 3 + a] + k.change[b, 3 + a] - x[b, a]
        size = _product(model, left, left)
        if n == ROUNDS or not size > (STILL if n else ROUNDING) ** 2 * _product(model, x, x):
            break
        copy(left, p)
        for _ in range(PASSES):
            _answer(model, blocks, k, p)
            for b in range(len(model.mass)):
                for a in range(3):
                    k.change[b, a] = p[b, a] - k.change[b, 3 + a]
            along = _product(model, p, k.change)
            if not along > SINGULAR * _product(model, p, p):
                if size > STILL**2 * _product(model, x, x):
                    k.v_dot[0, 0] = np.nan
                break
            share = size / along
            for b in range(len(model.mass)):
                for a in range(3):
                    x[b, a] += share * p[b, a]
                    left[b, a] -= share * k.change[b, a]
            new = _product(model, left, left)
            reached = _product(model, x, x)
            if not new > ROUNDING**2 * reached or not (new < size or size > STILL**2 * reached):
                break
            for b in range(len(model.mass)):
                for a in range(3):
                    p[b, a] = left[b, a] + new / size * p[b, a]
            size = new
    for b in range(len(model.mass)):
        for a in range(6):
            k.v_dot[b, a] += k.change[b, a]
    for a in range(len(k.lam)):
        k.lam[a] += k.rhs[a]


@njit(**INNER)
def _answer(model, blocks, k, x):
    """``change`` and ``rhs``: what the load P x adds to ``v_dot`` and ``lam``."""
    for b in range(len(model.mass)):
        T = turn(model.coupled[b], x[b])
        for a in range(3):
            k.change[b, a], k.change[b, 3 + a] = 0.0, T[a]
    times_inverse_mass(model, k.change)
    for a in range(len(k.rhs)):
        k.rhs[a] = 0.0
    times_rows(model, k, k.change, -1.0, k.rhs)
    solve(blocks, k, k.rhs)
    add_rows_back(model, k, k.rhs, k.change)


@njit(**INNER)
def _product(model, x, y):
    """x . P y"""
    out = 0.0
    for b in range(len(model.mass)):
        out += dot(x[b], turn(model.coupled[b], y[b]))
    return out


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
