"""Block LU on a fixed pattern, row by row: A = L U with unit block-lower L; pivoting inside the pivot blocks only.

Row p gathers its original blocks in a dense strip, subtracts the rows q < p it meets (one small product per pair,
contiguous in the columns of q), inverts its pivot block and leaves its panel of U. Why not a library: see
docs/decisions/block-lu.md.
"""

import numpy as np
from numba import njit

from solvers.formulations.geometric.small import JIT


@njit(**JIT)
def factor(pattern, blocks, f):
    """Numbers of the factors; returns 0, or 1 + p where node p has a singular pivot."""
    W = f.dense
    for p in range(len(pattern.size)):
        m = pattern.size[p]
        own = pattern.start[p]
        for pair in range(pattern.pair_start[p], pattern.pair_start[p + 1]):
            at = pattern.pair_column[pair]
            for a in range(m):
                for c in range(pattern.pair_width[pair]):
                    W[a, at + c] += blocks[pair, a, c]
        for k in range(pattern.low_start[p], pattern.low_start[p + 1]):
            _subtract_row(pattern, f, k, m, W)
        for a in range(m):
            for c in range(m):
                f.pivot_inverse[p, a, c] = W[a, own + c]
                W[a, own + c] = 0.0
        smallest = invert(f.pivot_inverse[p], m, f.pivot[own : own + m])
        at = pattern.panel_start[p]
        width = pattern.up_start[p + 1] - pattern.up_start[p]
        for a in range(m):
            for c in range(width):
                column = pattern.up[pattern.up_start[p] + c]
                f.panel[at + a * width + c] = W[a, column]
                W[a, column] = 0.0
        if not smallest > 0.0:
            return 1 + p
    return 0


@njit(**JIT)
def _subtract_row(pattern, f, k, m, W):
    q = pattern.low[k]
    inner = pattern.size[q]
    own = pattern.start[q]
    inverse = f.pivot_inverse[q]
    L = f.low[k]
    for a in range(m):
        for c in range(inner):
            total = 0.0
            for b in range(inner):
                total += W[a, own + b] * inverse[b, c]
            L[a, c] = total
        for c in range(inner):
            W[a, own + c] = 0.0
    first = pattern.up_start[q]
    width = pattern.up_start[q + 1] - first
    panel = f.panel[pattern.panel_start[q] : pattern.panel_start[q + 1]]
    columns = pattern.up[first : first + width]
    strip = f.strip
    for a in range(m):
        _combine(L[a], panel, inner, width, strip)
        Wa = W[a]
        for c in range(width):
            Wa[columns[c]] -= strip[c]


@njit(**JIT)
def _combine(x, panel, inner, width, strip):
    """strip = x[:inner] @ panel, unrolled for the three node sizes."""
    if inner == 6:
        for c in range(width):
            strip[c] = (
                x[0] * panel[c] + x[1] * panel[width + c] + x[2] * panel[2 * width + c]
                + x[3] * panel[3 * width + c] + x[4] * panel[4 * width + c] + x[5] * panel[5 * width + c]
            )  # fmt: skip
    elif inner == 5:
        for c in range(width):
            strip[c] = (
                x[0] * panel[c] + x[1] * panel[width + c] + x[2] * panel[2 * width + c]
                + x[3] * panel[3 * width + c] + x[4] * panel[4 * width + c]
            )  # fmt: skip
    else:
        for c in range(width):
            strip[c] = x[0] * panel[c] + x[1] * panel[width + c] + x[2] * panel[2 * width + c]


@njit(**JIT)
def solve(pattern, f, x):
    """x := A^-1 x, in elimination order."""
    N = len(pattern.size)
    for p in range(N):
        own = pattern.start[p]
        for k in range(pattern.low_start[p], pattern.low_start[p + 1]):
            q = pattern.low[k]
            at = pattern.start[q]
            for a in range(pattern.size[p]):
                total = 0.0
                for c in range(pattern.size[q]):
                    total += f.low[k, a, c] * x[at + c]
                x[own + a] -= total
    y = f.strip
    for p in range(N - 1, -1, -1):
        own, m = pattern.start[p], pattern.size[p]
        at, first = pattern.panel_start[p], pattern.up_start[p]
        width = pattern.up_start[p + 1] - first
        for a in range(m):
            total = x[own + a]
            for c in range(width):
                total -= f.panel[at + a * width + c] * x[pattern.up[first + c]]
            y[a] = total
        for a in range(m):
            total = 0.0
            for c in range(m):
                total += f.pivot_inverse[p, a, c] * y[c]
            x[own + a] = total


@njit(**JIT)
def invert(A, m, pivots):
    """A := A^-1 in place by Gauss-Jordan with row pivoting, |pivots| kept; returns the smallest, 0 when singular."""
    smallest = 1e300
    swapped = np.empty(6, dtype=np.int64)
    for k in range(m):
        best = k
        for a in range(k + 1, m):
            if abs(A[a, k]) > abs(A[best, k]):
                best = a
        swapped[k] = best
        pivot = A[best, k]
        pivots[k] = abs(pivot)
        if not abs(pivot) > 0.0:
            return 0.0
        if abs(pivot) < smallest:
            smallest = abs(pivot)
        if best != k:
            for c in range(m):
                A[k, c], A[best, c] = A[best, c], A[k, c]
        scale = 1.0 / pivot
        A[k, k] = 1.0
        for c in range(m):
            A[k, c] *= scale
        for a in range(m):
            if a != k:
                factor_ = A[a, k]
                if factor_ != 0.0:
                    A[a, k] = 0.0
                    for c in range(m):
                        A[a, c] -= factor_ * A[k, c]
    for k in range(m - 1, -1, -1):
        if swapped[k] != k:
            for a in range(m):
                A[a, k], A[a, swapped[k]] = A[a, swapped[k]], A[a, k]
    return smallest
