"""A kernel whose explicit entries are straight code of the whole mechanism (compiled): the same motion to rounding.

Its size is bounded: code grows with the mechanism, leaves the caches and takes 0.2 ms an operation to make. The other
entries are the loops of ``make_kernel``, on the same arrays.
"""

import hashlib
from dataclasses import fields

import casadi as ca
import numpy as np

from ....harness.mechanics import joints
from ....harness.mechanics.system import MultibodySystem
from ..generated import Code, Loop, Straight
from ..generated.functions import record_function
from ..generated.printing import print_module
from ..rows.mechanism import Mechanism, Part, part_numbers
from .entries import Program, sources, words_of
from .kernel import Kernel, Made, make_kernel, parts_of

MOST_OPERATIONS = 30_000


def make_mechanism(system: MultibodySystem) -> Made | None:
    """The kernel with straight code, or None where it has none: user forces, inertia to be taken back."""
    if len(system.user_i) or np.any(system.taken_back):
        return None
    made = make_kernel(system)
    k = made.kernel
    try:
        code = Code(lambda: _printed(system, k), f"{sources(__name__)}\0{_digest(system)}")
    except OverflowError:
        return None
    size = np.zeros(1)
    code.function("size", 1)(size.ctypes.data)
    factor, r, R, v = np.zeros(int(size[0])), np.zeros_like(k.r), np.zeros_like(k.R), np.zeros_like(k.v)
    accelerate = (code.address("accelerate"), [k.t, k.r, k.R, k.v, k.v_dot, k.lam, factor])
    project = (code.address("project"), [k.t, k.r, k.R, k.v, factor, r, R, v])
    back = (code.address("copy"), [r, R, v, k.r, k.R, k.v])
    programs = {
        "accelerate": Program([accelerate]), "reactions": Program([accelerate]), "project": Program([project, back]),
    }  # fmt: skip
    k = Kernel(**{**k._asdict(), **{name: program.entry for name, program in programs.items()}})
    made.keeps[0][:] = words_of(k)
    return Made(k, [*made.keeps, code, programs, factor, r, R, v])


def _printed(system: MultibodySystem, k: Kernel) -> str:
    """IR of ``accelerate``, ``project``, ``copy`` and ``size``, of the factor; OverflowError where it is too large."""
    rows = [int(k.blocks.row[c]) + a for c in range(len(k.blocks.joint)) for a in range(int(k.blocks.size[c]))]
    parts = [
        Part(
            str(joints.KINDS[part.kind]), tuple(range(part.lo, part.hi)), (int(ends[0]), int(ends[1])), int(first),
            part_numbers(system, part.joint),
        )
        for part, ends, first in zip(parts_of(system), k.body, k.row, strict=False)
    ]  # fmt: skip
    whole = Mechanism(system, parts, rows)
    accelerate, size = whole.accelerate()
    project = whole.project(size)
    for function in (accelerate, project):
        if len(record_function(function).tape.operations) > MOST_OPERATIONS:
            raise OverflowError(f"more than {MOST_OPERATIONS} operations")
    moved = [ca.SX.sym(name, n * system.nb) for name, n in (("r", 3), ("R", 9), ("v", 6))]
    functions: dict[str, Straight | Loop] = {
        "accelerate": accelerate, "project": project, "copy": Straight(moved, moved),
        "size": Straight([], [ca.SX(size)]),
    }  # fmt: skip
    return print_module(functions)


def _digest(system: MultibodySystem) -> str:
    """Of all numbers of a system."""
    digest = hashlib.sha256()
    for field in fields(system):
        value = getattr(system, field.name)
        if isinstance(value, np.ndarray) and value.dtype != object:
            digest.update(f"{field.name} {value.shape} {value.dtype}".encode() + value.tobytes())
    return digest.hexdigest()
