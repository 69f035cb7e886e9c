"""Restrict planar mechanisms to their plane by hinges in place of spherical joints, so that tangents stay in it."""

from dataclasses import replace

import numpy as np

from ...mechanics.joints import KINDS, JointKind
from ...mechanics.state import State, States
from ...mechanics.system import GROUND, MultibodySystem
from ...mechanics.types import Problem

PLANE = 1e-6  # relative to the extent of the motion: one that leaves the plane by less counts as planar


def is_planar_motion(problem: Problem, states: States, reach: float) -> bool:
    """Return whether the exact motion is planar and the computed one leaves that plane by less than ``PLANE``.

    ``PLANE`` is relative to ``reach`` [m], the extent of the motion.
    """
    if problem.planar_normal is None:
        return False
    at_home = problem.home(states)
    return bool(np.max(np.abs((at_home.r - at_home.r[:1]) @ problem.planar_normal)) < PLANE * reach)


def add_hinges(system: MultibodySystem, start: State, normal: np.ndarray) -> MultibodySystem:
    """Return the system with a revolute joint along ``normal`` [space] in place of each spherical one.

    Axes are fixed to the bodies as they are at ``start``.
    """
    sort, axes, u, n = (a.copy() for a in (system.joint_sort, system.joint_axes, system.joint_u, system.joint_n))
    across = np.linalg.svd(normal[None])[2][1:]
    for k in np.flatnonzero(sort == KINDS.index(JointKind.SPHERICAL)):
        i, j = (start.R[b] if b != GROUND else np.eye(3) for b in (system.joint_i[k], system.joint_j[k]))
        sort[k], axes[k] = KINDS.index(JointKind.REVOLUTE), 2
        u[k], n[k, :2] = normal @ i, across @ j
    return replace(system, joint_sort=sort, joint_axes=axes, joint_u=u, joint_n=n)
