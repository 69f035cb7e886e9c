"""Joint forces from a trajectory's reactions, and those of the exact motion, which follow from its accelerations."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from ..mechanics.state import States
from ..mechanics.system import GROUND, MultibodySystem

SAMPLES = 500  # instants at most at which reactions are compared: each costs seven states of the reference
STEP = 2e-4  # [s] of differences: rounding/STEP and (rate STEP)^6 rate are both below 1e-8 at 50 rad/s
DIFFERENCE = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / 60.0


def largest_joint_force(system: MultibodySystem, reaction: Float[np.ndarray, "nt nrows"]) -> Float[np.ndarray, " nt"]:
    """Largest force [N] that any joint carries: norm of its three point rows; NaN where the solver has no reaction."""
    if system.nj == 0:
        return np.zeros(len(reaction))
    point_rows = system.row_start[:-1, None] + np.arange(3)
    return np.max(np.linalg.norm(reaction[:, point_rows], axis=-1), axis=-1)


def pull_on_bodies(system: MultibodySystem, reaction: Float[np.ndarray, "nt nrows"]) -> Float[np.ndarray, "nt nb 3"]:
    """Sum of the joint forces on each body [N], space frame: unique even where redundant joints share them at will."""
    out = np.zeros((len(reaction), system.nb + 1, 3))  # the last one is the ground
    force = reaction[:, system.row_start[:-1, None] + np.arange(3)]
    for ends, sign in ((system.joint_i, 1.0), (system.joint_j, -1.0)):
        for k, body in enumerate(ends):
            out[:, body if body != GROUND else system.nb] += sign * force[:, k]
    return out[:, :-1]


def exact_pull_on_bodies(
    system: MultibodySystem, motion: Callable[[np.ndarray], States], t: Float[np.ndarray, " nt"]
) -> Float[np.ndarray, "nt nb 3"]:
    """Newton: m (a_C - g) of the exact motion [N], a_C by sixth-order differences of velocities; without springs."""
    a = sum(c * motion(t + k * STEP).v for k, c in zip(range(-3, 4), DIFFERENCE, strict=True) if c) / STEP
    return system.mass[:, None] * (a - system.gravity)


def instants_to_compare(t: Float[np.ndarray, " nt"], horizon: float) -> Int[np.ndarray, " n"]:
    """Rows far enough from the ends of the exact motion to take differences, evenly picked."""
    inside = np.flatnonzero((t > 3.0 * STEP) & (t < horizon - 3.0 * STEP))
    pick = np.linspace(0, len(inside) - 1, min(SAMPLES, len(inside))).round().astype(np.int64)
    return inside[pick]
