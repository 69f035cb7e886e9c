"""Joint forces from a trajectory's reactions, and those of the exact motion, which follow from its accelerations."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from ..mechanics.motion import applied, row_parts
from ..mechanics.state import States
from ..mechanics.system import MultibodySystem

SAMPLES = 500  # instants at most at which reactions are compared: each costs seven states of the reference
STEP = 2e-4  # [s] of differences: rounding/STEP and (rate STEP)^6 rate are both below 1e-8 at 50 rad/s
DIFFERENCE = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / 60.0


def largest_joint_force(system: MultibodySystem, reaction: Float[np.ndarray, "nt nrows"]) -> Float[np.ndarray, " nt"]:
    """Largest force [N] that any joint carries: norm of its rows but torques; NaN where the solver has none."""
    square = np.zeros((len(reaction), system.nj))
    joint = np.repeat(np.arange(system.nj), system.joint_rows)
    for row in np.setdiff1d(np.arange(system.nrows), system.turning_rows):
        square[:, joint[row]] += reaction[:, row] ** 2
    return np.sqrt(np.max(square, axis=-1, initial=0.0))


def pull_on_bodies(
    system: MultibodySystem, reaction: Float[np.ndarray, "nt nrows"], s: States
) -> Float[np.ndarray, "nt nb 3"]:
    """Sum of the joint forces on each body [N], space frame: unique even where redundant joints share them at will."""
    out = np.zeros((len(reaction), system.nb, 3))
    for body, rows, translation, _ in row_parts(system, s):
        for k, b in enumerate(body):
            out[:, b] += reaction[:, rows[k], None] * translation[:, k]
    return out


def exact_pull_on_bodies(
    system: MultibodySystem, motion: Callable[[np.ndarray], States], t: Float[np.ndarray, " nt"]
) -> Float[np.ndarray, "nt nb 3"]:
    """Newton: m a_C less what is applied to the exact motion [N], a_C by sixth-order differences of velocities."""
    a = sum(c * motion(t + k * STEP).v for k, c in zip(range(-3, 4), DIFFERENCE, strict=True) if c) / STEP
    return system.mass[:, None] * a - applied(system, motion(t))[:, :, :3]


def instants_to_compare(t: Float[np.ndarray, " nt"], horizon: float) -> Int[np.ndarray, " n"]:
    """Rows far enough from the ends of the exact motion to take differences, evenly picked."""
    inside = np.flatnonzero((t > 3.0 * STEP) & (t < horizon - 3.0 * STEP))
    pick = np.linspace(0, len(inside) - 1, min(SAMPLES, len(inside))).round().astype(np.int64)
    return inside[pick]
