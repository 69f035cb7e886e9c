"""Choose the constraint rows to keep, at the start by the pivots of a banded Cholesky factorisation of A A^T.

Rows are scaled to length one and taken joint by joint, so that those left out all belong to joints that close a loop:
rows of a tree never become dependent, however it moves. In a planar loop the kept rows then stay independent as long
as all rows together keep their rank.

A small number is added to the diagonal, so that the factorisation succeeds. The squared pivot of a row is then its
squared distance from the span of the rows before it, or about that small number if it depends on them. On the four-bar
grid the two kinds are 0.1 and 2e-12, and so they are for 20 x 20 grid cells. Where a pivot is between the two bounds,
an orthogonalisation decides, joint by joint in the same order.
"""

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int
from scipy.sparse.csgraph import reverse_cuthill_mckee

from ...harness.base.generated import Program
from ...harness.mechanics.jacobian import factor_with_pivots, scale_jacobian
from ...harness.mechanics.state import State
from ...harness.mechanics.system import GROUND, MultibodySystem
from .linear import BandFactors

ADDED = 1e-13  # added to the unit diagonal: a thousand roundings; half, twice: no bit changes, nor by those of DISTANT
# squared distances below, above; an independent row of d makes dependent ones of ADDED / d
# (half and twice of either change none of ten runs with redundant rows)
DEPENDENT, INDEPENDENT = 1e-10, 1e-4
DISTANT = 1e-9  # distance of an independent row from those before it, by orthogonalisation
# factor of the least singular value at which rows are changed. Of ten runs of rk45_strong_form and ida_index1 half
# leads one past a singular pose and another into one, and changes two more by 5 % of their evaluations; twice changes
# those on Bennett's linkages by -9 to 18 %.
BETTER = 2.0


def rows_to_keep(system: MultibodySystem, state: State) -> Int[np.ndarray, " rank"]:
    """Return a maximal set of independent constraint rows (rows of A) at ``state``, in ascending order."""
    if system.nrows == 0:
        return np.zeros(0, dtype=np.int64)
    distance = squared_distances(system, state)
    if np.any((distance > DEPENDENT) & (distance < INDEPENDENT)):
        return _choose_by_orthogonalisation(system, state)
    return np.flatnonzero(distance >= INDEPENDENT)


def find_better_rows(system: MultibodySystem, state: State, kept: Int[np.ndarray, " k"]) -> Int[np.ndarray, " k"]:
    """Return the indices of as many constraint rows as ``kept``, chosen anew at ``state``, or ``kept`` itself.

    The choice is that of a QR factorisation with pivots, on rows scaled to length one. The result is ``kept`` unless
    the least singular value of the rows chosen is more than ``BETTER`` times that of ``kept``.
    """
    A = scale_jacobian(system, state).toarray()
    best = np.sort(factor_with_pivots(A.T)[2][: len(kept)])
    least = [np.linalg.svd(A[rows], compute_uv=False)[-1] for rows in (kept, best)]
    return best if least[1] > BETTER * least[0] else kept


def least_singular_value(system: MultibodySystem, state: State, kept: Int[np.ndarray, " k"]) -> float:
    """Return the least singular value of the rows ``kept`` of A at ``state``, each scaled to length one."""
    return float(np.linalg.svd(scale_jacobian(system, state).toarray()[kept], compute_uv=False)[-1])


def squared_distances(system: MultibodySystem, state: State) -> Float[np.ndarray, " nrows"]:
    """Return the squared distance of each constraint row, of length one, from the span of those before it.

    Rows are taken joint by joint, the closing joint of a loop last. If rounding stops the factorisation, all distances
    are set between ``DEPENDENT`` and ``INDEPENDENT``, which leaves all rows undecided.
    """
    A = scale_jacobian(system, state)
    S = sp.csr_matrix(A @ A.T)
    place = np.argsort(_order_joints(system))
    order = np.lexsort((-np.arange(system.nrows), np.repeat(place, system.joint_rows)))
    entries = S[order][:, order].tocoo()
    i, j = entries.row, entries.col
    lower = i >= j
    height = int(np.max(i - j)) + 1
    cholesky = BandFactors(system.nrows, height - 1)
    cholesky.band[j[lower] * height + (i - j)[lower]] = entries.data[lower]
    cholesky.band[::height] += ADDED
    Program([cholesky.factor]).run()
    out = np.full(system.nrows, np.sqrt(DEPENDENT * INDEPENDENT))  # undecided, in case rounding exceeds ADDED
    if cholesky.info[0] == 0:
        out[order] = cholesky.band[::height] ** 2
    return out


def _order_joints(system: MultibodySystem) -> Int[np.ndarray, " nj"]:
    """Return the indices of joints, ordered so that the last joint of each loop is the one that closes it.

    Bodies are in the order of Cuthill and McKee, for a narrow band. A joint comes with the later of its two bodies, and
    a body's joint to the ground comes first.
    """
    i, j = system.joint_i, system.joint_j
    between = (i != GROUND) & (j != GROUND)
    ends = (np.ones(np.sum(between)), (i[between], j[between]))
    neighbours = sp.csr_matrix(sp.coo_matrix(ends, (system.nb, system.nb)))
    bodies = reverse_cuthill_mckee(neighbours + neighbours.T, symmetric_mode=True)[::-1]
    place = np.append(np.argsort(bodies), GROUND)
    return np.lexsort((np.minimum(place[i], place[j]), np.maximum(place[i], place[j])))


def _choose_by_orthogonalisation(system: MultibodySystem, state: State) -> Int[np.ndarray, " rank"]:
    """Return the indices of a maximal set of independent constraint rows, by a dense orthogonalisation.

    Joints are taken in the order of ``_order_joints``. Among the rows of a joint, those farthest from the span of the
    rows already kept come first.
    """
    A = scale_jacobian(system, state)
    rows, basis, kept = A.toarray(), np.zeros((0, A.shape[1])), []
    for k in _order_joints(system):
        at = np.arange(*system.row_start[k : k + 2])
        left = rows[at]
        for _ in range(2):  # twice, for orthogonality to rounding
            left = left - (left @ basis.T) @ basis
        Q, size, order = factor_with_pivots(left.T)
        distant = size > DISTANT
        basis = np.concatenate((basis, Q.T[distant]))
        kept.append(at[order[: np.sum(distant)]])
    return np.sort(np.concatenate(kept))
