"""A kernel whose entries are straight code of the whole mechanism (compiled): the same motion to rounding.

Its size is bounded: code grows with the mechanism, leaves the caches and takes 0.2 ms an operation to make. The other
entries are the loops of ``make_kernel``, on the same arrays.
"""

import hashlib
from collections.abc import Callable, Collection
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ....harness.mechanics import joints
from ....harness.mechanics.system import MultibodySystem
from ..generated import Code
from ..generated.code import print_functions
from ..rows.kept import texts
from .entries import Program
from .kernel import ENTRIES, Kernel, Made, empty_kernel, finish_kernel, parts_of

if TYPE_CHECKING:
    from ..generated import Straight
    from ..rows.mechanism import Mechanism

EXPLICIT = ("accelerate", "reactions", "project")
MOST_OPERATIONS = 30_000
LEAST_OF_A_ROW = 50  # operations
MAKERS = tuple(Path(__file__).with_name(f"{name}.py") for name in ("mechanism", "kernel", "blocks"))  # of rows


def make_mechanism(system: MultibodySystem, needed: Collection[str] = EXPLICIT) -> Made | None:
    """The kernel with straight code, or None where it has none: user forces, too large.

    ``EXPLICIT`` entries are one list of operations each; where others are needed, rows, forces and the factor are.
    """
    if len(system.user_i):
        return None
    k, loops = empty_kernel(system)
    make = _explicit if set(needed).intersection(ENTRIES) <= set(EXPLICIT) else _pieces
    code = Code(lambda: _printed(system, k, make), f"{texts()}\0{_own_text()}\0{make.__name__}\0{_digest(system)}")
    size = np.zeros(1)
    code.function("size", 1)(size.ctypes.data)
    if size[0] < 0.0:
        return None
    made = finish_kernel(k, loops, _programs(k, code, int(size[0]), explicit=make is _explicit), needed)
    return Made(made.kernel, [*made.keeps, code])


def _programs(k: Kernel, code: Code, size: int, *, explicit: bool) -> dict[str, Program]:
    """Entries of the code, with the factor that they share."""
    factor, at = np.zeros(size), [k.t, k.r, k.R, k.v]
    if explicit:
        moved = [np.zeros_like(k.r), np.zeros_like(k.R), np.zeros_like(k.v)]
        accelerate = Program([(code.address("accelerate"), [*at, k.v_dot, k.lam, factor])])
        project = (code.address("project"), [*at, factor, *moved])
        back = (code.address("copy"), [*moved, k.r, k.R, k.v])
        return {"accelerate": accelerate, "reactions": accelerate, "project": Program([project, back])}
    x = np.zeros_like(k.rhs)
    return {
        "rows": Program([(code.address("rows"), [*at, k.X, k.Y, k.way, k.phi, k.slip, k.gamma])]),
        "factorise": Program([(code.address("factorise"), [k.state, k.X, k.way, factor])]),
        "solve": Program([
            (code.address("solve"), [factor, k.rhs, x]), (code.address("keep"), [x, k.rhs]),
        ]),
        "forces": Program([(code.address("forces"), [*at, k.force])]),
        "applied": Program([(code.address("applied"), [*at, k.force])]),
    }  # fmt: skip


def _printed(system: MultibodySystem, k: Kernel, make: "Callable[[Mechanism], tuple[dict[str, Any], int]]") -> str:
    """IR of the functions that ``make`` lists, and of ``size``, of the factor; -1, alone, where they are too large."""
    import casadi as ca

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
    functions, size = make(Mechanism(system, parts, rows))
    if max(len(record_function(f).tape.operations) for f in functions.values()) > MOST_OPERATIONS:
        return refusal
    return print_functions({**functions, "size": ([], [ca.SX(size)])})


def _explicit(whole: "Mechanism") -> "tuple[dict[str, Straight], int]":
    accelerate, size = whole.accelerate()
    return {"accelerate": accelerate, "project": whole.project(size), "copy": whole.copy()}, size


def _pieces(whole: "Mechanism") -> "tuple[dict[str, Straight], int]":
    factorise, size = whole.factorise()
    return {
        "rows": whole.rows(), "factorise": factorise, "solve": whole.solve(size), "keep": whole.keep(),
        "forces": whole.forces(gyroscopic=True), "applied": whole.forces(gyroscopic=False),
    }, size  # fmt: skip


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
    return hashlib.sha256(b"".join(path.read_bytes() for path in MAKERS)).hexdigest()
