"""Block LU on a fixed pattern, row by row: A = L U with unit block-lower L; pivoting inside the pivot blocks only.

Row p copies its original blocks to a dense strip, subtracts the rows q < p with which it shares a block (one small
product per pair, contiguous in the columns of q), inverts its pivot block and stores its panel of U. The reason for
writing this rather than using a library: docs/decisions/block-lu.md.
"""

from .entries import compile_inline_fused


def factor(lu):
    """Compute the block factors L U of the matrix in ``lu.blocks``, in the arrays of ``lu``.

    ``lu.state.singular`` becomes 0, or 1 + p where node p has a singular pivot block and the elimination has stopped.
    """
    _factor(lu)


def solve(lu):
    """Replace the right side ``lu.x`` by the solution of A x = right side, unknowns in elimination order."""
    _solve(lu, lu.x)


@compile_inline_fused
def _factor(lu):
    """Compute the block factors row by row, as ``factor`` describes, in the dense row ``lu.dense``."""
    blocks, state = lu.blocks, lu.state
    W, panel, inverse, low, strip = lu.dense, lu.panel, lu.pivot_inverse, lu.low, lu.strip
    size, start, up, up_start = lu.size, lu.start, lu.up, lu.up_start
    panel_start, low_start, low_node = lu.panel_start, lu.low_start, lu.low_node
    pair_start, pair_column, pair_width, pair_place = lu.pair_start, lu.pair_column, lu.pair_width, lu.pair_place
    state.singular = 0
    for p in range(len(size)):
        m, own = size[p], start[p]
        for pair in range(pair_start[p], pair_start[p + 1]):
            at, width, place = pair_column[pair], pair_width[pair], pair_place[pair]  # an original block of row p
            for a in range(m):
                for c in range(width):
                    W[a, at + c] += blocks[place + a * width + c]
        for k in range(low_start[p], low_start[p + 1]):
            # row p -= (its block over node q) U_qq^-1 times the panel of q
            q = low_node[k]
            inner, at, first = size[q], start[q], up_start[q]
            width, offset = up_start[q + 1] - first, panel_start[q]
            for a in range(m):
                for c in range(6):
                    low[k, a, c] = 0.0
                for b in range(inner):  # in this order the sums are independent of each other
                    weight = W[a, at + b]
                    W[a, at + b] = 0.0
                    for c in range(6):
                        low[k, a, c] += weight * inverse[q, b, c]
                _combine(low, k, a, panel, offset, inner, width, strip)
                for c in range(width):
                    W[a, up[first + c]] -= strip[c]
        for a in range(m):
            for c in range(m):
                inverse[p, a, c] = W[a, own + c]
                W[a, own + c] = 0.0
        smallest = invert(inverse[p], m, lu.pivot[own:], lu.swapped)
        offset, first = panel_start[p], up_start[p]
        width = up_start[p + 1] - first
        for a in range(m):
            for c in range(width):
                panel[offset + a * width + c] = W[a, up[first + c]]
                W[a, up[first + c]] = 0.0
        if not smallest > 0.0:
            state.singular = 1 + p
            break


@compile_inline_fused
def _combine(low, k, a, panel, o, inner, w, strip):
    """Set strip := low[k, a, :inner] @ P, unrolled for the usual sizes 3, 5 and 6 of a node.

    P (inner, w) is stored by rows in ``panel``, from index ``o`` on.
    """
    if inner < 3 or inner == 4:
        for c in range(w):
            strip[c] = 0.0
            for b in range(inner):
                strip[c] += low[k, a, b] * panel[o + b * w + c]
        return
    x0, x1, x2 = low[k, a, 0], low[k, a, 1], low[k, a, 2]
    if inner == 3:
        for c in range(w):
            strip[c] = x0 * panel[o + c] + x1 * panel[o + w + c] + x2 * panel[o + 2 * w + c]
        return
    x3, x4, x5 = low[k, a, 3], low[k, a, 4], low[k, a, 5]
    for c in range(w):
        strip[c] = (
            x0 * panel[o + c]
            + x1 * panel[o + w + c]
            + x2 * panel[o + 2 * w + c]
            + x3 * panel[o + 3 * w + c]
            + x4 * panel[o + 4 * w + c]
        )
    if inner == 6:
        for c in range(w):
            strip[c] += x5 * panel[o + 5 * w + c]


@compile_inline_fused
def _solve(lu, x):
    """Replace the right side ``x``, in elimination order, by the solution: forward, then back substitution."""
    size, start, up, up_start = lu.size, lu.start, lu.up, lu.up_start
    panel_start, low_start, low_node = lu.panel_start, lu.low_start, lu.low_node
    low, panel, inverse, y = lu.low, lu.panel, lu.pivot_inverse, lu.strip
    N = len(size)
    for p in range(N):
        own = start[p]
        for k in range(low_start[p], low_start[p + 1]):
            q = low_node[k]
            at = start[q]
            for c in range(size[q]):
                weight = x[at + c]
                for a in range(size[p]):
                    x[own + a] -= low[k, a, c] * weight
    for p in range(N - 1, -1, -1):
        own, m = start[p], size[p]
        at, first = panel_start[p], up_start[p]
        width = up_start[p + 1] - first
        for a in range(m):
            y[a] = x[own + a]
        for c in range(width):
            weight = x[up[first + c]]
            for a in range(m):
                y[a] -= panel[at + a * width + c] * weight
        for a in range(m):
            total = 0.0
            for c in range(m):
                total += inverse[p, a, c] * y[c]
            x[own + a] = total


@compile_inline_fused
def invert(A, m, pivots, swapped):
    """Invert A (m x m) in place by Gauss-Jordan elimination with row pivoting; return the smallest absolute pivot.

    Where A is singular, 0 is returned and A is left half inverted. ``pivots`` (m,) is set to the absolute pivots,
    ``swapped`` (m,) to the row that each row was exchanged with.
    """
    smallest = 1e300
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
        smallest = min(smallest, abs(pivot))
        if best != k:
            for c in range(m):
                A[k, c], A[best, c] = A[best, c], A[k, c]
        A[k, k] = 1.0
        for c in range(m):
            A[k, c] /= pivot
        for a in range(m):
            if a != k:
                weight = A[a, k]
                A[a, k] = 0.0
                for c in range(m):
                    A[a, c] -= weight * A[k, c]
    for k in range(m - 1, -1, -1):
        if swapped[k] != k:
            for a in range(m):
                A[a, k], A[a, swapped[k]] = A[a, swapped[k]], A[a, k]
    return smallest
