"""S = A M^-1 A^T by blocks of joints, its factor, and solutions with it (compiled).

    S = sum over bodies  X_a J^-1 X_c^T + sign_a sign_c f_a . f_c / m,   f the force of a row, X its torque in the body

A pivot below ``DEPENDENT`` of its own diagonal is that of a redundant row: its multiplier is 0, and the other rows are
solved exactly for right-hand sides that belong to a motion. The rank may change with the configuration. Where kept
rows become dependent although the rank stays the same, module ``row_choice`` chooses others.

The three point rows of a hinge are taken across its axis and then along it, in any frame: in a planar mechanism the
row along the axis is redundant itself. Along the axes of space each of the three would have a share of the redundancy,
and rounding would decide which one is left out.

``k`` is a ``Kernel``; in ``L`` its columns ``col`` are joints in elimination order, each of blocks ``p`` (``Blocks``).
"""

import math

from .algebra import multiply
from .blocks import WIDTH
from .entries import compile_inline, compile_inline_fused

# share of the row's own entry of S: rounding leaves 1e-15, the weakest true pivots here are 1e-4. Of four runs of
# RATTLE with redundant rows half changes none, twice 7 of 12,282 iterations of one.
DEPENDENT = 1e-9
ALIGNED = 1e-12  # a hinge's axis is an axis of space where its other components are below this: rows are not turned
HINGE = 5  # rows of a part whose first three can be turned: point rows with two axis rows


def factorise(k):
    """Assemble S = A M^-1 A^T from ``k.X``, ``k.Y``, ``k.way`` in ``k.L`` and factorise it there."""
    _factorise(k, WIDTH)


def factorise_points(k):
    """Assemble and factorise S like ``factorise``, for systems in which no joint has more than three rows."""
    _factorise(k, 3)


def solve(k):
    """Set ``k.rhs`` := S^-1 rhs with the factor in ``k.L``; redundant rows get 0."""
    _solve(k, WIDTH)


def solve_points(k):
    """Set ``k.rhs`` := S^-1 rhs like ``solve``, by blocks of three rows: no joint may have more (not checked)."""
    _solve(k, 3)


@compile_inline_fused
def _factorise(k, W):
    """Assemble S in blocks (W, W), then factorise it in place; ``k.state.rank`` becomes the number of rows kept."""
    assemble(k, W)
    eliminate(k, W)


@compile_inline_fused
def assemble(k, W):
    """Assemble S in ``k.L``, in blocks (W, W), and copy its diagonal to ``k.diagonal``.

    ``k.state.shift`` times the diagonal is added to it first: with a shift above ``DEPENDENT`` no row is dropped.
    """
    b, L, nj = k.blocks, k.L, len(k.blocks.joint)
    if W == HINGE:
        _find_axes(k)
    for p in range(len(b.other)):
        for a in range(W):
            for c in range(W):
                L[p, a, c] = 0.0
    for col in range(nj):
        jc, size = b.joint[col], b.size[col]
        for p in range(b.start[col], b.start[col + 1]):
            ja, height = b.joint[b.other[p]], b.size[b.other[p]]
            at, to = b.row[b.other[p]], b.row[col]
            for t in range(b.shared_start[p], b.shared_start[p + 1]):
                ea, ec = b.shared[t, 1], b.shared[t, 2]
                weight = (1.0 - 2.0 * ea) * (1.0 - 2.0 * ec) / k.mass[k.body[jc, ec]]
                if size == W:
                    _add_rotational_part(k.X, k.Y, L, p, at, ea, to, ec, W, height)
                else:
                    _add_rotational_part(k.X, k.Y, L, p, at, ea, to, ec, size, height)
                if k.pins[ja] and k.pins[jc]:
                    for a in range(3):
                        L[p, a, a] += weight
                else:
                    _add_translational_part(k.way, at, to, height, size, weight, L, p)
        for a in range(size):
            L[b.start[col], a, a] *= 1.0 + k.state.shift
        if W == HINGE:
            _turn_blocks(k, col)
        for a in range(size):
            k.diagonal[b.row[col] + a] = L[b.start[col], a, a]


@compile_inline_fused
def eliminate(k, W):
    """Factorise S in ``k.L`` in place by block Cholesky; ``k.state.rank`` becomes the number of rows kept.

    Rows that depend on earlier ones, and those whose ``k.diagonal`` is infinite, are left out.
    """
    b, L, nj, rank = k.blocks, k.L, len(k.blocks.joint), 0
    for col in range(nj):
        d, size = b.start[col], b.size[col]
        rank += _decompose_diagonal_block(L, d, size, k.diagonal, b.row[col])
        for p in range(d + 1, b.start[col + 1]):  # L_pd = S_pd L_dd^-T
            height = b.size[b.other[p]]
            if size == W:  # a constant size unrolls the loops: half the time of a full block
                _divide_by_diagonal(L, p, d, W, height)
            else:
                _divide_by_diagonal(L, p, d, size, height)
        for t in range(b.update_start[col], b.update_start[col + 1]):
            target, left, right = b.update[t, 0], b.update[t, 1], b.update[t, 2]
            for a in range(W):
                for c in range(W):
                    x = 0.0
                    for q in range(W):
                        x += L[left, a, q] * L[right, c, q]
                    L[target, a, c] -= x
    k.state.rank = rank


@compile_inline_fused
def _solve(k, W):
    """Set ``k.rhs`` := S^-1 rhs by forward and back substitution with blocks (W, W)."""
    b, L, x, nj = k.blocks, k.L, k.rhs, len(k.blocks.joint)
    if W == HINGE:
        turn_rows(k, x)
    for col in range(nj):
        d, size, row = b.start[col], b.size[col], b.row[col]
        for a in range(size):
            y = x[row + a]
            for q in range(a):
                y -= L[d, a, q] * x[row + q]
            x[row + a] = y * L[d, a, a]
        for p in range(d + 1, b.start[col + 1]):
            at, height = b.row[b.other[p]], b.size[b.other[p]]
            if size == W:
                _subtract(L, p, x, row, W, at, height)
            else:
                _subtract(L, p, x, row, size, at, height)
    for col in range(nj - 1, -1, -1):
        d, size, row = b.start[col], b.size[col], b.row[col]
        for p in range(d + 1, b.start[col + 1]):
            at, height = b.row[b.other[p]], b.size[b.other[p]]
            if size == W:
                _subtract_transposed(L, p, x, row, W, at, height)
            else:
                _subtract_transposed(L, p, x, row, size, at, height)
        for a in range(size - 1, -1, -1):
            y = x[row + a]
            for q in range(a + 1, size):
                y -= L[d, q, a] * x[row + q]
            x[row + a] = y * L[d, a, a]
    if W == HINGE:
        turn_rows_back(k, x)


@compile_inline
def _find_axes(k):
    """Set ``k.turn`` to the directions of each hinge's point rows: two across its axis, then the axis, in space.

    Where the point rows stay along the axes of space, row 0 of its matrix has no x and no y component.
    """
    b = k.blocks
    for col in range(len(b.joint)):
        j, row, Q = b.joint[col], b.row[col], k.turn[col]
        Q[0, 0] = Q[0, 1] = Q[0, 2] = 0.0
        if k.pins[j] == 0 or b.size[col] != HINGE:
            continue
        X, R = k.X[0], k.R[k.body[j, 0]]  # torques of the two axis rows are normal to the axis
        x = X[row + 3, 1] * X[row + 4, 2] - X[row + 3, 2] * X[row + 4, 1]
        y = X[row + 3, 2] * X[row + 4, 0] - X[row + 3, 0] * X[row + 4, 2]
        z = X[row + 3, 0] * X[row + 4, 1] - X[row + 3, 1] * X[row + 4, 0]
        a = multiply(R, x, y, z)
        size = math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
        if size > 0.0:
            _set_directions(Q, a[0] / size, a[1] / size, a[2] / size)


@compile_inline
def _set_directions(Q, x, y, z):
    """Set the rows of Q to two directions across a hinge's axis (x, y, z) in space, and to the axis.

    The first is also normal to the axis of space along which (x, y, z) has its smallest component. Q is left unchanged
    if the hinge's axis is an axis of space.
    """
    least, u, v, w = abs(z), -y, x, 0.0
    if abs(y) < least:
        least, u, v, w = abs(y), z, 0.0, -x
    if abs(x) < least:
        u, v, w = 0.0, -z, y
    size = math.sqrt(u * u + v * v + w * w)
    u, v, w = u / size, v / size, w / size
    if max(min(abs(x), abs(y)), min(abs(y), abs(z)), min(abs(x), abs(z))) < ALIGNED:
        return
    Q[0, 0], Q[0, 1], Q[0, 2] = u, v, w
    Q[1, 0], Q[1, 1], Q[1, 2] = y * w - z * v, z * u - x * w, x * v - y * u
    Q[2, 0], Q[2, 1], Q[2, 2] = x, y, z


@compile_inline
def _is_turned(Q):
    """Return whether Q, of ``k.turn``, has directions of a hinge's point rows: the first of them is never along z."""
    return Q[0, 0] != 0.0 or Q[0, 1] != 0.0


@compile_inline
def _turn_blocks(k, col):
    """Rotate the blocks of S in column ``col``: point rows along the axes of space become those of the hinges."""
    b, L, Q = k.blocks, k.L, k.turn[col]
    for p in range(b.start[col], b.start[col + 1]):
        P = k.turn[b.other[p]]
        if _is_turned(P):
            for c in range(b.size[col]):
                x, y, z = L[p, 0, c], L[p, 1, c], L[p, 2, c]
                for a in range(3):
                    L[p, a, c] = P[a, 0] * x + P[a, 1] * y + P[a, 2] * z
        if _is_turned(Q):
            for a in range(b.size[b.other[p]]):
                x, y, z = L[p, a, 0], L[p, a, 1], L[p, a, 2]
                for c in range(3):
                    L[p, a, c] = Q[c, 0] * x + Q[c, 1] * y + Q[c, 2] * z


@compile_inline
def turn_rows(k, x):
    """Rotate the point rows of hinges in x (nrows,), in place, from the axes of space to directions of ``k.turn``."""
    b = k.blocks
    for col in range(len(b.joint)):
        Q, row = k.turn[col], b.row[col]
        if _is_turned(Q):
            u, v, w = x[row], x[row + 1], x[row + 2]
            for a in range(3):
                x[row + a] = Q[a, 0] * u + Q[a, 1] * v + Q[a, 2] * w


@compile_inline
def turn_rows_back(k, x):
    """Rotate the point rows of hinges in x (nrows,), in place, from directions of ``k.turn`` to the axes of space."""
    b = k.blocks
    for col in range(len(b.joint)):
        Q, row = k.turn[col], b.row[col]
        if _is_turned(Q):
            u, v, w = x[row], x[row + 1], x[row + 2]
            for a in range(3):
                x[row + a] = Q[0, a] * u + Q[1, a] * v + Q[2, a] * w


@compile_inline_fused
def _add_rotational_part(X, Y, L, p, at, ea, to, ec, size, height):
    """Add X J^-1 X^T, the rotational part of S for two joints at one body, to block ``p`` of L.

    The ``height`` rows from ``at`` on, at their end ``ea``, meet the ``size`` rows from ``to`` on, at their end ``ec``.
    """
    for a in range(height):
        x0, x1, x2 = X[ea, at + a, 0], X[ea, at + a, 1], X[ea, at + a, 2]
        for c in range(size):
            L[p, a, c] += x0 * Y[ec, to + c, 0] + x1 * Y[ec, to + c, 1] + x2 * Y[ec, to + c, 2]


@compile_inline_fused
def _add_translational_part(way, at, to, height, size, weight, L, p):
    """Add weight f_a . f_c, the translational part of S for two joints at one body, to block ``p`` of L.

    f are the forces ``way`` of the ``height`` rows from ``at`` on and of the ``size`` rows from ``to`` on; ``weight``
    is 1/m times the signs of both ends.
    """
    for a in range(height):
        f0, f1, f2 = way[at + a, 0], way[at + a, 1], way[at + a, 2]
        for c in range(size):
            L[p, a, c] += weight * (f0 * way[to + c, 0] + f1 * way[to + c, 1] + f2 * way[to + c, 2])


@compile_inline_fused
def _divide_by_diagonal(L, p, d, size, height):
    """Set block p (height, size) of L := L_p L_d^-T, where d is the factorised diagonal block of its column."""
    for a in range(height):
        for c in range(size):
            x = L[p, a, c]
            for q in range(c):
                x -= L[p, a, q] * L[d, c, q]
            L[p, a, c] = x * L[d, c, c]


@compile_inline_fused
def _subtract(L, p, x, row, size, at, height):
    """Subtract block p (height, size) times x[row:] from x[at:], in the forward substitution."""
    for a in range(height):
        y = 0.0
        for q in range(size):
            y += L[p, a, q] * x[row + q]
        x[at + a] -= y


@compile_inline_fused
def _subtract_transposed(L, p, x, row, size, at, height):
    """Subtract block p (height, size), transposed, times x[at:] from x[row:], in the back substitution."""
    for a in range(height):
        y = x[at + a]
        for q in range(size):
            x[row + q] -= L[p, a, q] * y


@compile_inline_fused
def _decompose_diagonal_block(L, d, size, diagonal, row):
    """Factorise the diagonal block d by Cholesky, with its diagonal inverted; return the number of rows kept.

    The inverse is 0 in a row whose pivot is below ``DEPENDENT`` times its entry of ``diagonal``, from index ``row`` on.
    """
    kept = 0
    for c in range(size):
        x = L[d, c, c]
        for q in range(c):
            x -= L[d, c, q] * L[d, c, q]
        inverse = 1.0 / math.sqrt(x) if x > DEPENDENT * diagonal[row + c] else 0.0
        kept += inverse > 0.0
        L[d, c, c] = inverse
        for a in range(c + 1, size):
            x = L[d, a, c]
            for q in range(c):
                x -= L[d, a, q] * L[d, c, q]
            L[d, a, c] = x * inverse
    return kept
