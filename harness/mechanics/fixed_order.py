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
    """Return A^-1 by elimination without a choice of pivots: of inertias, of tableaux, of stacks of them."""
    n = A.shape[-1]
    rows = np.concatenate((A, np.broadcast_to(np.eye(n), A.shape)), axis=-1)
    for k in range(n):
        pivot = rows[..., k, :] / rows[..., k, k : k + 1]
        rows = rows - rows[..., :, k : k + 1] * pivot[..., None, :]
        rows[..., k, :] = pivot
    return np.ascontiguousarray(rows[..., n:])
