"""Entries of a kernel as straight code for the whole mechanism, on the kernel's arrays (compiled): one motion.

Its size is bounded: code grows with the mechanism, leaves the caches, and takes longer to make than a run saves.
"""

import hashlib
from collections.abc import Collection
from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ....harness.code_meter import making_code
from ....harness.mechanics import joints
from ....harness.mechanics.system import MultibodySystem
from ..generated import Code, Program
from ..generated.code import is_kept, print_functions
from ..rows.kept_code import text_of, texts_of_makers
from .kernel import Kernel, finish_kernel, parts_of

MOST_OPERATIONS = 30_000
FACTOR = Path(__file__).parents[1] / "joint_coordinates" / "elimination.py"
LEAST_OF_A_ROW = 50  # operations
USER_FORCES = "code for the mechanism writes out declared forces only, no user forces: use code = kernel"


class NoCode(ValueError):
    """No code is made of a mechanism; the message says why."""


class Coded(NamedTuple):
    """A kernel with entries of code, and how many operations an evaluation takes."""

    kernel: Kernel
    operations: int


SPLIT_EVALUATION = "rows", "factorise", "solve"
EVALUATION = {"": ("accelerate",), "iterate": ("iterate",), "split": SPLIT_EVALUATION, "mean": SPLIT_EVALUATION}
FUSED = {"accelerate", "project"}  # one function each, in which rows are not handed over
SPLIT = {  # entries, and the functions of ``rows.split_mechanism`` that are theirs
    "rows": ("rows",), "factorise": ("factorise",), "solve": ("solve", "copy_rows"), "forces": ("forces",),
    "applied_forces": ("applied_forces",), "react": ("react",), "push": ("push", "copy_bodies"),
    "push_kept": ("push", "copy_bodies"), "keep_rows": ("copy_entries",), "slips": ("slips",),
    "project_rates": ("project_rates", "copy_bodies"), "accelerate": ("rows", "factorise", "react"),
    "reactions": ("rows", "react"),
    "project": ("close_joints", "copy_poses", "rows", "project_rates", "copy_bodies"),
}  # fmt: skip


def refusal(system: MultibodySystem, k: Kernel) -> str | None:
    """Why no code can be made, as far as that is known beforehand."""
    if len(system.user_i):
        return USER_FORCES
    least = _least_operations(k)
    return _too_large(least) if least > MOST_OPERATIONS else None


def is_made(system: MultibodySystem, k: Kernel, needed: Collection[str] = FUSED) -> bool:
    """Whether the code of these entries is on disk."""
    step, choices = ("", {}) if FUSED.issuperset(needed) else ("split", {"names": _functions(needed)})
    return is_kept(_key(system, k, step, choices))


def use_code(system: MultibodySystem, k: Kernel, needed: Collection[str] = FUSED) -> Coded:
    """Made, or loaded; entries beside ``SPLIT`` are the kernel's. NoCode where none can be made."""
    if FUSED.issuperset(needed):
        return _use_fused(system, k)
    entries, operations = _split_entries(system, k, needed, "split", [k.t, k.r, k.R, k.v], [k.phi, k.slip, k.gamma])
    rest = finish_kernel(system, k, set(needed) - set(entries))
    return Coded(rest._replace(**entries), operations)


def use_mean_code(system: MultibodySystem, k: Kernel, h: np.ndarray, r0: np.ndarray, R0: np.ndarray) -> Kernel:
    """A finished kernel whose rows, factor, products with A and solutions are those of mean rows (``means``) by code.

    ``accelerate`` stays the kernel's, with rows and a factor of its own.
    """
    needed = "rows", "factorise", "solve", "push", "slips"
    return k._replace(**_split_entries(system, k, needed, "mean", [h, r0, R0, k.r, k.R, k.v], [k.phi])[0])


def _use_fused(system: MultibodySystem, k: Kernel) -> Coded:
    code, operations, (size,) = code_of_mechanism(system, k)
    factor, at = np.zeros(size), [k.t, k.r, k.R, k.v]
    moved = [np.zeros_like(x) for x in at[1:]]
    project = (code.address("project"), [*at, factor, *moved]), (code.address("copy"), [*moved, *at[1:]])
    kernel = k._replace(
        accelerate=Program([(code.address("accelerate"), [*at, k.v_dot, k.lam, factor])], (code, k, factor)),
        project=Program(project, (code, k, factor, moved)),
    )
    return Coded(kernel, operations)


def _split_entries(
    system: MultibodySystem, k: Kernel, needed: Collection[str], step: str, given_rows: list[np.ndarray],
    results: list[np.ndarray],
) -> tuple[dict[str, Any], int]:  # fmt: skip
    """Entries of those ``needed`` that ``SPLIT`` has, ``rows`` from ``given_rows`` to ``results``; operations."""
    own = [name for name in SPLIT if name in needed]
    code, operations, (count, size) = code_of_mechanism(system, k, step, names=_functions(needed))
    A, A_kept, factor, poses = np.zeros(count), np.zeros(count), np.zeros(size), [k.t, k.r, k.R, k.v]
    x, w, r, R = (np.zeros_like(a) for a in (k.x, k.w, k.r, k.R))  # results on their way to where they are read
    shift = np.ndarray(1, buffer=k.state)
    given: dict[str, list[np.ndarray]] = {
        "rows": [*given_rows, A, *results], "factorise": [A, shift, factor],
        "forces": [*poses, k.force], "applied_forces": [*poses, k.force],
        "react": [*poses, A, k.gamma, factor, k.v_dot, k.lam], "close_joints": [k.r, k.R, A, k.phi, factor, r, R],
        "copy_poses": [r, R, k.r, k.R], "project_rates": [A, k.slip, factor, k.v, w, k.rhs],
        "slips": [A, k.slip, k.w, k.x], "solve": [factor, k.rhs, x], "copy_rows": [x, k.rhs],
        "push": [A, k.x, k.w, w], "copy_entries": [A, A_kept], "copy_bodies": [w, k.w],
    }  # fmt: skip
    of_entry = {"push_kept": {"push": [A_kept, k.x, k.w, w]}}
    of_entry |= {name: {"copy_bodies": [w, k.v]} for name in ("project", "project_rates")}
    keeps = code, k, given, of_entry
    entries: dict[str, Any] = {
        name: Program([(code.address(f), of_entry.get(name, {}).get(f, given[f])) for f in SPLIT[name]], keeps)
        for name in own
    }
    return entries, operations


def _functions(needed: Collection[str]) -> tuple[str, ...]:
    """Of ``rows.split_mechanism``, for entries; those of ``EVALUATION`` always."""
    return tuple(sorted(set(SPLIT_EVALUATION).union(*(SPLIT[name] for name in needed if name in SPLIT))))


@making_code
def code_of_mechanism(
    system: MultibodySystem, k: Kernel, step: str = "", **choices: Any
) -> tuple[Code, int, list[int]]:
    """Code of accelerations, of a ``step`` of ``rows.simplified_step``, or "split"; operations of an evaluation; sizes.

    NoCode where none can be made.
    """
    reason = refusal(system, k)
    if reason:
        raise NoCode(reason)
    code, about = Code(lambda: _print(system, k, step, choices), _key(system, k, step, choices)), np.zeros(4)
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
    from ..rows.split_mechanism import MeanMechanism, SplitMechanism

    parts = [
        Part(str(joints.KINDS[part.kind]), tuple(range(part.lo, part.hi)), part.joint, (int(i), int(j)), int(first))
        for part, (i, j), first in zip(parts_of(system)[1], k.body, k.row, strict=False)
    ]
    kinds = {"": Mechanism, "iterate": SimplifiedStep, "split": SplitMechanism, "mean": MeanMechanism}
    functions, sizes = kinds[step](system, parts, _order(k)).functions(**choices)
    operations = sum(len(record_function(functions[name]).tape.operations) for name in EVALUATION[step])
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


def _key(system: MultibodySystem, k: Kernel, step: str, choices: dict[str, Any]) -> str:
    """A digest of all numbers of a system, of the kernel's order, and of what makes code of them."""
    makers = texts_of_makers(), text_of((__file__, str(FACTOR)))
    digest = hashlib.sha256(f"{makers} {_order(k)} {k.row.tolist()} {k.body.tolist()}".encode())
    digest.update(system.regular_inertia.tobytes())
    for field in fields(system):
        value = getattr(system, field.name)
        if isinstance(value, np.ndarray) and value.dtype != object:
            digest.update(f"{field.name} {value.shape} {value.dtype}".encode() + value.tobytes())
    return f"mechanism {step} {choices} {digest.hexdigest()}"
