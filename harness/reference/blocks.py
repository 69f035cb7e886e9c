"""Find which bodies a constraint row touches: all other blocks of its Jacobian are zero, and so are their products."""

import numpy as np
from jaxtyping import Bool, Float, Int

from ..mechanics.system import GROUND, MultibodySystem


def find_touched(system: MultibodySystem) -> Bool[np.ndarray, "rows nb"]:
    """Return for each constraint row and body whether the row's joint is on that body; the ground is not a body."""
    joint = np.repeat(np.arange(system.nj), system.joint_rows)
    out = np.zeros((system.nrows, system.nb), dtype=bool)
    for body in (system.joint_i[joint], system.joint_j[joint]):
        rows = np.flatnonzero(body != GROUND)
        out[rows, body[rows]] = True
    return out


def list_blocks(touched: Bool[np.ndarray, "rows nb"]) -> tuple[Int[np.ndarray, " m"], Int[np.ndarray, " m"]]:
    """Return the indices of the touched (1, 6) blocks of a Jacobian, counted row by row, and the body of each."""
    return np.flatnonzero(touched), np.nonzero(touched)[1]


def multiply_blocks(
    A: Float[np.ndarray, "*nt rows n"], by: Float[np.ndarray, "*nt m 6 6"], blocks: Int[np.ndarray, " m"]
) -> Float[np.ndarray, "*nt rows n"]:
    """Return A times a block-diagonal matrix, computed for the (1, 6) ``blocks`` of A alone; all others are zero.

    ``blocks`` are indices as in ``list_blocks``, ``by`` the factor (6, 6) of each.
    """
    flat = A.reshape(*A.shape[:-2], -1, 6)
    out = np.zeros_like(flat)
    out[..., blocks, :] = np.matmul(flat[..., blocks, None, :], by)[..., 0, :]
    return out.reshape(A.shape)
