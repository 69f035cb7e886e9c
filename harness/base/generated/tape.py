"""A list of scalar operations in which equal ones are shared and those on constants are evaluated.

A product with zero is zero whatever the other factor is, as in CasADi: code made from a tape does not carry NaN through
a structural zero.
"""

import math
import struct
from collections.abc import Callable
from typing import NamedTuple

import casadi as ca

UNARY: dict[int, str] = {
    ca.OP_NEG: "neg",
    ca.OP_EXP: "exp",
    ca.OP_LOG: "log",
    ca.OP_SQRT: "sqrt",
    ca.OP_SIN: "sin",
    ca.OP_COS: "cos",
    ca.OP_TAN: "tan",
    ca.OP_ASIN: "asin",
    ca.OP_ACOS: "acos",
    ca.OP_ATAN: "atan",
    ca.OP_NOT: "not",
    ca.OP_FLOOR: "floor",
    ca.OP_CEIL: "ceil",
    ca.OP_FABS: "fabs",
    ca.OP_SIGN: "sign",
    ca.OP_ERF: "erf",
    ca.OP_SINH: "sinh",
    ca.OP_COSH: "cosh",
    ca.OP_TANH: "tanh",
    ca.OP_ASINH: "asinh",
    ca.OP_ACOSH: "acosh",
    ca.OP_ATANH: "atanh",
    ca.OP_LOG1P: "log1p",
    ca.OP_EXPM1: "expm1",
}
BINARY: dict[int, str] = {
    ca.OP_ADD: "add",
    ca.OP_SUB: "sub",
    ca.OP_MUL: "mul",
    ca.OP_DIV: "div",
    ca.OP_POW: "pow",
    ca.OP_CONSTPOW: "pow",
    ca.OP_LT: "lt",
    ca.OP_LE: "le",
    ca.OP_EQ: "eq",
    ca.OP_NE: "ne",
    ca.OP_AND: "and",
    ca.OP_OR: "or",
    ca.OP_FMOD: "fmod",
    ca.OP_REMAINDER: "remainder",
    ca.OP_COPYSIGN: "copysign",
    ca.OP_FMIN: "fmin",
    ca.OP_FMAX: "fmax",
    ca.OP_ATAN2: "atan2",
    ca.OP_HYPOT: "hypot",
    ca.OP_IF_ELSE_ZERO: "if_else_zero",
}
COMMUTES = frozenset(("add", "mul", "eq", "ne", "and", "or"))
FOLDED: dict[str, Callable[..., float]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "neg": lambda a: -a,
    "sqrt": math.sqrt,
    "sin": math.sin,
    "cos": math.cos,
    "exp": math.exp,
    "fabs": abs,
}


class Operation(NamedTuple):
    """An operation: ``name``, and the numbers ``a``, ``b`` of its arguments on the tape.

    ``a`` and ``b`` of an input are its array and index; ``a`` of a constant holds its bits.
    """

    name: str
    a: int
    b: int = -1


class Tape:
    """Operations, each after its arguments; the number k stands for the result of ``operations[k]``."""

    def __init__(self) -> None:
        self.operations: list[Operation] = []
        self._numbers: dict[Operation, int] = {}
        self.zero, self.one = self.constant(0.0), self.constant(1.0)

    def constant(self, value: float) -> int:
        """Return the number of a constant on the tape, recorded if new; -0 is taken as 0."""
        return self._record(Operation("constant", struct.unpack("<q", struct.pack("<d", value + 0.0))[0]))

    def input(self, array: int, place: int) -> int:
        """Return the number of the entry at index ``place`` of input ``array``, recorded if new."""
        return self._record(Operation("input", array, place))

    def value(self, number: int) -> float | None:
        """Return the value of a constant, None for any other number."""
        name, bits, _ = self.operations[number]
        return struct.unpack("<d", struct.pack("<q", bits))[0] if name == "constant" else None

    def apply(self, name: str, a: int, b: int = -1) -> int:
        """Record the operation ``name`` on the numbers ``a`` and ``b``; return the number of its result.

        ``b`` is -1 for an operation with one argument. Operations on constants are evaluated, others simplified where
        that is exact for finite numbers, and equal ones recorded once.
        """
        values = [self.value(x) for x in (a, b) if x >= 0]
        if name in FOLDED and None not in values:
            try:
                return self.constant(FOLDED[name](*values))
            except (ArithmeticError, ValueError):  # left to the processor: infinite or NaN
                return self._record(Operation(name, a, b))
        simple = self._simplify(name, a, b)
        if simple is not None:
            return simple
        if name in COMMUTES and a > b:
            a, b = b, a
        return self._record(Operation(name, a, b))

    def _simplify(self, name: str, a: int, b: int) -> int | None:
        """Return the number that an operation equals by algebra (x + 0, x 1, x - x, ...); None if no rule applies."""
        zero, one = self.zero, self.one
        if name == "neg" and self.operations[a].name == "neg":
            return self.operations[a].a
        if name == "add" and zero in (a, b):
            return b if a == zero else a
        if name == "sub" and b == zero:
            return a
        if name == "sub" and a == b:
            return zero
        if name == "sub" and a == zero:
            return self.apply("neg", b)
        if name == "mul" and zero in (a, b):
            return zero
        if name in ("mul", "div") and b == one:
            return a
        if name == "mul" and a == one:
            return b
        if name == "mul" and -1.0 in (self.value(a), self.value(b)):
            return self.apply("neg", b if self.value(a) == -1.0 else a)
        return None

    def _record(self, operation: Operation) -> int:
        """Return the number of ``operation``, which is appended to the tape if it is new."""
        number = self._numbers.setdefault(operation, len(self.operations))
        if number == len(self.operations):
            self.operations.append(operation)
        return number


def record_operations(tape: Tape, function: ca.Function, inputs: list[list[int]]) -> list[list[int]]:
    """Record all operations of a CasADi ``function`` on ``tape``; return the numbers of its outputs, a list for each.

    ``inputs`` are the numbers of the entries of its inputs, likewise; outputs must be dense. Raise ValueError for an
    operation without counterpart.
    """
    work: dict[int, int] = {}
    outputs = [[tape.zero] * function.nnz_out(k) for k in range(function.n_out())]
    for k in range(function.n_instructions()):
        operation, at = function.instruction_id(k), function.instruction_input(k)
        to = function.instruction_output(k)
        if operation == ca.OP_INPUT:
            work[to[0]] = inputs[at[0]][at[1]]
        elif operation == ca.OP_OUTPUT:
            outputs[to[0]][to[1]] = work[at[0]]
        elif operation == ca.OP_CONST:
            work[to[0]] = tape.constant(function.instruction_constant(k))
        elif operation == ca.OP_ASSIGN:
            work[to[0]] = work[at[0]]
        elif operation in (ca.OP_SQ, ca.OP_TWICE):
            work[to[0]] = tape.apply("mul" if operation == ca.OP_SQ else "add", work[at[0]], work[at[0]])
        elif operation == ca.OP_INV:
            work[to[0]] = tape.apply("div", tape.one, work[at[0]])
        elif operation in UNARY:
            work[to[0]] = tape.apply(UNARY[operation], work[at[0]])
        elif operation in BINARY:
            work[to[0]] = tape.apply(BINARY[operation], work[at[0]], work[at[1]])
        else:
            raise ValueError(f"no machine code is made of CasADi's operation {operation}: write the expression without")
    return outputs


def find_needed(tape: Tape, results: list[int]) -> list[int]:
    """Return the numbers of the tape on which ``results`` depend, themselves included, in ascending order."""
    live, waiting = set(results), list(results)
    while waiting:
        name, a, b = tape.operations[waiting.pop()]
        for x in () if name in ("constant", "input") else (a, b):
            if x >= 0 and x not in live:
                live.add(x)
                waiting.append(x)
    return sorted(live)
