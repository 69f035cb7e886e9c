"""Springs as rows: kernels in which spring-dampers stand as links of driven length, and those without them (compiled).

A row is the rate of a spring's length, A_s = d(length_dot)/dv, that of a driven distance; its phi is the length.
"""

from collections.abc import Collection
from dataclasses import replace
from typing import Any

import numpy as np

from ....harness.mechanics import joints
from ....harness.mechanics.system import MultibodySystem
from .kernel import Kernel, Made, make_kernel

ROW = list(joints.KINDS).index("driven distance")


def make_without_springs(system: MultibodySystem, needed: Collection[str]) -> Made:
    """The kernel of a system less its spring-dampers; torsional ones and user forces stay."""
    return make_kernel(replace(system, **_none(system, "spring")), needed)


def make_springs(system: MultibodySystem, of: Kernel) -> tuple[Made, np.ndarray]:
    """The kernel whose joints are the springs of a system, with the inertia of ``of``; k, free length, c (3, ns)."""
    s, n = system, len(system.spring_k)
    none, some, of_time = np.zeros(n, dtype=np.int64), np.zeros((n, 3)), np.zeros((n, 7))
    as_joints = replace(
        s, joint_i=s.spring_i, joint_j=s.spring_j, joint_s_i=s.spring_p_i, joint_s_j=s.spring_p_j,
        joint_sort=none + ROW, joint_points=none, joint_lines=none, joint_axes=none, joint_moving=none + 1,
        joint_u=some, joint_w=some, joint_n=np.zeros((n, 3, 3)), joint_length=np.zeros(n), joint_motion=of_time,
        coupled=s.taken_back, **_none(s, "spring", "torsion", "load", "user"),
    )  # fmt: skip
    made = make_kernel(as_joints, ("rows", "push", "slips"))
    made.kernel.J_inv[:] = of.J_inv
    law = np.zeros((3, n))
    law[:, made.kernel.order] = s.spring_k, s.spring_d0, s.spring_c
    return made, law


def _none(system: MultibodySystem, *kinds: str) -> dict[str, Any]:
    names = [name for name in vars(system) if name.split("_")[0] in kinds]
    return {name: getattr(system, name)[:0] for name in names}
