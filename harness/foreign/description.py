"""A problem as plain numbers: what a code outside needs to solve it. The schema is in docs/other-codes.md."""

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ..mechanics.system import MultibodySystem
from ..types import Problem

SCHEMA = 1


def described(problem: Problem) -> dict[str, Any]:
    """For JSON; SI units, bodies numbered from 0, the ground is -1."""
    s, start = problem.system, problem.initial
    quaternions = Rotation.from_matrix(start.R).as_quat(scalar_first=True, canonical=True)
    bodies = [
        {"name": s.body_names[b], "mass": s.mass[b], "inertia": s.inertia[b]} for b in range(s.nb)
    ]  # fmt: skip
    state = [
        {"r": start.r[b], "R": start.R[b], "quaternion_wxyz": quaternions[b], "v": start.v[b], "Omega": start.Omega[b]}
        for b in range(s.nb)
    ]
    springs = [
        {"i": s.spring_i[k], "p_i": s.spring_p_i[k], "j": s.spring_j[k], "p_j": s.spring_p_j[k],
         "stiffness": s.spring_k[k], "rest_length": s.spring_d0[k], "damping": s.spring_c[k]}
        for k in range(len(s.spring_k))
    ]  # fmt: skip
    return {
        "schema": SCHEMA, "problem": problem.name, "parameters": dict(problem.parameters), "source": problem.source,
        "t_end": problem.t_end, "dt": problem.dt, "gravity": s.gravity, "bodies": bodies,
        "joints": [_joint(s, k) for k in range(s.nj)], "springs": springs, "start": state,
    }  # fmt: skip


def _joint(s: MultibodySystem, k: int) -> dict[str, Any]:
    both = {
        "name": s.joint_names[k],
        "i": s.joint_i[k],
        "s_i": s.joint_s_i[k],
        "j": s.joint_j[k],
        "s_j": s.joint_s_j[k],
    }
    if not s.joint_revolute[k]:
        return {"type": "spherical", **both}
    return {"type": "revolute", **both, "axis_i": s.joint_u[k], "axis_j": np.cross(*s.joint_n[k])}
