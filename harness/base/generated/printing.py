"""LLVM IR of recorded functions.

Long functions are cut into parts of ``PART`` operations, which pass values on in an array on the stack: the time that
LLVM takes grows faster than the number of operations in one function.

A product that is read by one sum or difference alone is contracted with it, written as ``llvm.fma``. If this were left
to LLVM, the processor would decide which of two products is contracted, and the last bits of a motion would depend on
it.
"""

from collections import Counter
from collections.abc import Iterator

from .functions import Array, GeneratedFunction, Loop, RecordedTape, record_function
from .tape import find_needed

PART = 1500  # operations of a part
TABLED = ("gathered", "blocks", "added", "added_blocks")  # accessed through a table of places
ARITHMETIC = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv", "fmod": "frem"}
COMPARED = {"lt": "olt", "le": "ole", "eq": "oeq", "ne": "une"}
LEAST_AND_LARGEST = {"fmin": "minnum", "fmax": "maxnum"}  # LLVM's names
INTRINSIC = (  # functions of LLVM; the others are libm's
    "sin",
    "cos",
    "exp",
    "log",
    "sqrt",
    "fabs",
    "floor",
    "ceil",
    "pow",
    "copysign",
    *LEAST_AND_LARGEST.values(),
)


def print_module(functions: dict[str, GeneratedFunction | Loop]) -> str:
    """Return the LLVM IR of all ``functions`` as one module."""
    lines: list[str] = []
    callees: dict[str, None] = {}
    for name, function in functions.items():
        lines += _Printer(name, record_function(function), isinstance(function, Loop), callees).print_lines()
    return "\n".join([*(f"declare double {callee}" for callee in callees), *lines, ""])


Result = tuple[int, int, int]  # output, place in it, number on the tape


class _Printer:
    """The IR of a function and of its parts."""

    def __init__(self, name: str, recorded: RecordedTape, loops: bool, callees: dict[str, None]) -> None:
        """Find the live operations of function ``name``, a loop over elements if ``loops``, and its results' sources.

        Printing adds the external functions that it calls to ``callees``, an ordered set.
        """
        self._name, self._recorded, self._loops, self._callees = name, recorded, loops, callees
        self._operations = recorded.tape.operations
        outputs = enumerate(recorded.results)
        self._results = [(k, place, number) for k, output in outputs for place, number in enumerate(output)]
        result_numbers = [number for _, _, number in self._results]
        needed = find_needed(recorded.tape, result_numbers)
        self._live = [number for number in needed if self._operations[number].name not in ("constant", "input")]
        computed = set(self._live)
        self._given = [result for result in self._results if result[2] not in computed]  # constants and inputs
        self._reads = Counter(operand for number in self._live for operand in self._operations[number][1:])
        self._reads.update(result_numbers)  # how often each number is read; a result is read once more, when stored
        self._slots: dict[int, int] = {}  # by number, its index in the array that passes values between parts

    def print_lines(self) -> list[str]:
        """Return the lines of IR of the function, preceded by those of its parts if it is long."""
        cuts = range(0, max(1, len(self._live)), PART)
        parts = [self._live[start : start + PART] for start in cuts]
        given = [self._given[start : start + PART] for start in range(0, max(1, len(self._given)), PART)]
        if max(len(parts), len(given)) > 1:  # parts of operations first, then parts that only store given results
            parts, given = [*parts, *([] for _ in given)], [*([] for _ in parts), *given]
        lines: list[str] = []
        calls: list[str] = []
        if len(parts) == 1:
            calls = list(self._print_body(parts[0], given[0]))
        else:
            self._allocate_slots(parts)
            for k, (part, rest) in enumerate(zip(parts, given, strict=True)):
                name = f'@"{self._name}.{k}"'
                lines.append(f"define internal void {name}({self._parameters()}, i64 %e, ptr %slots) noinline {{")
                lines += [*self._print_body(part, rest), "  ret void", "}"]
                calls.append(f"  call void {name}({self._arguments()}, i64 %e, ptr %slots)")
        return [*lines, *self._print_entry(calls)]

    def _print_entry(self, calls: list[str]) -> Iterator[str]:
        """Yield the lines of the function that callers see: ``calls`` once, or in a loop over the elements."""
        shared = any("%slots" in call for call in calls)  # all parts take it, even where no number passes between them
        slots = [f"  %slots = alloca double, i64 {max(len(self._slots), 1)}"] if shared else []
        if not self._loops:
            calls = [line.replace("i64 %e", "i64 0") for line in calls]
            yield from (f'define void @"{self._name}"({self._parameters()}) {{', *slots, *calls, "  ret void", "}")
            return
        separator = ", " if self._arguments() else ""
        yield from (
            f'define void @"{self._name}"(ptr %n{separator}{self._arguments()}) {{',
            "entry:",
            *slots,
            "  %count = load i64, ptr %n",
            "  %any = icmp sgt i64 %count, 0",
            "  br i1 %any, label %element, label %done",
            "element:",
            "  %e = phi i64 [ 0, %entry ], [ %next, %element ]",
            *calls,
            "  %next = add nsw i64 %e, 1",
            "  %more = icmp slt i64 %next, %count",
            "  br i1 %more, label %element, label %done",
            "done:",
            "  ret void",
            "}",
        )

    def _arrays(self) -> Iterator[tuple[str, Array]]:
        """Yield the name in IR and the description of each array argument, inputs first."""
        for letter, arrays in (("x", self._recorded.inputs), ("y", self._recorded.outputs)):
            yield from ((f"{letter}{k}", array) for k, array in enumerate(arrays))

    def _arguments(self) -> str:
        """Return the list of array arguments as written in IR, each table of indices after its array."""
        names = []
        for name, array in self._arrays():
            names.append(f"ptr %{name}")
            if array.access in TABLED:
                names.append(f"ptr %{name}.at")
        return ", ".join(names)

    def _parameters(self) -> str:
        """Return the declared arguments: arrays of straight-line functions do not overlap, which halves LLVM's time."""
        return self._arguments() if self._loops else self._arguments().replace("ptr", "ptr noalias")

    def _allocate_slots(self, parts: list[list[int]]) -> None:
        """Allocate an element of the array on the stack for each number of the tape that a later part reads."""
        at = {number: k for k, part in enumerate(parts) for number in part}
        for k, part in enumerate(parts):
            for number in part:
                _, *arguments = self._operations[number]
                for x in arguments:
                    if at.get(x, k) < k:
                        self._slots.setdefault(x, len(self._slots))

    def _find_fused(self, part: list[int]) -> dict[int, int]:
        """Return, by sum or difference of ``part``, the product that it is contracted with, if there is one.

        It is the first of its two arguments that is a product in the same part and is read by it alone.
        """
        own, out = set(part), dict[int, int]()
        for number in part:
            name, a, b = self._operations[number]
            if name in ("add", "sub"):
                products = [x for x in (a, b) if x in own and self._operations[x].name == "mul" and self._reads[x] == 1]
                if products:
                    out[number] = products[0]
        return out

    def _print_body(self, part: list[int], given: list[Result]) -> Iterator[str]:
        """Return the lines of IR that compute ``part``, then store its slots, its results and ``given``.

        ``given`` are results of the function that are constants or inputs.
        """
        body = _Body(self._recorded, self._slots, self._callees, self._find_fused(part))
        for number in part:
            body.write_operation(number)
        own = set(part)
        for number in part:
            if number in self._slots:
                place = body.write_address("slots", str(self._slots[number]))
                body.write(f"store double {body.load_number(number)}, ptr {place}")
        for result in (*(result for result in self._results if result[2] in own), *given):
            body.write_result(*result)
        return iter(body.lines)


class _Body:
    """Lines of straight-line IR, in which each value from outside is loaded once."""

    def __init__(
        self, recorded: RecordedTape, slots: dict[int, int], callees: dict[str, None], fused: dict[int, int]
    ) -> None:
        """Start without a line; ``fused`` has the product to contract with a sum (``_Printer._find_fused``)."""
        self.lines: list[str] = []
        self._recorded, self._slots, self._callees, self._fused = recorded, slots, callees, fused
        self._products = set(fused.values())
        self._names: dict[int, str] = {}
        self._truths: dict[int, str] = {}  # numbers that are truth values
        self._rows: dict[str, str] = {}  # addresses of the element's rows, by array or table
        self._fresh = 0  # number of IR values defined

    def write(self, line: str) -> None:
        """Append an indented line of IR."""
        self.lines.append("  " + line)

    def define(self, line: str) -> str:
        """Write the definition of a new IR value by the instruction ``line``; return the value's name."""
        self._fresh += 1
        self.write(f"%t{self._fresh} = {line}")
        return f"%t{self._fresh}"

    def write_address(self, array: str, place: str, kind: str = "double") -> str:
        """Write the computation of the address of an element of an array argument; return the address's name."""
        return self.define(f"getelementptr {kind}, ptr %{array}, i64 {place}")

    def load_number(self, number: int) -> str:
        """Return the IR name of the tape's ``number``; load it first if it is an input or from an earlier part."""
        if number not in self._names:
            name, a, b = self._recorded.tape.operations[number]
            if name == "constant":
                return f"0x{a & 0xFFFFFFFFFFFFFFFF:016X}"
            address = self._write_entry_address(f"x{a}", self._recorded.inputs[a], b) if name == "input" else None
            address = address or self.write_address("slots", str(self._slots[number]))
            self._names[number] = self.define(f"load double, ptr {address}")
        return self._names[number]

    def _write_entry_address(self, name: str, array: Array, place: int) -> str:
        """Write the computation of the address of an element's entry ``place`` in ``array``; return its name."""
        if array.access == "whole":
            return self.write_address(name, str(place))
        if array.access in ("blocks", "added_blocks"):  # the table has the first index of each element's block
            if name not in self._rows:
                first = self.define(f"load i64, ptr {self.write_address(f'{name}.at', '%e', 'i64')}")
                self._rows[name] = self.write_address(name, first)
            return self.define(f"getelementptr double, ptr {self._rows[name]}, i64 {place}")
        table = name if array.access in ("rows", "stored") else f"{name}.at"  # rows of values, or of their indices
        if table not in self._rows:
            first = self.define(f"mul nsw i64 %e, {array.size}")
            self._rows[table] = self.write_address(table, first, "double" if table == name else "i64")
        kind = "double" if table == name else "i64"
        at = self.define(f"getelementptr {kind}, ptr {self._rows[table]}, i64 {place}")
        return at if table == name else self.write_address(name, self.define(f"load i64, ptr {at}"))

    def write_result(self, output: int, place: int, number: int) -> None:
        """Store the tape's ``number`` at index ``place`` of an output, or add it there; an added zero is omitted."""
        array = self._recorded.outputs[output]
        added = array.access in ("added", "added_blocks")
        if added and number == self._recorded.tape.zero:
            return
        value, address = self.load_number(number), self._write_entry_address(f"y{output}", array, place)
        if added:
            value = self.define(f"fadd double {self.define(f'load double, ptr {address}')}, {value}")
        self.write(f"store double {value}, ptr {address}")

    def write_operation(self, number: int) -> None:
        """Write the instructions that compute the tape's ``number``.

        A product that is fused into a sum is written with that sum.
        """
        name, a, b = self._recorded.tape.operations[number]
        if name in (*COMPARED, "not", "and", "or"):
            if name in COMPARED:
                truth = self.define(f"fcmp {COMPARED[name]} double {self.load_number(a)}, {self.load_number(b)}")
            elif name == "not":
                truth = self.define(f"xor i1 {self._write_truth(a)}, true")
            else:
                truth = self.define(f"{name} i1 {self._write_truth(a)}, {self._write_truth(b)}")
            self._truths[number] = truth
            self._names[number] = self.define(f"uitofp i1 {truth} to double")
        elif name == "if_else_zero":
            truth = self._write_truth(a)
            self._names[number] = self.define(f"select i1 {truth}, double {self.load_number(b)}, double 0.0")
        elif name == "sign":
            x = self.load_number(a)
            below = self.define(f"fcmp olt double {x}, 0.0")
            other = self.define(f"select i1 {below}, double -1.0, double {x}")
            above = self.define(f"fcmp ogt double {x}, 0.0")
            self._names[number] = self.define(f"select i1 {above}, double 1.0, double {other}")
        elif name == "neg":
            self._names[number] = self.define(f"fneg double {self.load_number(a)}")
        elif number in self._products:
            return  # written with the sum that reads it
        elif number in self._fused:
            self._names[number] = self._write_fused(name, a, b, self._fused[number])
        elif name in ARITHMETIC:
            self._names[number] = self.define(f"{ARITHMETIC[name]} double {self.load_number(a)}, {self.load_number(b)}")
        else:
            arguments = [f"double {self.load_number(x)}" for x in (a, b) if x >= 0]
            name = LEAST_AND_LARGEST.get(name, name)
            callee = f"@llvm.{name}.f64" if name in INTRINSIC else f"@{name}"
            self._callees[f"{callee}({', '.join('double' for _ in arguments)})"] = None
            self._names[number] = self.define(f"call double {callee}({', '.join(arguments)})")

    def _write_fused(self, name: str, a: int, b: int, product: int) -> str:
        """Write a + b (``name`` add) or a - b (sub) as a fused multiply-add of operand ``product``; return its name."""
        _, x, y = self._recorded.tape.operations[product]
        first, second, other = self.load_number(x), self.load_number(y), self.load_number(b if product == a else a)
        # x y - b is fma(x, y, -b), and a - x y is fma(-x, y, a)
        if name == "sub" and product == a:
            other = self.define(f"fneg double {other}")
        elif name == "sub":
            first = self.define(f"fneg double {first}")
        self._callees["@llvm.fma.f64(double, double, double)"] = None
        return self.define(f"call double @llvm.fma.f64(double {first}, double {second}, double {other})")

    def _write_truth(self, number: int) -> str:
        """Return the IR name of a truth value (i1), that the tape's ``number`` is not zero; write it if new."""
        if number not in self._truths:
            self._truths[number] = self.define(f"fcmp une double {self.load_number(number)}, 0.0")
        return self._truths[number]
