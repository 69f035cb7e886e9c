"""Parameters of joints and forces, in the order in which the expressions read them."""

from typing import Any

import numpy as np

from ....harness.mechanics import forces

NUMBERS = 29  # numbers of a joint: s_i, s_j, u, w, n by rows, length, then the function of time


def count_force_parameters(kind: str) -> int:
    """Count the parameters of a force of this ``kind``; its function of time has seven."""
    return sum(7 if name == "factor" else int(np.prod(shape)) for name, shape in forces.DECLARED[kind].numbers.items())


def list_joint_parameters(system: Any, joint: np.ndarray) -> np.ndarray:
    """List the parameters (m, 29) of the joints with indices ``joint`` (m,), in the order of the expressions."""
    s = system
    parts = (s.joint_s_i, s.joint_s_j, s.joint_u, s.joint_w, s.joint_n, s.joint_length, s.joint_motion)
    return np.concatenate([a[joint].reshape(len(joint), -1) for a in parts], axis=1)


def list_force_parameters(system: Any, kind: str) -> np.ndarray:
    """List the parameters (m, size) of all forces of a ``kind``, in the order of the expressions."""
    arrays = [np.asarray(getattr(system, f"{kind}_{name}"), dtype=float) for name in forces.DECLARED[kind].numbers]
    m = len(arrays[0])
    return (
        np.concatenate([a.reshape(m, -1) for a in arrays], axis=1) if m else np.zeros((0, count_force_parameters(kind)))
    )
