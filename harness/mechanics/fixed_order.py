"""Small products, summed one term after another: the same bits on every processor, which BLAS does not promise.

For numbers of set-up that enter a motion; NumPy's elementwise products and sums round once each everywhere.
"""

import numpy as np
from jaxtyping import Float


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
    """Return A^-1 of small matrices, inertias and tableaux: by factors with the largest pivot of each column."""
    return np.array([_invert(one) for one in A.reshape(-1, *A.shape[-2:]).tolist()]).reshape(A.shape)


def _invert(A: list[list[float]]) -> list[list[float]]:
    """Row by row as LAPACK's unblocked routines do it, each product rounded before it is subtracted."""
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
