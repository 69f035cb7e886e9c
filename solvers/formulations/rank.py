"""Which constraint rows to keep, without a dense matrix: pivots of a banded Cholesky of A A^T.

Rows are scaled to length one and reordered (reverse Cuthill-McKee). A little is added to the diagonal, so that the
factorisation goes through; the squared pivot of a row is then its squared distance from the span of the rows before
it, or that little if it depends on them. On the four-bar grid the two kinds are 1e-12 and 8e-3, on one of 20 x 20
cells 1e-12 and 8e-5. Pivots between the two bounds leave the choice to a pivoted QR.
"""

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int
from scipy.linalg import lapack
from scipy.sparse.csgraph import reverse_cuthill_mckee

from ...harness.mechanics.jacobian import even_jacobian, independent_rows
from ...harness.mechanics.state import State
from ...harness.mechanics.system import MultibodySystem

ADDED = 1e-13  # to the unit diagonal: a thousand roundings
DEPENDENT, INDEPENDENT = 1e-10, 1e-8  # squared distances: below, above


def rows_to_keep(system: MultibodySystem, state: State) -> Int[np.ndarray, " rank"]:
    """A maximal set of independent rows of A at ``state``, in row order."""
    if system.nrows == 0:
        return np.zeros(0, dtype=np.int64)
    distance = squared_distances(system, state)
    if np.any((distance > DEPENDENT) & (distance < INDEPENDENT)):
        return independent_rows(system, state)
    return np.flatnonzero(distance >= INDEPENDENT)


def squared_distances(system: MultibodySystem, state: State) -> Float[np.ndarray, " nrows"]:
    """Of each row, scaled to length one, from the span of those before it in the band's order."""
    A = even_jacobian(system, state)
    S = sp.csr_matrix(A @ A.T)
    order = reverse_cuthill_mckee(S, symmetric_mode=True)
    entries = S[order][:, order].tocoo()
    i, j = entries.row, entries.col
    lower = i >= j
    band = np.zeros((int(np.max(i - j)) + 1, system.nrows), order="F")
    band[(i - j)[lower], j[lower]] = entries.data[lower]
    band[0] += ADDED
    factor, info = lapack.dpbtrf(band, lower=1)
    out = np.full(system.nrows, np.sqrt(DEPENDENT * INDEPENDENT))  # undecided, in case rounding exceeds ADDED
    if info == 0:
        out[order] = factor[0] ** 2
    return out
