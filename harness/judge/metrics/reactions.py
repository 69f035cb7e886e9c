"""Compute joint forces and moments from recorded reactions, and those of the exact motion from its states."""

from collections import Counter

import numpy as np
from jaxtyping import Float, Int

from ...mechanics.index1 import is_dense, solve_index_1, solve_index_1_of_each
from ...mechanics.motion import list_jacobian_parts
from ...mechanics.projection import disturb_poses, find_arms, project_poses
from ...mechanics.state import States
from ...mechanics.system import MultibodySystem

# instants at which reactions are compared, at most. Half: the largest error of a top's reaction is found 0.06 %
# smaller; twice: that of a pendulum's moment 0.2 % larger.
SAMPLES = 250
# relative change of a pose, and the relative change of exact loads that it may cause; half, twice: no column of twelve
# runs changes
FINEST, SURE = 1e-9, 1e-3


def find_largest_joint_force(
    system: MultibodySystem, reaction: Float[np.ndarray, "nt nrows"]
) -> Float[np.ndarray, " nt"]:
    """Return the largest force [N] in any joint at each time: the norm of the reactions of its rows that are forces.

    NaN where reactions are NaN.
    """
    square = np.zeros((len(reaction), system.nj))
    joint = np.repeat(np.arange(system.nj), system.joint_rows)
    for row in np.setdiff1d(np.arange(system.nrows), system.turning_rows):
        square[:, joint[row]] += reaction[:, row] ** 2
    return np.sqrt(np.max(square, axis=-1, initial=0.0))


def compute_forces_on_bodies(
    system: MultibodySystem, reaction: Float[np.ndarray, "nt nrows"], s: States
) -> Float[np.ndarray, "nt nb 3"]:
    """Sum the forces of all joints on each body [N], space frame, from the reactions of the constraint rows.

    The sum is unique even where redundant joints share it arbitrarily.
    """
    return compute_loads_on_bodies(system, reaction, s)[:, :, :3]


def compute_moments_on_bodies(
    system: MultibodySystem, reaction: Float[np.ndarray, "nt nrows"], s: States
) -> Float[np.ndarray, "nt nb 3"]:
    """Sum the moments of all joints on each body about its C [N m], body frame, from the reactions of all rows.

    They are those of axis rows and those of the forces of other rows, by their arms.
    """
    return compute_loads_on_bodies(system, reaction, s)[:, :, 3:]


def compute_loads_on_bodies(
    system: MultibodySystem, reaction: Float[np.ndarray, "nt nrows"], s: States
) -> Float[np.ndarray, "nt nb 6"]:
    """Return A^T reaction by body: force of all joints [N], space frame, and moment about C [N m], body frame."""
    out = np.zeros((len(reaction), system.nb, 6))
    for body, rows, *parts in list_jacobian_parts(system, s):
        load = reaction[:, rows, None] * np.concatenate(parts, axis=-1)
        turn = _count_repeats(body)
        for k in range(np.max(turn, initial=-1) + 1):
            out[:, body[turn == k]] += load[:, turn == k]
    return out


def _count_repeats(body: Int[np.ndarray, " m"]) -> Int[np.ndarray, " m"]:
    """Return how often each index in ``body`` occurs before its place in the list.

    Places with the same count have different bodies, so that their loads can be added in one assignment.
    """
    seen, out = Counter[int](), np.zeros(len(body), dtype=np.int64)
    for k, b in enumerate(body.tolist()):
        out[k] = seen[b]
        seen[b] += 1
    return out


def compute_exact_loads(system: MultibodySystem, exact: States) -> Float[np.ndarray, "nt nb 6"]:
    """Return the sum of joint loads on each body in the exact motion: force [N, space], moment about C [N m, body].

    The loads are those of index 1 at the exact states, projected onto the constraints. They are NaN at times where
    this is ill-conditioned: where a change of the pose by ``FINEST`` of the longest joint arm changes them by more than
    a thousandth of the largest. Large systems with sparse rows are not checked: that would take too long.
    """
    near = project_poses(system, exact)
    if not is_dense(system):
        return solve_index_1(system, near).load
    arms = find_arms(system)
    moved = disturb_poses(system, near, np.full(len(near), FINEST * float(np.max(arms))), seed=0)
    load, changed = (x.load for x in solve_index_1_of_each(system, [near, moved]))
    weight = np.repeat(np.stack([np.ones(system.nb), 1.0 / arms], axis=1), 3, axis=1)  # moments as forces at the arm
    size = np.max(np.abs(weight * load), axis=(1, 2), initial=0.0)
    apart = np.max(np.abs(weight * (changed - load)), axis=(1, 2))
    load[~(apart <= SURE * np.nanmax(size, initial=0.0))] = np.nan
    return load


def choose_instants(t: Float[np.ndarray, " nt"], horizon: float) -> Int[np.ndarray, " n"]:
    """Return the steps, as indices of ``t``, at which reactions are compared.

    At most ``SAMPLES`` are picked, evenly, after t = 0 and up to ``horizon`` [s].
    """
    inside = np.flatnonzero((t > 0.0) & (t <= horizon))
    pick = np.linspace(0, len(inside) - 1, min(SAMPLES, len(inside))).round().astype(np.int64)
    return inside[pick]
