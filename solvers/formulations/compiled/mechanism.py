"""Entries of a kernel as straight-line code for the whole mechanism, on the kernel's arrays (compiled).

The size of the code is limited: it grows with the mechanism, exceeds the caches, and takes longer to make than a run
saves.
"""

import hashlib
from collections.abc import Collection
from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ....harness.base.code_meter import making_code
from ....harness.base.generated import Code, Program
from ....harness.base.generated.code import is_kept, print_functions
from ....harness.mechanics import joints
from ....harness.mechanics.system import MultibodySystem
from ..rows.kept_code import digest_files, digest_makers
from .entries import BoundFunction
from .kernel import Kernel, finish_kernel, list_parts
from .row_choice import choose_rows_of_code, leave_out_of_code

MOST_OPERATIONS = 30_000  # larger code exceeds the processor's caches and does not pay (docs/decisions/kernels.md)
FACTOR = Path(__file__).parents[1] / "joint_coordinates" / "elimination.py"
LEAST_OF_A_ROW = 50  # operations
USER_FORCES = "code for the mechanism writes out declared forces only, no user forces: use code = kernel"


class NoMechanismCode(ValueError):
    """Raised where no code can be made for a mechanism; the message says why."""


class CodedKernel(NamedTuple):
    """A kernel with entries of code for the mechanism, and the number of operations of an evaluation."""

    kernel: Kernel
    operations: int


SPLIT_EVALUATION = "rows", "factorise", "solve"
EVALUATION = {"": ("accelerate",), "iterate": ("iterate",), "split": SPLIT_EVALUATION, "mean": SPLIT_EVALUATION}
FUSED = {"accelerate", "project"}  # entries that are one function each, with rows inside
SPLIT = {  # entries, and their functions in ``rows.split_mechanism``
    "rows": ("rows",),
    "factorise": ("factorise",),
    "solve": ("solve", "copy_rows"),
    "forces": ("forces",),
    "applied_forces": ("applied_forces",),
    "react": ("react",),
    "push": ("push", "copy_bodies"),
    "push_kept": ("push", "copy_bodies"),
    "keep_rows": ("copy_entries",),
    "slips": ("slips",),
    "project_rates": ("project_rates", "copy_bodies"),
    "accelerate": ("rows", "factorise", "react"),
    "reactions": ("rows", "react"),
    "close_joints": ("close_joints", "copy_poses"),
    "project": ("close_joints", "copy_poses", "rows", "project_rates", "copy_bodies"),
}


def find_code_refusal(system: MultibodySystem, k: Kernel) -> str | None:
    """Return why code cannot be generated for this mechanism, or None if nothing rules it out beforehand.

    Known beforehand are user forces, and a lower bound on the number of operations, which may exceed
    ``MOST_OPERATIONS``.
    """
    if len(system.user_i):
        return USER_FORCES
    least = _estimate_least_operations(k)
    return _describe_size_refusal(least) if least > MOST_OPERATIONS else None


def is_code_kept(system: MultibodySystem, k: Kernel, needed: Collection[str] = FUSED) -> bool:
    """Return whether the code of the ``needed`` entries is kept on disk, by default that of the fused ones."""
    step, choices = ("", {}) if FUSED.issuperset(needed) else ("split", {"names": _list_functions(needed)})
    return is_kept(_make_key(system, k, step, choices))


def use_code(system: MultibodySystem, k: Kernel, needed: Collection[str] = FUSED) -> CodedKernel:
    """Return the kernel with ``needed`` entries of code for the mechanism, made or read from disk.

    If ``FUSED`` has all of them, they are one function each, else they share A and the factor. Entries outside
    ``SPLIT`` are the kernel's loops. Raises ``NoMechanismCode`` where none can be made.
    """
    if FUSED.issuperset(needed):
        return _use_fused(system, k)
    entries, operations = _make_split_entries(
        system, k, needed, "split", [k.t, k.r, k.R, k.v], [k.phi, k.slip, k.gamma]
    )
    rest = finish_kernel(system, k, set(needed) - set(entries))
    return CodedKernel(rest._replace(**entries), operations)


def use_mean_code(system: MultibodySystem, k: Kernel, h: np.ndarray, r0: np.ndarray, R0: np.ndarray) -> Kernel:
    """Return the kernel ``k``, with code for mean rows (``means``), their factor, products with A, and solutions.

    ``h`` [s], ``r0`` and ``R0`` are the arrays of the step's length and start poses. ``accelerate`` stays that of
    ``k``, with rows and a factor of its own.
    """
    needed = "rows", "factorise", "solve", "push", "slips"
    own = k._replace(state=k.state.copy())  # the choice of rows starts from pivots of this code, not of ``accelerate``
    return k._replace(**_make_split_entries(system, own, needed, "mean", [h, r0, R0, k.r, k.R, k.v], [k.phi])[0])


def _use_fused(system: MultibodySystem, k: Kernel) -> CodedKernel:
    """Return the kernel with ``accelerate`` and ``project`` as code, one function each that computes the rows too."""
    code, operations, (size,) = make_mechanism_code(system, k)
    factor, at = np.zeros(size), [k.t, k.r, k.R, k.v]
    moved = [np.zeros_like(x) for x in at[1:]]
    project = (code.address("project"), [*at, factor, *moved]), (code.address("copy"), [*moved, *at[1:]])
    bounds, shares = list_choice_arrays(k)
    kernel = k._replace(
        accelerate=make_choosing_program(k, code, "accelerate", [*at, *bounds, k.v_dot, k.lam, factor, *shares], at),
        project=Program(project, (code, k, factor, moved)),
    )
    return CodedKernel(kernel, operations)


def list_choice_arrays(k: Kernel) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return the arrays that code which factorises reads and writes last, for the choice among redundant rows.

    They are [``k.pivot_bound``] and [``k.inverse_share``], both empty where rows are never chosen.
    """
    return ([k.pivot_bound], [k.inverse_share]) if len(k.dense) else ([], [])


def make_choosing_program(
    k: Kernel, code: Code, name: str, arrays: list[np.ndarray], rows: list[np.ndarray]
) -> Program:
    """Return a program that runs the function ``name`` of ``code``, which factorises S, and then the choice of rows.

    Without a choice, where ``k.dense`` is empty, it runs the function alone. ``arrays`` are its arguments; ``rows`` are
    the inputs of ``couple``, which sets ``k.dense`` to S.
    """
    made = Program([(code.address(name), arrays)], (code, k, arrays))
    if not len(k.dense):
        return made
    couple = Program([(code.address("couple"), [*rows, k.dense])], (code, k, rows))
    choose = BoundFunction(choose_rows_of_code, k._replace(factorise_code=made, fill_dense=couple))
    return Program([*made.steps, *choose.steps], keeps=(made, couple, choose))


def _make_split_entries(
    system: MultibodySystem,
    k: Kernel,
    needed: Collection[str],
    step: str,
    given_rows: list[np.ndarray],
    results: list[np.ndarray],
) -> tuple[dict[str, Any], int]:
    """Return programs of code for the ``needed`` entries that are in ``SPLIT``, and the operations of an evaluation.

    ``step`` is "split" or "mean"; the function ``rows`` computes A and ``results`` from ``given_rows``.
    """
    own = [name for name in SPLIT if name in needed]
    code, operations, (count, size) = make_mechanism_code(system, k, step, names=_list_functions(needed))
    A, A_kept, factor, poses = np.zeros(count), np.zeros(count), np.zeros(size), [k.t, k.r, k.R, k.v]
    x, w, r, R = (np.zeros_like(a) for a in (k.x, k.w, k.r, k.R))  # buffers for results before they are read
    shift, (bounds, shares) = np.ndarray(1, buffer=k.state), list_choice_arrays(k)
    given: dict[str, list[np.ndarray]] = {
        "rows": [*given_rows, A, *results],
        "factorise": [A, shift, *bounds, factor, *shares],
        "forces": [*poses, k.force],
        "applied_forces": [*poses, k.force],
        "react": [*poses, A, k.gamma, factor, k.v_dot, k.lam],
        "close_joints": [k.r, k.R, A, k.phi, factor, r, R],
        "copy_poses": [r, R, k.r, k.R],
        "project_rates": [A, k.slip, factor, k.v, w, k.rhs],
        "slips": [A, k.slip, k.w, k.x],
        "solve": [factor, k.rhs, x],
        "copy_rows": [x, k.rhs],
        "push": [A, k.x, k.w, w],
        "copy_entries": [A, A_kept],
        "copy_bodies": [w, k.w],
    }
    of_entry = {"push_kept": {"push": [A_kept, k.x, k.w, w]}}
    of_entry |= {name: {"copy_bodies": [w, k.v]} for name in ("project", "project_rates")}
    keeps = code, k, given, of_entry
    factorise = make_choosing_program(k, code, "factorise", given["factorise"], [A])
    entries: dict[str, Any] = {}
    for name in own:
        steps = [
            step
            for f in SPLIT[name]
            for step in (
                factorise.steps if f == "factorise" else [(code.address(f), of_entry.get(name, {}).get(f, given[f]))]
            )
        ]
        entries[name] = Program(steps, (keeps, factorise), f"mechanism.{name}")
    if "leave_out" in needed and len(k.dense):
        entries["leave_out"] = BoundFunction(leave_out_of_code, k)
    return entries, operations


def _list_functions(needed: Collection[str]) -> tuple[str, ...]:
    """Return the names of functions of ``rows.split_mechanism`` that an evaluation and the ``needed`` entries call."""
    return tuple(sorted(set(SPLIT_EVALUATION).union(*(SPLIT[name] for name in needed if name in SPLIT))))


@making_code
def make_mechanism_code(
    system: MultibodySystem, k: Kernel, step: str = "", **choices: Any
) -> tuple[Code, int, list[int]]:
    """Return code of a mechanism, made or read from disk, the operations of an evaluation, and the sizes of its arrays.

    ``step`` is "" for accelerations, "iterate" (``rows.wrenches``), "split" or "mean"; ``choices`` are the further
    arguments of its ``make_functions``. Sizes: that of the factor; but for "", first the number of entries of A (or of
    the step's start) that are kept. Raises ``NoMechanismCode`` where none can be made.
    """
    reason = find_code_refusal(system, k)
    if reason:
        raise NoMechanismCode(reason)
    code, about = Code(lambda: _print_code(system, k, step, choices), _make_key(system, k, step, choices)), np.zeros(4)
    code.function("about", 1)(about.ctypes.data)
    operations, *sizes = (int(x) for x in about)
    if operations > MOST_OPERATIONS:
        raise NoMechanismCode(_describe_size_refusal(operations))
    return code, operations, sizes[: 2 if step else 1]


def _describe_size_refusal(operations: int) -> str:
    """Return the message for a mechanism whose code needs ``operations`` or more per evaluation, too many."""
    return (
        f"code for the mechanism takes up to {MOST_OPERATIONS} operations an evaluation (needs {operations} or more): "
        "use code = kernel"
    )


def _print_code(system: MultibodySystem, k: Kernel, step: str, choices: dict[str, Any]) -> str:
    """Return the LLVM IR of the functions of a mechanism, and of ``about``, which returns operations and array sizes.

    If the code needs more than ``MOST_OPERATIONS``, it contains ``about`` alone.
    """
    import casadi as ca

    from ....harness.base.generated.functions import GeneratedFunction, record_function
    from ..rows.mechanism import JointPart, SymbolicMechanism
    from ..rows.split_mechanism import MeanMechanism, SplitMechanism
    from ..rows.wrenches import SimplifiedStep

    parts = [
        JointPart(
            str(joints.KINDS[part.kind]), tuple(range(part.lo, part.hi)), part.joint, (int(i), int(j)), int(first)
        )
        for part, (i, j), first in zip(list_parts(system)[1], k.body, k.row, strict=False)
    ]
    kinds = {"": SymbolicMechanism, "iterate": SimplifiedStep, "split": SplitMechanism, "mean": MeanMechanism}
    functions, sizes = kinds[step](system, parts, _list_rows_in_order(k), len(k.dense) > 0).make_functions(**choices)
    operations = sum(len(record_function(functions[name]).tape.operations) for name in EVALUATION[step])
    if operations > MOST_OPERATIONS:
        functions = {}
    about = ca.vertcat(operations, *sizes, *(0 for _ in range(3 - len(sizes))))
    return print_functions({**functions, "about": GeneratedFunction([], [about])})


def _list_rows_in_order(k: Kernel) -> list[int]:
    """Return the kernel's constraint rows in the order in which they are eliminated."""
    return [int(first) + a for first, size in zip(k.blocks.row, k.blocks.size, strict=True) for a in range(size)]


def _estimate_least_operations(k: Kernel) -> int:
    """Return a lower bound on the operations of the code: those of the factor's block products, and some a row.

    It is found without writing the code, which would take seconds.
    """
    columns, products = np.repeat(k.blocks.size, np.diff(k.blocks.update_start)), k.blocks.update
    height = k.blocks.size[k.blocks.other]
    factor = np.sum(columns * height[products[:, 1]] * height[products[:, 2]])
    return int(factor + LEAST_OF_A_ROW * len(k.lam))


def _make_key(system: MultibodySystem, k: Kernel, step: str, choices: dict[str, Any]) -> str:
    """Return the key of the code on disk: a digest of the system's numbers, the kernel's order and the generator.

    ``step`` and ``choices`` are in it as they are.
    """
    # with the bound, above which the code has no functions
    makers = digest_makers(), digest_files((__file__, str(FACTOR))), MOST_OPERATIONS
    digest = hashlib.sha256(
        f"{makers} {_list_rows_in_order(k)} {k.row.tolist()} {k.body.tolist()} {len(k.dense)}".encode()
    )
    digest.update(system.regular_inertia.tobytes())
    for field in fields(system):
        value = getattr(system, field.name)
        if isinstance(value, np.ndarray) and value.dtype != object:
            digest.update(f"{field.name} {value.shape} {value.dtype}".encode() + value.tobytes())
    return f"mechanism {step} {choices} {digest.hexdigest()}"
