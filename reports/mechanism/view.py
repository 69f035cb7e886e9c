"""The view that shows a motion on paper: against gravity is up, a planar motion is seen from the front."""

import numpy as np
from jaxtyping import Float

from .segments import Mechanism

FLAT = 0.02  # of the mechanism's size: motion this thin is seen from the front
TILT = np.deg2rad(20.0), np.deg2rad(35.0)  # elevation and turn of the view of a spatial motion


def view_of(mechanism: Mechanism) -> Float[np.ndarray, "2 3"]:
    """Directions of space that are right and up: against gravity is up, a planar motion is seen from the front."""
    g = mechanism.gravity
    up = -g / np.linalg.norm(g) if np.any(g) else np.array([0.0, 0.0, 1.0])
    seen = _some(len(mechanism.t))
    points = np.concatenate([mechanism.r[seen].reshape(-1, 3), *(mechanism.joints(k) for k in seen)])
    if np.ptp(points, axis=0).max() <= FLAT * mechanism.size:  # it turns about one point: then by its segments
        points = np.concatenate([mechanism.segments(k).reshape(-1, 3) for k in seen])
    level = points - np.outer(points @ up, up)
    level -= level.mean(axis=0)
    _, sizes, axes = np.linalg.svd(level, full_matrices=False)
    right = axes[0] - up * (axes[0] @ up)
    right /= np.linalg.norm(right)
    right *= 1.0 if right[int(np.argmax(np.abs(right)))] > 0.0 else -1.0
    depth = np.ptp(level @ np.cross(right, up))
    if depth <= FLAT * mechanism.size or sizes[0] == 0.0:
        return np.stack((right, up))
    elevation, turn = TILT
    front = np.cross(right, up)
    towards = np.cos(turn) * front + np.sin(turn) * right
    across = np.cos(turn) * right - np.sin(turn) * front
    return np.stack((across, np.cos(elevation) * up - np.sin(elevation) * towards))


def flat(points: Float[np.ndarray, "*n 3"], view: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "*n 2"]:
    """Points on paper."""
    return points @ view.T


def _some(n: int) -> np.ndarray:
    """At most 200 of ``n`` frames, first and last among them."""
    return np.unique(np.linspace(0, n - 1, min(n, 200)).astype(int))
