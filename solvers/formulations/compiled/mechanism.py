"""A kernel whose explicit entries are straight code of the whole mechanism (compiled): the same motion to rounding.

Its size is bounded: code grows with the mechanism, leaves the caches and takes 0.2 ms an operation to make. The other
entries are the loops of ``make_kernel``, on the same arrays.
"""

import hashlib
from collections.abc import Collection
from dataclasses import fields
from functools import cache
from pathlib import Path

import numpy as np

from ....harness.mechanics import joints
from ....harness.mechanics.system import MultibodySystem
from ..generated import Code
from ..generated.code import print_functions
from ..rows.kept import texts
from .entries import Program
from .kernel import ENTRIES, Kernel, Made, empty_kernel, finish_kernel, parts_of

MOST_OPERATIONS = 30_000
LEAST_OF_A_ROW = 50  # operations


def make_mechanism(system: MultibodySystem, needed: Collection[str] = ENTRIES) -> Made | None:
    """The kernel with straight code, or None where it has none: user forces, inertia to be taken back, too large."""
    if len(system.user_i) or np.any(system.taken_back):
        return None
    k, loops = empty_kernel(system)
    code = Code(lambda: _printed(system, k), f"{texts()}\0{_own_text()}\0{_digest(system)}")
    size = np.zeros(1)
    code.function("size", 1)(size.ctypes.data)
    if size[0] < 0.0:
        return None
    factor, r, R, v = np.zeros(int(size[0])), np.zeros_like(k.r), np.zeros_like(k.R), np.zeros_like(k.v)
    accelerate = (code.address("accelerate"), [k.t, k.r, k.R, k.v, k.v_dot, k.lam, factor])
    project = (code.address("project"), [k.t, k.r, k.R, k.v, factor, r, R, v])
    back = (code.address("copy"), [r, R, v, k.r, k.R, k.v])
    given = {
        "accelerate": Program([accelerate]), "reactions": Program([accelerate]), "project": Program([project, back]),
    }  # fmt: skip
    made = finish_kernel(k, loops, given, needed)
    return Made(made.kernel, [*made.keeps, code])


def _printed(system: MultibodySystem, k: Kernel) -> str:
    """IR of ``accelerate``, ``project``, ``copy`` and ``size``, of the factor; of ``size`` -1 alone where too large."""
    import casadi as ca

    from ..generated import Straight
    from ..generated.functions import record_function
    from ..rows.mechanism import Mechanism, Part, part_numbers

    refusal = print_functions({"size": ([], [ca.SX(-1)])})
    if _least_operations(k) > MOST_OPERATIONS:
        return refusal
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
    if len(record_function(accelerate).tape.operations) > MOST_OPERATIONS:
        return refusal
    moved = [ca.SX.sym(name, n * system.nb) for name, n in (("r", 3), ("R", 9), ("v", 6))]
    functions = {
        "accelerate": accelerate, "project": whole.project(size), "copy": Straight(moved, moved),
        "size": Straight([], [ca.SX(size)]),
    }  # fmt: skip
    return print_functions(functions)


def _least_operations(k: Kernel) -> int:
    """Fewer than code has: known at once, where to write it would take seconds."""
    size = np.diff(k.row)
    columns, products = np.repeat(k.blocks.size, np.diff(k.blocks.update_start)), k.blocks.update
    height = k.blocks.size[k.blocks.other]
    factor = np.sum(columns * height[products[:, 1]] * height[products[:, 2]]) if len(products) else 0
    return int(factor + LEAST_OF_A_ROW * np.sum(size))


def _digest(system: MultibodySystem) -> str:
    """Of all numbers of a system."""
    digest = hashlib.sha256()
    for field in fields(system):
        value = getattr(system, field.name)
        if isinstance(value, np.ndarray) and value.dtype != object:
            digest.update(f"{field.name} {value.shape} {value.dtype}".encode() + value.tobytes())
    return digest.hexdigest()


@cache
def _own_text() -> str:
    return hashlib.sha256(Path(__file__).read_bytes()).hexdigest()
