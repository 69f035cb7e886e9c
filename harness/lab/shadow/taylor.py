"""Expand the operations of a tape as Taylor series in 80 bits (x86's long double) or 113 bits (IEEE binary128).

Nothing is compiled for a mechanism: one loop over a table of operations evaluates order after order. With c the result
of an operation and ' the rate, order k follows from the orders below by Leibniz's rule (Jorba and Zou 2005,
Experimental Mathematics 14)::

    c = a b:  c_k = sum_j a_j b_k-j       c = a / b:  c_k = (a_k - sum_j>0 b_j c_k-j) / b_0
    c = f(a), c' = g a':  c_k = sum_j>0 j a_j g_k-j / k       a state:  y_k+1 = (y')_k / (k + 1)

Numbers enter and leave as sums of three doubles, which hold 113 bits.
"""

from collections.abc import Sequence
from fractions import Fraction

import numpy as np
from jaxtyping import Float, Int

from ...base.generated.functions import GeneratedFunction, record_function
from ...base.generated.tape import Tape, find_needed
from .series_code import FUNCTIONS, KINDS, PARTS, compile_machine

Sums = Float[np.ndarray, "n 3"]


def split_doubles(x: Fraction) -> list[float]:
    """Return ``x``, rounded to 113 bits or more, as a list of three doubles with that sum."""
    out = []
    for _ in range(PARTS):
        out.append(float(x))
        x -= Fraction(out[-1])
    return out


def sum_exactly(parts: Sequence[float] | np.ndarray) -> Fraction:
    """Return the exact sum of doubles."""
    return sum((Fraction(float(x)) for x in parts), Fraction(0))


class TaylorSeries:
    """The Taylor series of a function's operations and, where its outputs are rates of its inputs, of these."""

    def __init__(self, function: GeneratedFunction, bits: int, order: int = 0, *, rates: bool = False) -> None:
        """Record ``function``, with ``rates`` only its first outputs, which are the rates of its inputs.

        ``order`` is that of the series of the inputs; without ``rates`` only values are computed. Raise ValueError for
        operations without series.
        """
        recorded = record_function(function)
        n = sum(x.size for x in recorded.inputs)
        results = [k for output in recorded.results for k in output][: n if rates else None]
        table = _Table(recorded.tape, [(k, p) for k, x in enumerate(recorded.inputs) for p in range(x.size)], results)
        self._machine, self._order = compile_machine(bits), order if rates else 0
        self._inputs = n
        self._results: Int[np.ndarray, " n"] = np.array([table.places[k] for k in results], dtype=np.int64)
        if rates:
            table.rows += [(KINDS.index("state"), int(k), 0, i, 0) for i, k in enumerate(self._results)]
        self._table = np.array(table.rows, dtype=np.int64).reshape(-1, 5)
        self._stride = order + 1 + rates
        self._C = np.zeros((table.size, self._stride, 2))  # 16 bytes for each number
        self._write_numbers(table.size, np.array(table.start))

    def _write_numbers(self, n: int, x: np.ndarray) -> None:
        """Write sums of doubles as order 0 of the first n numbers."""
        self._machine.join(x.ctypes.data, n, self._stride, self._C.ctypes.data)

    def _read_coefficients(self, n: int, order: int) -> Sums:
        """Return the coefficients of one order of the first n numbers, as sums of doubles."""
        out = np.empty((n, PARTS))
        self._machine.split(self._C.ctypes.data + 16 * order, n, self._stride, out.ctypes.data)
        return out

    def expand(self, x: Sums) -> None:
        """Compute the coefficients of all orders about the inputs ``x``, which the other methods read."""
        self._write_numbers(self._inputs, np.ascontiguousarray(x))
        t = self._table
        if len(t) == 0:
            return
        self._machine.expand(t.ctypes.data, len(t), self._C.ctypes.data, self._stride, self._order + 1)

    def evaluate(self, x: Sums) -> Sums:
        """Return the outputs of the function at the inputs ``x``."""
        self.expand(x)
        return self._read_coefficients(len(self._C), 0)[self._results]

    def find_largest_coefficient(self, order: int) -> float:
        """Return the largest absolute value of the inputs' coefficients of one order."""
        return float(np.max(np.abs(self._read_coefficients(self._inputs, order)[:, 0])))

    def sum_series(self, h: Fraction) -> Sums:
        """Return the inputs after ``h`` [s], by the series of the last ``expand``."""
        out, parts = np.empty((self._inputs, PARTS)), np.array(split_doubles(h))
        self._machine.sum(self._C.ctypes.data, self._inputs, self._stride, parts.ctypes.data, out.ctypes.data)
        return out


class _Table:
    """The table of operations (kind, a, b, result, second argument of a function), and order 0 of given numbers.

    Operands and results are indices of numbers; ``places`` has the index of each number of the tape.
    """

    def __init__(self, tape: Tape, inputs: list[tuple[int, int]], results: list[int]) -> None:
        """Add the operations of ``tape`` that ``results`` need; ``inputs`` are (input, position) by number."""
        self.rows: list[tuple[int, int, int, int, int]] = []
        self.start = [[0.0] * PARTS for _ in inputs]
        self.places: dict[int, int] = {}
        self._pairs: dict[int, tuple[int, int]] = {}
        self._inputs = {at: k for k, at in enumerate(inputs)}
        self._tape, self._one = tape, self._constant(1.0)
        for number in find_needed(tape, results):
            self.places[number] = self._add_tape_operation(number)

    @property
    def size(self) -> int:
        """Number of numbers, each of which has a row of coefficients."""
        return len(self.start)

    def _add_number(self, x: float = 0.0) -> int:
        """Add a number whose order 0 is ``x``; return its index."""
        self.start.append([x, *[0.0] * (PARTS - 1)])
        return len(self.start) - 1

    _constant = _add_number

    def _add(self, kind: str, a: int, b: int = 0, second: int = 0, out: int | None = None) -> int:
        """Add an operation on the numbers a and b; return the index of its result, ``out`` or a new one."""
        out = self._add_number() if out is None else out
        self.rows.append(((*KINDS, *FUNCTIONS).index(kind), a, b, out, second))
        return out

    def _add_tape_operation(self, number: int) -> int:
        """Add the rows for an operation of the tape; return the index of its result."""
        name, a, b = self._tape.operations[number]
        if name == "input":
            return self._inputs[a, b]
        if name == "constant":
            value = self._tape.value(number)
            assert value is not None
            return self._constant(value)
        x, y = self.places[a], self.places[b] if b >= 0 else 0
        constants = [self._tape.value(k) is not None for k in (a, b) if k >= 0]
        if name == "mul" and any(constants):
            return self._add("scale", *((y, x) if constants[0] else (x, y)))
        if name in KINDS:
            return self._add(name, x, y)
        if name in ("sin", "cos"):
            return self._add_sine_cosine(a, x)[name == "cos"]
        return self._add_function(name, x, y)

    def _add_sine_cosine(self, a: int, x: int) -> tuple[int, int]:
        """Add sine and cosine of the tape's number ``a``, at index ``x``; return their indices.

        Each is the derivative of the other up to sign, so both are added together, once for each number.
        """
        if a not in self._pairs:
            s, c, back = self._add_number(), self._add_number(), self._add_number()
            self._add("sin", x, c, out=s)
            self._add("cos", x, back, out=c)
            self._add("neg", s, out=back)
            self._pairs[a] = s, c
        return self._pairs[a]

    def _add_function(self, name: str, x: int, y: int) -> int:
        """Add the function ``name`` of the number x with its derivative; return the index of the result.

        Only atan2(x, y) uses y. The derivative may be an operation on the result. Raise ValueError for a function whose
        Taylor series is not implemented.
        """
        out = self._add_number()
        if name == "exp":
            return self._add(name, x, out, out=out)
        if name == "log":
            return self._add(name, x, self._add("div", self._one, x), out=out)
        if name == "sqrt":
            derivative = self._add_number()
            self._add(name, x, derivative, out=out)
            self._add("div", self._constant(0.5), out, out=derivative)
            return out
        if name in ("atan", "atan2"):
            y = self._one if name == "atan" else y
            # d atan2(x, y) = (y dx - x dy) / (x^2 + y^2): one row for each term. The first has the value at order 0,
            # the second is a function of kind "none", which is 0 there and has higher orders only.
            square = self._add("add", self._add("mul", x, x), self._add("mul", y, y))
            x_term = self._add("atan2", x, self._add("div", y, square), y)
            y_term = self._add("none", y, self._add("neg", self._add("div", x, square)))
            return self._add("add", x_term, y_term, out=out)
        raise ValueError(f"has an operation without Taylor series here ({name})")
