"""Entries of a kernel as straight code for the whole mechanism, on the kernel's arrays (compiled): one motion.

Its size is bounded: code grows with the mechanism, leaves the caches, and takes longer to make than a run saves.
"""

import hashlib
from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ....harness.mechanics import joints
from ....harness.mechanics.system import MultibodySystem
from ..generated import Code, Program
from ..generated.code import is_kept, print_functions
from ..rows.kept_code import _text, _texts
from .kernel import Kernel, parts_of

MOST_OPERATIONS = 30_000
FACTOR = Path(__file__).parents[1] / "joint_coordinates" / "elimination.py"
LEAST_OF_A_ROW = 50  # operations
USER_FORCES = "code for the mechanism writes out declared forces only, no user forces: use code = kernel"


class NoCode(ValueError):
    """No code is made of a mechanism; the message says why."""


class Coded(NamedTuple):
    """A kernel with entries ``accelerate`` and ``project`` of code, and how many operations the former takes."""

    kernel: Kernel
    operations: int


def refusal(system: MultibodySystem, k: Kernel) -> str | None:
    """Why no code can be made, as far as that is known beforehand."""
    if len(system.user_i):
        return USER_FORCES
    least = _least_operations(k)
    return _too_large(least) if least > MOST_OPERATIONS else None


def is_made(system: MultibodySystem, k: Kernel) -> bool:
    """Whether the code of accelerations is on disk."""
    return is_kept(_key(system, k, ""))


def use_code(system: MultibodySystem, k: Kernel) -> Coded:
    """Made, or loaded; NoCode where none can be made."""
    code, operations, (size,) = code_of_mechanism(system, k)
    factor, at = np.zeros(size), [k.t, k.r, k.R, k.v]
    moved = [np.zeros_like(x) for x in at[1:]]
    project = (code.address("project"), [*at, factor, *moved]), (code.address("copy"), [*moved, *at[1:]])
    kernel = k._replace(
        accelerate=Program([(code.address("accelerate"), [*at, k.v_dot, k.lam, factor])], (code, k, factor)),
        project=Program(project, (code, k, factor, moved)),
    )
    return Coded(kernel, operations)


def code_of_mechanism(
    system: MultibodySystem, k: Kernel, step: str = "", **choices: Any
) -> tuple[Code, int, list[int]]:
    """Code of accelerations, or of a ``step`` of ``rows.simplified_step``; operations of its largest function; sizes.

    NoCode where none can be made.
    """
    reason = refusal(system, k)
    if reason:
        raise NoCode(reason)
    asked = f"{step} {choices}" if step else ""
    code, about = Code(lambda: _print(system, k, step, choices), _key(system, k, asked)), np.zeros(4)
    code.function("about", 1)(about.ctypes.data)
    operations, *sizes = (int(x) for x in about)
    if operations > MOST_OPERATIONS:
        raise NoCode(_too_large(operations))
    return code, operations, sizes[: 2 if step else 1]


def _too_large(operations: int) -> str:
    return (
        f"code for the mechanism takes up to {MOST_OPERATIONS} operations an evaluation (needs {operations} or more): "
        "use code = kernel"
    )


def _print(system: MultibodySystem, k: Kernel, step: str, choices: dict[str, Any]) -> str:
    """IR of the functions, and of ``about``, operations and sizes; alone, where they are too large."""
    import casadi as ca

    from ..generated.functions import Straight, record_function
    from ..rows.mechanism import Mechanism, Part
    from ..rows.simplified_step import SimplifiedStep

    parts = [
        Part(str(joints.KINDS[part.kind]), tuple(range(part.lo, part.hi)), part.joint, (int(i), int(j)), int(first))
        for part, (i, j), first in zip(parts_of(system)[1], k.body, k.row, strict=False)
    ]
    made = (SimplifiedStep if step else Mechanism)(system, parts, _order(k))
    functions, sizes = made.functions(**choices)
    operations = len(record_function(functions[step or "accelerate"]).tape.operations)
    if operations > MOST_OPERATIONS:
        functions = {}
    about = ca.vertcat(operations, *sizes, *(0 for _ in range(3 - len(sizes))))
    return print_functions({**functions, "about": Straight([], [about])})


def _order(k: Kernel) -> list[int]:
    """Rows as the kernel eliminates them."""
    return [int(first) + a for first, size in zip(k.blocks.row, k.blocks.size, strict=True) for a in range(size)]


def _least_operations(k: Kernel) -> int:
    """Fewer than code has: known at once, where to write it would take seconds."""
    columns, products = np.repeat(k.blocks.size, np.diff(k.blocks.update_start)), k.blocks.update
    height = k.blocks.size[k.blocks.other]
    factor = np.sum(columns * height[products[:, 1]] * height[products[:, 2]])
    return int(factor + LEAST_OF_A_ROW * len(k.lam))


def _key(system: MultibodySystem, k: Kernel, asked: str) -> str:
    """A digest of all numbers of a system, of the kernel's order, and of what makes code of them."""
    makers = _texts(), _text((__file__, str(FACTOR)))
    digest = hashlib.sha256(f"{makers} {_order(k)} {k.row.tolist()} {k.body.tolist()}".encode())
    for field in fields(system):
        value = getattr(system, field.name)
        if isinstance(value, np.ndarray) and value.dtype != object:
            digest.update(f"{field.name} {value.shape} {value.dtype}".encode() + value.tobytes())
    return f"mechanism {asked} {digest.hexdigest()}"
