"""Functions of machine code: functions of whole arrays, and loops over elements of one kind."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import casadi as ca

from .tape import Tape, record_operations


@dataclass(frozen=True)
class GeneratedFunction:
    """``void f(double* inputs..., double* outputs...)``: one array for each expression, matrices column by column.

    Outputs must not overlap inputs, nor each other.
    """

    inputs: Sequence[ca.SX]
    outputs: Sequence[ca.SX]

    @cached_property
    def recorded(self) -> "RecordedTape":
        """Tape of the function's scalar operations, recorded once."""
        return _record_arrays([("whole", x) for x in self.inputs], [("whole", x) for x in self.outputs])


@dataclass(frozen=True)
class Loop:
    """Expressions evaluated for each of n elements, such as bodies or joints, in one call.

    The C arguments, all pointers, in this order: ``int64 n``; each of ``whole``, an array that all elements read; each
    of ``rows``, an array (n, size) of which each element reads its row; each of ``gathered`` as two, the array read and
    an ``int64`` table (n, size) of indices; each of ``blocks`` likewise, with a table (n,) of the first indices of
    contiguous numbers; each of ``stored``, an array (n, size) that is written by rows; each of ``added`` as two, the
    array added to and the table of indices; each of ``added_blocks`` likewise, by first indices. The tables are not
    checked: dropped values go to a dummy at the end of the array. Outputs must not overlap inputs.
    """

    whole: Sequence[ca.SX] = ()
    rows: Sequence[ca.SX] = ()
    gathered: Sequence[ca.SX] = ()
    stored: Sequence[ca.SX] = ()
    added: Sequence[ca.SX] = ()
    blocks: Sequence[ca.SX] = ()
    added_blocks: Sequence[ca.SX] = ()


class Array(NamedTuple):
    """An array argument: how it is accessed, and its size, or that of a row."""

    access: str  # whole, rows, gathered, blocks; stored, added, added_blocks
    size: int


class RecordedTape(NamedTuple):
    """A tape with the arrays that it reads and writes."""

    tape: Tape
    inputs: list[Array]
    outputs: list[Array]
    results: list[list[int]]  # numbers on the tape, one list an output


def record_function(function: GeneratedFunction | Loop) -> RecordedTape:
    """Record the operations of ``function``; raise ValueError for inputs that are not dense symbols."""
    if isinstance(function, GeneratedFunction):
        return function.recorded
    return _record_arrays(
        [(how, x) for how in ("whole", "rows", "gathered", "blocks") for x in getattr(function, how)],
        [(how, x) for how in ("stored", "added", "added_blocks") for x in getattr(function, how)],
    )


def _record_arrays(inputs: list[tuple[str, ca.SX]], outputs: list[tuple[str, ca.SX]]) -> RecordedTape:
    """Record the operations that lead from ``inputs`` to ``outputs``, pairs of an access (see ``Array``) and a matrix.

    Raise ValueError for inputs that are not dense symbols.
    """
    made = ca.Function("f", [x for _, x in inputs], [ca.densify(x) for _, x in outputs])
    tape = Tape()
    numbers = [[tape.input(k, place) for place in range(x.numel())] for k, (_, x) in enumerate(inputs)]
    for (_, x), own in zip(inputs, numbers, strict=True):
        if x.nnz() != len(own):
            raise ValueError(f"inputs are dense symbols (got {x.nnz()} nonzeros of {len(own)})")
    results = record_operations(tape, made, numbers)
    read, written = ([Array(how, x.numel()) for how, x in part] for part in (inputs, outputs))
    return RecordedTape(tape, read, written, results)
