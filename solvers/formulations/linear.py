"""Factorisations of matrices of one fixed pattern, given by their nonzeros: full, banded or sparse, as the band is."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Int, Num
from scipy.linalg import lapack
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import splu

from .sparse_pattern import FixedPattern

DENSE_BELOW = 40  # unknowns; below, a full LU is faster than a sparse one's bookkeeping
BAND_WORK = 2e7  # products in a factorisation of a band, beyond which SuperLU is faster
Solve = Callable[[Num[np.ndarray, " n"]], Num[np.ndarray, " n"]]


class Band(NamedTuple):
    """The order of unknowns and equations with the narrowest band found (reverse Cuthill-McKee), and its widths."""

    order: Int[np.ndarray, " n"]  # ours, by theirs
    place: Int[np.ndarray, " n"]  # theirs, by ours
    row: Int[np.ndarray, " nnz"]  # of each nonzero, in their order
    column: Int[np.ndarray, " nnz"]
    below: int
    above: int

    @property
    def work(self) -> float:
        """Products in a factorisation."""
        return float(len(self.order) * self.below * (self.below + self.above))


def find_band(pattern: FixedPattern) -> Band:
    """The band of a square pattern."""
    ones = sp.csr_matrix((np.ones(pattern.nnz), (pattern.rows, pattern.columns)), shape=pattern.shape)
    order = reverse_cuthill_mckee(sp.csr_matrix(ones + ones.T), symmetric_mode=True)
    place = np.argsort(order)
    row, column = place[pattern.rows], place[pattern.columns]
    return Band(order, place, row, column, int(np.max(row - column)), int(np.max(column - row)))


def factoriser(pattern: FixedPattern) -> Callable[[Num[np.ndarray, " nnz"]], Solve]:
    """What factorises a matrix, real or complex, and returns the solve; RuntimeError if it is singular."""
    if pattern.shape[0] < DENSE_BELOW:
        return lambda data: _factorise_full(pattern.dense(data))
    band = find_band(pattern)
    if band.work > BAND_WORK:
        return lambda data: splu(pattern.column_matrix(data)).solve
    return _banded(band)


def _factorise_full(matrix: np.ndarray) -> Solve:
    kind = "z" if np.iscomplexobj(matrix) else "d"
    factors, pivots, _ = getattr(lapack, f"{kind}getrf")(matrix)  # a zero pivot gives inf, which Newton then rejects
    substitute = getattr(lapack, f"{kind}getrs")
    return lambda right: substitute(factors, pivots, right)[0]


def _banded(band: Band) -> Callable[[np.ndarray], Solve]:
    n, below, above = len(band.order), band.below, band.above
    height = 2 * below + above + 1
    entries = band.column * height + below + above + band.row - band.column

    def factorise(data: np.ndarray) -> Solve:
        storage = np.zeros(n * height, dtype=data.dtype)
        storage[entries] = data
        kind = "z" if np.iscomplexobj(data) else "d"
        matrix = storage.reshape(n, height).T
        factors, pivots, info = getattr(lapack, f"{kind}gbtrf")(matrix, below, above, overwrite_ab=1)
        if info != 0:
            raise RuntimeError("Factor is exactly singular")
        substitute = getattr(lapack, f"{kind}gbtrs")

        def solve(right: np.ndarray) -> np.ndarray:
            return substitute(factors, below, above, right.take(band.order), pivots, overwrite_b=1)[0].take(band.place)

        return solve

    return factorise
