"""S = A M^-1 A^T by blocks of joints, its factor, and solutions with it."""

import math

from numba import njit

from ...vectors import INNER
from ..blocks import WIDTH
from .room import FUSED

DEPENDENT = 1e-9  # of the row's own entry of S; rounding leaves 1e-15, the weakest true pivots of our problems are 1e-4


@njit(**FUSED)
def factorise(model, blocks, k, shift=0.0):
    """S into ``k.L``, then its block Cholesky factor in place; returns the number of rows kept (the rank).

    ``shift`` is added to the diagonal, relative to it: with more than ``DEPENDENT`` no row is dropped.
    """
    nj, rank = len(blocks.joint), 0
    L = k.L
    for p in range(len(blocks.other)):
        for a in range(WIDTH):
            for c in range(WIDTH):
                L[p, a, c] = 0.0
    for col in range(nj):
        jc, size = blocks.joint[col], blocks.size[col]
        for p in range(blocks.start[col], blocks.start[col + 1]):
            ja, height = blocks.joint[blocks.other[p]], blocks.size[blocks.other[p]]
            for t in range(blocks.shared_start[p], blocks.shared_start[p + 1]):
                ea, ec = blocks.shared[t, 1], blocks.shared[t, 2]
                weight = (1.0 - 2.0 * ea) * (1.0 - 2.0 * ec) / model.mass[model.body[jc, ec]]
                if size == WIDTH:
                    _add_turnings(k, L, p, ja, ea, jc, ec, WIDTH, height)
                else:
                    _add_turnings(k, L, p, ja, ea, jc, ec, size, height)
                if model.pins[ja] and model.pins[jc]:
                    for a in range(3):
                        L[p, a, a] += weight
                else:
                    _add_translations(k, ja, jc, height, size, weight, L[p])
        for a in range(size):
            k.diagonal[blocks.row[col] + a] = L[blocks.start[col], a, a]
            L[blocks.start[col], a, a] *= 1.0 + shift
    for col in range(nj):
        d, size = blocks.start[col], blocks.size[col]
        rank += _diagonal(L, d, size, k, blocks.row[col])
        for p in range(d + 1, blocks.start[col + 1]):  # L_pd = S_pd L_dd^-T
            height = blocks.size[blocks.other[p]]
            if size == WIDTH:  # as a constant it has the loops unrolled: half the time of a full block
                _divide(L, p, d, WIDTH, height)
            else:
                _divide(L, p, d, size, height)
        for t in range(blocks.update_start[col], blocks.update_start[col + 1]):
            target, left, right = blocks.update[t, 0], blocks.update[t, 1], blocks.update[t, 2]
            for a in range(WIDTH):
                for c in range(WIDTH):
                    x = 0.0
                    for q in range(WIDTH):
                        x += L[left, a, q] * L[right, c, q]
                    L[target, a, c] -= x
    return rank


@njit(**FUSED)
def _add_turnings(k, L, p, ja, ea, jc, ec, size, height):
    """L_p += X J^-1 X^T of two joints at one body."""
    for a in range(height):
        x0, x1, x2 = k.X[ja, ea, a, 0], k.X[ja, ea, a, 1], k.X[ja, ea, a, 2]
        for c in range(size):
            L[p, a, c] += x0 * k.Y[jc, ec, c, 0] + x1 * k.Y[jc, ec, c, 1] + x2 * k.Y[jc, ec, c, 2]


@njit(**INNER)
def _add_translations(k, ja, jc, height, size, weight, block):
    """block += weight f_a . f_c: joints with rows that are no point rows."""
    for a in range(height):
        f0, f1, f2 = k.way[ja, a, 0], k.way[ja, a, 1], k.way[ja, a, 2]
        for c in range(size):
            block[a, c] += weight * (f0 * k.way[jc, c, 0] + f1 * k.way[jc, c, 1] + f2 * k.way[jc, c, 2])


@njit(**FUSED)
def _divide(L, p, d, size, height):
    """L_p := L_p L_d^-T"""
    for a in range(height):
        for c in range(size):
            x = L[p, a, c]
            for q in range(c):
                x -= L[p, a, q] * L[d, c, q]
            L[p, a, c] = x * L[d, c, c]


@njit(**FUSED)
def _subtract(L, p, x, row, size, at, height):
    """x[at:] -= L_p x[row:]"""
    for a in range(height):
        y = 0.0
        for q in range(size):
            y += L[p, a, q] * x[row + q]
        x[at + a] -= y


@njit(**FUSED)
def _subtract_transposed(L, p, x, row, size, at, height):
    """x[row:] -= L_p^T x[at:]"""
    for a in range(height):
        y = x[at + a]
        for q in range(size):
            x[row + q] -= L[p, a, q] * y


@njit(**FUSED)
def _diagonal(L, d, size, k, row):
    """Cholesky of one diagonal block, its diagonal inverted."""
    kept = 0
    for c in range(size):
        x = L[d, c, c]
        for q in range(c):
            x -= L[d, c, q] * L[d, c, q]
        inverse = 1.0 / math.sqrt(x) if x > DEPENDENT * k.diagonal[row + c] else 0.0
        kept += inverse > 0.0
        L[d, c, c] = inverse
        for a in range(c + 1, size):
            x = L[d, a, c]
            for q in range(c):
                x -= L[d, a, q] * L[d, c, q]
            L[d, a, c] = x * inverse
    return kept


@njit(**FUSED)
def solve(blocks, k, x):
    """x (nrows,) := S^-1 x with the factor in ``k.L``; 0 in redundant rows."""
    L, nj = k.L, len(blocks.joint)
    for col in range(nj):
        d, size, row = blocks.start[col], blocks.size[col], blocks.row[col]
        for a in range(size):
            y = x[row + a]
            for q in range(a):
                y -= L[d, a, q] * x[row + q]
            x[row + a] = y * L[d, a, a]
        for p in range(d + 1, blocks.start[col + 1]):
            at = blocks.row[blocks.other[p]]
            height = blocks.size[blocks.other[p]]
            if size == WIDTH:
                _subtract(L, p, x, row, WIDTH, at, height)
            else:
                _subtract(L, p, x, row, size, at, height)
    for col in range(nj - 1, -1, -1):
        d, size, row = blocks.start[col], blocks.size[col], blocks.row[col]
        for p in range(d + 1, blocks.start[col + 1]):
            at = blocks.row[blocks.other[p]]
            height = blocks.size[blocks.other[p]]
            if size == WIDTH:
                _subtract_transposed(L, p, x, row, WIDTH, at, height)
            else:
                _subtract_transposed(L, p, x, row, size, at, height)
        for a in range(size - 1, -1, -1):
            y = x[row + a]
            for q in range(a + 1, size):
                y -= L[d, q, a] * x[row + q]
            x[row + a] = y * L[d, a, a]
