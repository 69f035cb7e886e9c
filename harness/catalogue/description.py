"""Describe a problem as plain numbers that another code needs to solve it; schema in docs/your-own-solver.md."""

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ..mechanics.joints import JointKind
from ..mechanics.system import MultibodySystem
from ..mechanics.types import Problem

SCHEMA = 1


def describe_problem(problem: Problem) -> dict[str, Any]:
    """Return the problem as a dict for JSON: SI units, bodies numbered from 0, the ground is -1.

    Points ``_i`` are in the frame of body i, points ``_j`` in that of body j or in space. Raise ValueError for a
    problem with user forces, which are code.
    """
    s, start = problem.system, problem.initial
    if len(s.user_i):
        raise ValueError(f"problem {problem.name} has user forces, which are code: a file cannot describe them")
    quaternions = Rotation.from_matrix(start.R).as_quat(scalar_first=True, canonical=True)
    bodies = [{"name": s.body_names[b], "mass": s.mass[b], "inertia": s.inertia[b]} for b in range(s.nb)]
    state = [
        {"r": start.r[b], "R": start.R[b], "quaternion_wxyz": quaternions[b], "v": start.v[b], "Omega": start.Omega[b]}
        for b in range(s.nb)
    ]
    springs = [
        {
            "i": s.spring_i[k],
            "p_i": s.spring_p_i[k],
            "j": s.spring_j[k],
            "p_j": s.spring_p_j[k],
            "stiffness": s.spring_k[k],
            "rest_length": s.spring_d0[k],
            "damping": s.spring_c[k],
        }
        for k in range(len(s.spring_k))
    ]
    torsions = [
        {
            "i": s.torsion_i[k],
            "across_i": s.torsion_u[k],
            "j": s.torsion_j[k],
            "axis_j": np.cross(*s.torsion_n[k]),
            "across_j": s.torsion_n[k, 0],
            "stiffness": s.torsion_k[k],
            "rest_angle": s.torsion_rest[k],
            "damping": s.torsion_c[k],
            "turns": s.torsion_wound[k] / (2.0 * np.pi),
        }
        for k in range(len(s.torsion_k))
    ]
    loads = [
        {
            "i": s.load_i[k],
            "point": s.load_p[k],
            "force": s.load_force[k],
            "torque": s.load_torque[k],
            "follows": s.load_follows[k],
            "factor": s.load_factor[k],
        }
        for k in range(len(s.load_i))
    ]
    return {
        "schema": SCHEMA,
        "problem": problem.name,
        "parameters": dict(problem.parameters),
        "source": problem.source,
        "t_end": problem.t_end,
        "dt": problem.dt,
        "gravity": s.gravity,
        "bodies": bodies,
        "joints": [_describe_joint(s, k) for k in range(s.nj)],
        "springs": springs,
        "torsions": torsions,
        "loads": loads,
        "start": state,
    }


def _describe_joint(s: MultibodySystem, k: int) -> dict[str, Any]:
    """Return joint ``k`` as a dict of plain numbers: its bodies, arms [m] and the directions that its kind needs.

    Arms and directions of body i and body j are in the frames of these bodies.
    """
    both = {
        "name": s.joint_names[k],
        "i": s.joint_i[k],
        "s_i": s.joint_s_i[k],
        "j": s.joint_j[k],
        "s_j": s.joint_s_j[k],
    }
    kind = s.joint_kind(k)
    found: dict[str, Any] = {"type": kind, **both}
    if kind == JointKind.REVOLUTE:
        found |= {"axis_i": s.joint_u[k], "axis_j": np.cross(*s.joint_n[k, :2])}
    elif kind == JointKind.DISTANCE:
        found |= {"length": s.joint_length[k]}
    elif s.joint_moving[k]:
        found |= {"u": s.joint_u[k], "n": s.joint_n[k], "length": s.joint_length[k], "motion": s.joint_motion[k]}
    elif kind != JointKind.SPHERICAL:  # direction vectors of its rows
        found |= {"u": s.joint_u[k], "w": s.joint_w[k], "n_1": s.joint_n[k, 0], "n_2": s.joint_n[k, 1]}
    return found
