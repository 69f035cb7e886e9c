"""Factor K = [[1, S^T], [S, -e]] for sparse rows S, instant after instant of a motion, by SuperLU.

Before it factors, SuperLU orders the unknowns by the pattern of K alone, which takes half of the time. Most instants of
a motion have one pattern: from its second K on, the order of the first is used, and all numbers have the same bits.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import TypeVar

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

Matrix = TypeVar("Matrix", sparse.csr_array, sparse.csc_array)
Solve = Callable[[np.ndarray], np.ndarray]
PATTERNS = 8  # patterns that are remembered: exact zeros, which differ between instants, are no part of one
ONE = 1.0  # stands in for the numbers of the first block, and its negative for -e; those of S are larger


def factor_bordered(S: sparse.csr_array, regular: float) -> tuple[sparse.csr_array, Solve]:
    """Return S^T, and a function that returns the solution y of K y = b for a vector b (n + k,).

    S has k rows and n columns; ``regular`` is e in K. S^T (n, k) is returned by rows: callers multiply by it.
    """
    pattern = _recall_pattern(S.indptr.tobytes(), S.indices.tobytes(), S.shape)
    if pattern.order is None:
        St = S.T.tocsr()
        factor = splu(border_rows(S, St, regular))
        pattern.order = np.argsort(factor.perm_c)
        return St, factor.solve
    return pattern.factor(S, regular)


class _Pattern:
    """The order of the unknowns of K for one pattern of S, and the places in S that the numbers of K come from."""

    order: np.ndarray | None = None  # old number of each unknown, as SuperLU ordered them; None before the first K
    turned: sparse.csr_array | None = None  # S^T with the places of its numbers in S as numbers
    ordered: sparse.csc_array | None = None  # K with unknowns in order, and places in S as numbers, then of 1 and -e

    def factor(self, S: sparse.csr_array, regular: float) -> tuple[sparse.csr_array, Solve]:
        """Factor K as ``factor_bordered`` does, in the known ``order`` of unknowns; return the same.

        The first call finds where each number of K stands in S.
        """
        order, count = self.order, S.nnz
        assert order is not None
        if self.turned is None or self.ordered is None:
            # K of numbers that say where K's come from: 2, 3, ... from S in its order, 1 and -1 from the diagonal
            named = sparse.csr_array((np.arange(count) + 2.0 * ONE, S.indices, S.indptr), shape=S.shape)
            turned = named.T.tocsr()
            K = border_rows(named, turned, ONE)[:, order]
            places = np.where(K.data > ONE, K.data - 2.0 * ONE, np.where(K.data > 0.0, count, count + 1))
            # rows are renumbered alike, so that a pivot on the diagonal stays there
            rows = np.argsort(order)[K.indices].astype(np.int32)
            self.turned = _replace(turned, (turned.data - 2.0 * ONE).astype(np.int64))
            self.ordered = sparse.csc_array((places.astype(np.int64), rows, K.indptr.astype(np.int32)), shape=K.shape)
        St = _replace(self.turned, S.data[self.turned.data])
        K = _replace(self.ordered, np.concatenate((S.data, [1.0, -regular]))[self.ordered.data])
        K.has_canonical_format = True  # else rows would be sorted, and sums added in another order
        factor = splu(K, permc_spec="NATURAL")

        def solve(b: np.ndarray) -> np.ndarray:
            """Return the solution y of K y = b."""
            y = np.empty_like(b)
            y[order] = factor.solve(b[order])
            return y

        return St, solve


@lru_cache(PATTERNS)
def _recall_pattern(starts: bytes, columns: bytes, shape: tuple[int, int]) -> _Pattern:
    """Return the ``_Pattern`` of these row starts and columns: the same object as before, if it is remembered."""
    return _Pattern()


def _replace(a: Matrix, data: np.ndarray) -> Matrix:
    """Return a matrix of the pattern of ``a`` with the numbers ``data``."""
    return type(a)((data, a.indices, a.indptr), shape=a.shape)


def border_rows(S: sparse.csr_array, St: sparse.csr_array, regular: float) -> sparse.csc_array:
    """Return K = [[1, S^T], [S, -``regular``]] by columns, equal to SciPy's ``block_array`` in a tenth of its time.

    ``St`` is S^T by rows.
    """
    (k, n), rows = S.shape, S.sorted_indices()
    before, after = St.indptr[:-1], rows.indptr[1:]  # the diagonal comes first in the left columns, last in the right
    data = np.insert(St.data, before, 1.0), np.insert(rows.data, after, -regular)
    indices = np.insert(n + St.indices, before, np.arange(n)), np.insert(rows.indices, after, n + np.arange(k))
    start = St.indptr + np.arange(n + 1), St.nnz + n + after + np.arange(1, k + 1)
    arrays = np.concatenate(data), np.concatenate(indices), np.concatenate(start)
    return sparse.csc_array(arrays, shape=(n + k, n + k))
