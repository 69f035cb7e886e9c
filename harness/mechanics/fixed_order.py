"""Compute small linear algebra term by term, with the same bits everywhere, which BLAS and LAPACK do not guarantee.

It serves numbers of the set-up that enter a motion. NumPy's elementwise products and sums round once on any processor.
"""

import numpy as np
from jaxtyping import Float

SWEEPS = 8  # sweeps of Jacobi's rotations over a matrix of three rows: converged to rounding after five


def product(A: Float[np.ndarray, "*stack m k"], B: Float[np.ndarray, "*stack k n"]) -> Float[np.ndarray, "*stack m n"]:
    """Return A B, of matrices or of stacks of them."""
    out = A[..., :, :1] * B[..., :1, :]
    for k in range(1, A.shape[-1]):
        out = out + A[..., :, k : k + 1] * B[..., k : k + 1, :]
    return np.asarray(out)


def apply(A: Float[np.ndarray, "*stack m k"], x: Float[np.ndarray, "*stack k"]) -> Float[np.ndarray, "*stack m"]:
    """Return A x, of a matrix and a vector or of stacks of them."""
    return product(A, x[..., None])[..., 0]


def dot(a: Float[np.ndarray, " k"], b: Float[np.ndarray, " k"]) -> float:
    """Return a . b."""
    out = 0.0
    for x, y in zip(a.tolist(), b.tolist(), strict=True):
        out += x * y
    return out


def inverse(A: Float[np.ndarray, "*stack n n"]) -> Float[np.ndarray, "*stack n n"]:
    """Return the inverse of a small matrix or a stack of them, by elimination with the largest pivot of each column."""
    return np.array([_invert(one) for one in A.reshape(-1, *A.shape[-2:]).tolist()]).reshape(A.shape)


def _invert(A: list[list[float]]) -> list[list[float]]:
    """Return the rows of A^-1 by Gauss elimination with row pivots, in the order of LAPACK's unblocked routines.

    Products are rounded before they are subtracted.
    """
    n = len(A)
    rows = [[*row, *(float(i == k) for k in range(n))] for i, row in enumerate(A)]
    for k in range(n):
        best = max(range(k, n), key=lambda i: abs(rows[i][k]))
        rows[k], rows[best] = rows[best], rows[k]
        reciprocal = 1.0 / rows[k][k]
        for i in range(k + 1, n):
            factor = rows[i][k] * reciprocal
            for j in range(k + 1, 2 * n):
                rows[i][j] -= factor * rows[k][j]
    for k in reversed(range(n)):
        for j in range(n, 2 * n):
            total = rows[k][j]
            for i in range(k + 1, n):
                total -= rows[k][i] * rows[i][j]
            rows[k][j] = total / rows[k][k]
    return [row[n:] for row in rows]


def principal_axes(
    inertia: Float[np.ndarray, "*stack 3 3"],
) -> tuple[Float[np.ndarray, "*stack 3"], Float[np.ndarray, "*stack 3 3"]]:
    """Return principal inertias [kg m2], ascending, and principal axes as columns, by Jacobi's rotations."""
    A = np.moveaxis(np.array(inertia, dtype=float), (-2, -1), (0, 1))
    V = np.array(np.broadcast_to(np.eye(3).reshape(3, 3, *[1] * (A.ndim - 2)), A.shape))
    for p, q in [(0, 1), (0, 2), (1, 2)] * SWEEPS:
        turning = A[p, q] != 0.0
        if not np.any(turning):
            continue
        with np.errstate(over="ignore"):  # entries that are rounding beside the diagonal need no rotation
            ratio = 0.5 * (A[q, q] - A[p, p]) / np.where(turning, A[p, q], 1.0)
            t = np.where(turning, np.copysign(1.0, ratio) / (np.abs(ratio) + np.sqrt(1.0 + ratio * ratio)), 0.0)
        c = 1.0 / np.sqrt(1.0 + t * t)  # cosine of the rotation in the plane p, q that makes A[p, q] zero
        s = t * c
        for M in (A, V):
            M[:, p], M[:, q] = c * M[:, p] - s * M[:, q], s * M[:, p] + c * M[:, q]
        A[p], A[q] = c * A[p] - s * A[q], s * A[p] + c * A[q]
        A[p, q] = A[q, p] = 0.0
    moments = np.moveaxis(A[range(3), range(3)], 0, -1)
    order = np.argsort(moments, axis=-1, kind="stable")
    axes = np.take_along_axis(np.moveaxis(V, (0, 1), (-2, -1)), order[..., None, :], axis=-1)
    return np.take_along_axis(moments, order, axis=-1), axes
