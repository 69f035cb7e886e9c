"""Project recorded poses onto their constraints, so that redundant rows agree where a quantity is computed.

Rows that are redundant on the constraints alone (planar loops in space, linkages of Bennett and Bricard) contradict
each other at a pose that is off by 1e-7, where accelerations of index 1 are meaningless.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from . import so3
from .consistency import close_gaps
from .index1 import find_least_changes
from .motion import constraint
from .state import States
from .system import MultibodySystem

# Half and twice of each change no bit of 40 poses each of Bricard's and Bennett's linkages, a grid of 5 x 5 four-bar
# cells, two cells that pass singular poses, and a top.
NEAR = 64.0 * np.finfo(float).eps  # share of the size: a pose that is as near as that is left as it is
INDEPENDENT = 1e-5  # least to largest singular value of rows that move the pose: redundant ones are left out
SETTLED = 0.5  # ratio to the residual before: one that falls less is rounding
PASSES = 8  # Gauss-Newton passes, which square the residual
NONE_LEFT = np.finfo(float).tiny  # below each gap that is not near: reached where no pose is left

Poses = tuple[np.ndarray, np.ndarray]  # r and R, changed in place


def find_arms(system: MultibodySystem) -> Float[np.ndarray, " nb"]:
    """Return the larger of the longest joint arm and the radius of gyration [m] of each body, to scale moments."""
    arm = np.append(system.gyration, 0.0)  # the last one is the ground
    for body, s in ((system.joint_i, system.joint_s_i), (system.joint_j, system.joint_s_j)):
        np.maximum.at(arm, body, np.linalg.norm(s, axis=1))
    return arm[:-1]


def project_poses(system: MultibodySystem, s: States) -> States:
    """Return the states at the nearest poses that satisfy the constraints, with the same velocities.

    Distances are weighted by mass and gyration. Each pose is corrected by Gauss-Newton steps until they no longer halve
    its gaps, and a step that increases them is undone.
    """
    return project_poses_of_each(system, [s])[0]


def project_poses_of_each(system: MultibodySystem, motions: Sequence[States]) -> list[States]:
    """Project the poses of several motions at once, bit for bit as ``project_poses`` does those of each."""
    s = States.join(motions)
    if system.nrows == 0 or len(s) == 0:
        return list(motions)
    metres = np.ones(system.nrows)  # factors that make all residuals lengths
    metres[system.turning_rows] = np.max(system.gyration)
    sizes = [float(np.max(np.abs(m.r), initial=0.0)) + float(np.max(find_arms(system))) for m in motions]
    near = NEAR * np.repeat(sizes, list(map(len, motions)))
    last_r, last_R = s.r.copy(), s.R.copy()
    left, before = np.arange(len(s)), np.full(len(s), np.inf)

    def place(r: np.ndarray, R: np.ndarray) -> States:
        """Return those of the states that are still being corrected, at the poses ``r``, ``R``."""
        return States(r[left], R[left], s.v[left], s.Omega[left], s.times[left])

    def measure(poses: Poses) -> np.ndarray:
        """Return phi of the poses that are still to be corrected; undo the last step of those whose gaps grew."""
        nonlocal left, before
        phi = constraint(system, place(*poses))
        size = np.max(np.abs(phi * metres), axis=1)
        worse = left[~(size < before)]
        poses[0][worse], poses[1][worse] = last_r[worse], last_R[worse]
        off = np.isfinite(size) & (size > near[left]) & (size < SETTLED * before)
        left, before = left[off], size[off]
        return np.asarray(phi[off])

    def correct(poses: Poses, phi: np.ndarray) -> Poses:
        """Move these poses by the least changes that close their gaps to first order; return all poses."""
        r, R = poses
        last_r[left], last_R[left] = r[left], R[left]
        change = find_least_changes(system, place(r, R), -phi, INDEPENDENT)
        r[left] += change[..., :3]
        R[left] = R[left] @ so3.exp(change[..., 3:])
        return poses

    r, R = close_gaps((s.r.copy(), s.R.copy()), measure, correct, NONE_LEFT, PASSES)
    return States(r, R, s.v, s.Omega, s.times, s.angles).split(list(map(len, motions)))


def disturb_poses(system: MultibodySystem, s: States, distance: np.ndarray, seed: int) -> States:
    """Return the states at poses moved at random by about ``distance`` (nt,) [m], and projected again.

    The directions, drawn from ``seed``, are the same at all times. The difference of a quantity between both motions
    estimates its uncertainty for poses with errors of ``distance``.
    """
    random = np.random.default_rng(seed)
    arm = float(np.max(find_arms(system)))
    move, turn = random.standard_normal((2, system.nb, 3))
    size = distance[:, None, None]
    return project_poses(
        system, States(s.r + size * move, s.R @ so3.exp(size / arm * turn), s.v, s.Omega, s.times, s.angles)
    )
