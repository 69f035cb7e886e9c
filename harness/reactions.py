"""Joint forces from a trajectory's reactions."""

import numpy as np
from jaxtyping import Float

from harness.mechanics.system import MultibodySystem


def largest_joint_force(system: MultibodySystem, reaction: Float[np.ndarray, "nt nrows"]) -> Float[np.ndarray, " nt"]:
    """Largest force [N] that any joint carries: norm of its three point rows; NaN where the solver has no reaction."""
    if system.nj == 0:
        return np.zeros(len(reaction))
    point_rows = system.row_start[:-1, None] + np.arange(3)
    return np.max(np.linalg.norm(reaction[:, point_rows], axis=-1), axis=-1)
