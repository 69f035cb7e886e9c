"""Kernels of several stages in stacked arrays, and springs as rows of such kernels: links of driven length (compiled).

The row of a spring is the rate of its length, A_s = d(length_dot)/dv, like that of a driven distance; its phi is the
length.
"""

from collections.abc import Collection
from dataclasses import replace
from typing import Any

import numpy as np

from ....harness.mechanics import joints
from ....harness.mechanics.fixed_order import inverse
from ....harness.mechanics.system import MultibodySystem
from .bundles import make_bundle
from .kernel import Kernel, allocate_kernel, finish_kernel
from .mechanism import use_code

ROW = list(joints.KINDS).index("driven distance")
ARRAYS = ("t", "r", "R", "v", "force", "phi", "slip", "rhs", "x", "w")  # arrays of ``Kernel``, one for each stage
ENTRIES = ("rows", "factorise", "solve", "leave_out", "forces", "divide", "push", "slips")  # 0 where one is not needed


def stack_kernels(
    system: MultibodySystem, n: int, needed: Collection[str], code: str = "kernel"
) -> tuple[Any, list[Kernel]]:
    """Return a bundle of ``n`` kernels of a system in stacked arrays, and the kernels, which keep the entries alive.

    The bundle has ``ARRAYS``, with the stage as first axis, and the addresses of the ``needed`` entries (n,). ``code``
    is "kernel" (loops) or "mechanism"; raises ``NoMechanismCode`` where the latter cannot be made.
    """
    one = allocate_kernel(system)
    stacked: dict[str, Any] = {name: np.zeros((n, *getattr(one, name).shape)) for name in ARRAYS}
    made = []
    for i in range(n):
        k = allocate_kernel(system)._replace(**{name: a[i] for name, a in stacked.items()})
        whole = code == "mechanism"
        made.append(use_code(system, k, needed).kernel if whole else finish_kernel(system, k, needed))
    words: dict[str, Any] = {name: np.array([int(getattr(k, name)) for k in made]) for name in ENTRIES}
    return make_bundle("Stages", {}, {}, **stacked, **words), made


def make_spring_kernels(system: MultibodySystem, n: int) -> tuple[Any, list[Kernel], np.ndarray]:
    """Make ``n`` kernels of a system's bodies whose constraint rows are the lengths of its springs, without joints.

    Return their bundle, the kernels, and stiffness [N/m], free length [m] and damping [kg/s] of the springs (3, ns), in
    the order of the kernels' rows.
    """
    s, m = system, len(system.spring_k)
    none, some, of_time = np.zeros(m, dtype=np.int64), np.zeros((m, 3)), np.zeros((m, 7))
    as_joints = replace(
        s,
        joint_i=s.spring_i,
        joint_j=s.spring_j,
        joint_s_i=s.spring_p_i,
        joint_s_j=s.spring_p_j,
        joint_sort=none + ROW,
        joint_points=none,
        joint_lines=none,
        joint_axes=none,
        joint_moving=none + 1,
        joint_u=some,
        joint_w=some,
        joint_n=np.zeros((m, 3, 3)),
        joint_length=np.zeros(m),
        joint_motion=of_time,
        **_cut_fields(s, "spring", "torsion", "load", "user"),
    )
    stages, made = stack_kernels(as_joints, n, ("rows", "push", "slips"))
    for k in made:
        k.J_inv[:] = inverse(s.regular_inertia)  # added inertia depends on joints
    law = np.zeros((3, m))
    law[:, made[0].order] = s.spring_k, s.spring_d0, s.spring_c
    return stages, made, law


def remove_springs(system: MultibodySystem) -> MultibodySystem:
    """Return a copy of the system without its spring-dampers; torsional springs and user forces stay."""
    return replace(system, **_cut_fields(system, "spring"))


def _cut_fields(system: MultibodySystem, *kinds: str) -> dict[str, Any]:
    """Return the system's fields whose names begin with one of ``kinds``, such as "spring", cut to length zero."""
    names = [name for name in vars(system) if name.split("_")[0] in kinds]
    return {name: getattr(system, name)[:0] for name in names}
