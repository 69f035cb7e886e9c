"""Sparse matrices of one fixed pattern whose values change in every step: sums of entries, and products.

The pattern is structural and found once; entries that happen to be zero stay in it.
"""

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int, Num


class FixedPattern:
    """A sparse matrix assembled from a fixed list of (row, column) entries; coinciding entries are summed.

    ``place`` is the nonzero that each entry is added to. Nonzeros are ordered by rows, or by columns if ``by_column``.
    """

    def __init__(
        self,
        row: Int[np.ndarray, " m"],
        column: Int[np.ndarray, " m"],
        shape: tuple[int, int],
        *,
        by_column: bool = False,
    ) -> None:
        """Find the distinct places among the entries (``row``, ``column``) of a matrix of this ``shape``, in order."""
        major, minor = (column, row) if by_column else (row, column)
        self.shape, self.by_column = shape, by_column
        n_minor = shape[0] if by_column else shape[1]
        n_major = shape[1] if by_column else shape[0]
        places, self.place = np.unique(major * n_minor + minor, return_inverse=True)  # nonzero each entry adds to
        self.indices = (places % n_minor).astype(np.int32)
        self.major = (places // n_minor).astype(np.int32)
        self.indptr = np.searchsorted(self.major, np.arange(n_major + 1)).astype(np.int32)
        self.nnz = len(places)
        m = len(self.place)
        self._sum = sp.csr_array((np.ones(m), (self.place, np.arange(m))), shape=(self.nnz, m))

    def sum_entries(self, values: Float[np.ndarray, " m"]) -> Float[np.ndarray, " nnz"]:
        """Return the nonzeros of the matrix from the ``values`` of its entries, summed where they coincide."""
        return self._sum @ values

    @property
    def rows(self) -> Int[np.ndarray, " nnz"]:
        """Row of each nonzero."""
        return self.indices if self.by_column else self.major

    @property
    def columns(self) -> Int[np.ndarray, " nnz"]:
        """Column of each nonzero."""
        return self.major if self.by_column else self.indices

    def make_matrix(self, data: Num[np.ndarray, " nnz"]) -> sp.csr_array | sp.csc_array:
        """Return a SciPy array with the nonzeros ``data``: CSC if the pattern is by column, else CSR."""
        kind = sp.csc_array if self.by_column else sp.csr_array
        return kind((data, self.indices, self.indptr), shape=self.shape)


class FixedProduct:
    """The product P Q of two patterns by rows: terms P.data[``p``] Q.data[``q``], the entries of ``pattern``."""

    def __init__(self, P: FixedPattern, Q: FixedPattern) -> None:
        """List the products of nonzeros P_ij Q_jk, and the pattern of their sums over j."""
        count = np.diff(Q.indptr)[P.indices]
        self.p = np.repeat(np.arange(P.nnz), count)
        within = np.arange(len(self.p)) - np.repeat(np.cumsum(count) - count, count)
        self.q = Q.indptr[P.indices[self.p]] + within
        self.pattern = FixedPattern(P.rows[self.p].astype(np.int64), Q.indices[self.q], (P.shape[0], Q.shape[1]))
