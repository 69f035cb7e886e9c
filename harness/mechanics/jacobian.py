"""Assemble the constraint Jacobian A of ``phi_dot = A v + phi_t`` as a sparse matrix, and find independent rows."""

from typing import Literal

import numpy as np
import scipy.linalg as sl
import scipy.sparse as sp
from jaxtyping import Float, Int

from .motion import list_jacobian_parts
from .state import State, States
from .system import MultibodySystem


def constraint_jacobian(system: MultibodySystem, state: State) -> sp.csr_array:
    """Return A of phi_dot = A v + phi_t, sparse (nrows, 6 nb), columns per body (r_dot [space], Omega [body])."""
    rows: list[np.ndarray] = []
    columns: list[np.ndarray] = []
    values: list[np.ndarray] = []
    for body, row, translation, rotation in list_jacobian_parts(system, States.one(state)):
        six = np.concatenate((translation[0], rotation[0]), axis=-1)
        rows.append(np.repeat(row, 6))
        columns.append((6 * body[:, None] + np.arange(6)).ravel())
        values.append(six.ravel())
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return sp.csr_array(sp.coo_array(entries, shape=(system.nrows, 6 * system.nb)))


def scale_jacobian(system: MultibodySystem, state: State) -> sp.csr_array:
    """Return A for velocities (r_dot, gyration Omega), all in m/s, with rows of unit length, from which to find ranks.

    In metres and radians a row of an axis is 1e-10 of that of a point on an arm of 1e5 m; scaled by masses, rows of a
    light body vanish beside those of a heavy one. Neither says anything about rank.
    """
    columns = np.repeat(np.stack((np.ones(system.nb), 1.0 / system.gyration), axis=1), 3, axis=1).ravel()
    A = constraint_jacobian(system, state) @ sp.diags_array(columns)
    length = np.sqrt(A.multiply(A).sum(axis=1))
    return sp.csr_array(sp.diags_array(1.0 / np.where(length > 0.0, length, 1.0)) @ A)


def independent_rows(system: MultibodySystem, state: State, rtol: float = 1e-9) -> Int[np.ndarray, " rank"]:
    """Return the indices, ascending, of a maximal set of independent constraint rows at ``state``, by QR of A^T.

    A is scaled, and pivots below ``rtol`` times the largest count as zero: rounding leaves about 1e-15, and the
    smallest true pivot of the problems here is above 1e-3 at the start.
    """
    if system.nrows == 0:
        return np.zeros(0, dtype=np.int64)
    _, size, order = factor_with_pivots(scale_jacobian(system, state).toarray().T)
    return np.sort(order[: int(np.sum(size > rtol * size[0]))])


def factor_with_pivots(
    A: Float[np.ndarray, "m n"], mode: Literal["economic", "full"] = "economic"
) -> tuple[Float[np.ndarray, "m k"], Float[np.ndarray, " p"], Int[np.ndarray, " n"]]:
    """Factor ``A`` by QR with column pivots; return Q, the absolute values of the pivots, and the order of columns."""
    Q, pivots, order = sl.qr(A, mode=mode, pivoting=True)
    return Q, np.abs(np.diag(pivots)), order


def compute_singular_values(system: MultibodySystem, state: State) -> Float[np.ndarray, " k"]:
    """Return the singular values of A, largest first."""
    return np.linalg.svd(constraint_jacobian(system, state).toarray(), compute_uv=False)
