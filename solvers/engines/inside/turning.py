"""Rotations as matrices and quaternions (w, x, y, z), frames of ball joints, and the factor of a load."""

from typing import Any

import numpy as np


def make_matrices(quaternions: np.ndarray) -> np.ndarray:
    """Return the rotation matrices (n, 3, 3) of quaternions (w, x, y, z), (n, 4), which need not be of length 1."""
    w, x, y, z = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def rotate_back(quaternions: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Return R^T a: vectors ``a`` (..., 3) in space, in the frames of bodies with unit quaternions (w, x, y, z)."""
    w, axis = quaternions[..., :1], -quaternions[..., 1:]
    once = np.cross(axis, a)
    return a + 2.0 * (w * once + np.cross(axis, once))


def make_quaternion(R: Any) -> np.ndarray:
    """Return the quaternion (w, x, y, z) of the rotation matrix ``R``; its sign is arbitrary.

    It is the eigenvector of Bar-Itzhack's matrix for the largest eigenvalue, which needs no branch.
    """
    R = np.array(R)
    K = np.empty((4, 4))
    K[1:, 1:] = R + R.T - np.trace(R) * np.eye(3)
    K[0, 1:] = K[1:, 0] = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    K[0, 0] = np.trace(R)
    return np.linalg.eigh(K)[1][:, 3]


def find_arm_and_normal(limb: dict[str, Any], gravity: list[float]) -> tuple[np.ndarray, np.ndarray]:
    """Return unit vectors in the body of ``limb``: along the arm from its ball joint to C; normal to that and gravity.

    Without an arm the first is the x axis; where gravity is along the arm, the second is any normal.
    """
    arm, down = -np.array(limb["s_child"]), np.array(limb["R"]).T @ np.array(gravity)
    along = arm / np.linalg.norm(arm) if np.any(arm) else np.eye(3)[0]
    normal = np.cross(along, down)
    if np.linalg.norm(normal) <= 1e-6 * (np.linalg.norm(down) or 1.0):
        normal = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    return along, normal / np.linalg.norm(normal)


def evaluate_factor(numbers: list[float], t: float) -> float:
    """Return a load's factor at time ``t`` [s]: c_0 + c_1 t + c_2 t^2 + c_3 t^3 + a sin(w t + p).

    ``numbers`` are c_0, c_1, c_2, c_3, a, w, p.
    """
    c_0, c_1, c_2, c_3, a, w, p = numbers
    return float(c_0 + t * (c_1 + t * (c_2 + t * c_3)) + a * np.sin(w * t + p))
