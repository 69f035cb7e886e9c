"""The constraint Jacobian A of ``phi_dot = A v`` as a sparse matrix, and what its rank says about redundancy."""

import numpy as np
import scipy.linalg as sl
import scipy.sparse as sp
from jaxtyping import Float, Int

from .so3 import hat
from .state import State
from .system import GROUND, MultibodySystem


def constraint_jacobian(system: MultibodySystem, state: State) -> sp.csr_array:
    """A (nrows, 6 nb), columns per body (r_dot [space], Omega [body])."""
    R = np.concatenate((state.R, np.eye(3)[None]))
    u = np.einsum("jab,jb->ja", R[system.joint_i], system.joint_u)
    n = np.einsum("jab,jkb->jka", R[system.joint_j], system.joint_n)
    torque_axis = np.cross(u[:, None], n)  # (nj, 2, 3) space
    rows: list[np.ndarray] = []
    columns: list[np.ndarray] = []
    values: list[np.ndarray] = []
    start = system.row_start[:-1]
    for ends, arm, sign in ((system.joint_i, system.joint_s_i, 1.0), (system.joint_j, system.joint_s_j, -1.0)):
        moving = np.flatnonzero(ends != GROUND)
        body = ends[moving]
        point = np.concatenate((np.broadcast_to(np.eye(3), (len(moving), 3, 3)), -R[body] @ hat(arm[moving])), axis=-1)
        _append(rows, columns, values, start[moving], body, sign * point)
        hinge = moving[system.joint_revolute[moving]]
        spin = np.einsum("jka,jab->jkb", torque_axis[hinge], R[ends[hinge]])
        axis = np.concatenate((np.zeros_like(spin), spin), axis=-1)
        _append(rows, columns, values, start[hinge] + 3, ends[hinge], sign * axis)
    shape = (system.nrows, 6 * system.nb)
    if not rows:
        return sp.csr_array(shape)
    return sp.csr_array(
        sp.coo_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=shape)
    )


def _append(rows: list, columns: list, values: list, start: np.ndarray, body: np.ndarray, block: np.ndarray) -> None:
    k, c = np.arange(block.shape[1]), np.arange(6)
    shape = block.shape
    rows.append(np.broadcast_to(start[:, None, None] + k[None, :, None], shape).ravel())
    columns.append(np.broadcast_to(6 * body[:, None, None] + c[None, None, :], shape).ravel())
    values.append(block.ravel())


def independent_rows(system: MultibodySystem, state: State, rtol: float = 1e-9) -> Int[np.ndarray, " rank"]:
    """A maximal set of independent constraint rows at ``state``, by QR with column pivoting of A^T, in row order.

    ``rtol`` is relative to the largest pivot: rounding leaves about 1e-15, the smallest true pivot of the problems
    here is above 1e-3 at the start.
    """
    if system.nrows == 0:
        return np.zeros(0, dtype=np.int64)
    A = constraint_jacobian(system, state).toarray()
    _, pivots, order = sl.qr(A.T, mode="economic", pivoting=True)
    size = np.abs(np.diag(pivots))
    return np.sort(order[: int(np.sum(size > rtol * size[0]))])


def singular_values(system: MultibodySystem, state: State) -> Float[np.ndarray, " k"]:
    """Singular values of A, largest first."""
    return np.linalg.svd(constraint_jacobian(system, state).toarray(), compute_uv=False)
