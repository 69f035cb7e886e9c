"""Joint forces from a trajectory's reactions, and those of the exact motion, which follow from its accelerations."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from ..mechanics.motion import applied_loads, row_parts
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
    return load_on_bodies(system, reaction, s)[:, :, :3]


def moment_on_bodies(
    system: MultibodySystem, reaction: Float[np.ndarray, "nt nrows"], s: States
) -> Float[np.ndarray, "nt nb 3"]:
    """Sum of the moments of all joints on each body about its C [N m], body frame: what axis rows add to."""
    return load_on_bodies(system, reaction, s)[:, :, 3:]


def load_on_bodies(
    system: MultibodySystem, reaction: Float[np.ndarray, "nt nrows"], s: States
) -> Float[np.ndarray, "nt nb 6"]:
    """A^T reaction: both of the above."""
    out = np.zeros((len(reaction), system.nb, 6))
    for body, rows, *parts in row_parts(system, s):
        part = np.concatenate(parts, axis=-1)
        for k, b in enumerate(body):
            out[:, b] += reaction[:, rows[k], None] * part[:, k]
    return out


def exact_pull_on_bodies(
    system: MultibodySystem, motion: Callable[[np.ndarray], States], t: Float[np.ndarray, " nt"]
) -> Float[np.ndarray, "nt nb 3"]:
    """Newton: m a_C less what is applied to the exact motion [N], a_C by sixth-order differences of velocities."""
    return system.mass[:, None] * _rate(motion, t, "v") - applied_loads(system, motion(t))[:, :, :3]


def exact_moment_on_bodies(
    system: MultibodySystem, motion: Callable[[np.ndarray], States], t: Float[np.ndarray, " nt"]
) -> Float[np.ndarray, "nt nb 3"]:
    """Euler: J Omega' + Omega x J Omega less what is applied to the exact motion [N m], Omega' by the same."""
    here = motion(t)
    spun = np.einsum("bij,tbj->tbi", system.inertia, here.Omega)
    turned = np.einsum("bij,tbj->tbi", system.inertia, _rate(motion, t, "Omega"))
    return turned + np.cross(here.Omega, spun) - applied_loads(system, here)[:, :, 3:]


def _rate(motion: Callable[[np.ndarray], States], t: np.ndarray, what: str) -> np.ndarray:
    total = sum(c * getattr(motion(t + k * STEP), what) for k, c in zip(range(-3, 4), DIFFERENCE, strict=True) if c)
    return np.asarray(total) / STEP


def instants_to_compare(t: Float[np.ndarray, " nt"], horizon: float) -> Int[np.ndarray, " n"]:
    """Rows far enough from the ends of the exact motion to take differences, evenly picked."""
    inside = np.flatnonzero((t > 3.0 * STEP) & (t < horizon - 3.0 * STEP))
    pick = np.linspace(0, len(inside) - 1, min(SAMPLES, len(inside))).round().astype(np.int64)
    return inside[pick]
