"""A list of calls of C functions, run from Python by one call, which takes 0.2 us.

Any function without result whose arguments are all pointers can be called: those of a ``Code``, and LAPACK's.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from .code import Code

MOST_ARGUMENTS = 56


class Program:
    """A list of calls of functions by address with arrays; it keeps alive the arrays and what ``keeps`` refers to.

    ``entry``, also ``int`` of the program, is the word by which compiled code runs it; ``name`` is what it prints as.
    """

    def __init__(
        self, steps: Sequence[tuple[int, Sequence[np.ndarray]]], keeps: Any = None, name: str = "nameless"
    ) -> None:
        """Prepare the calls; arrays are used in place: contiguous, and of the type that the function expects.

        Raises ValueError for arrays that are not contiguous, and for more than ``MOST_ARGUMENTS`` of them in a call.
        """
        self.steps = list(steps)
        words = [compile_runner().address("run"), len(steps)]
        for address, arrays in steps:
            if len(arrays) > MOST_ARGUMENTS:
                raise ValueError(f"a call takes at most {MOST_ARGUMENTS} arrays (got {len(arrays)})")
            if not all(a.flags.c_contiguous or a.flags.f_contiguous for a in arrays):
                raise ValueError("arrays of a program are contiguous: functions know their addresses alone")
            words += [address, len(arrays), *(a.ctypes.data for a in arrays)]
        self._words = np.array(words, dtype=np.int64)
        self._keeps, self._name = keeps, name
        self.entry = self._words.ctypes.data
        self._run = compile_runner().function("run", 1)
        # a step of another program, which must keep this one alive
        self.step = compile_runner().address("run"), [self._words[1:]]

    def __int__(self) -> int:
        return self.entry

    def __repr__(self) -> str:
        return f"<program {self._name}: {len(self.steps)} calls>"

    def run(self) -> None:
        """Run the calls, in order."""
        self._run(self.entry + 8)


@cache
def compile_runner() -> Code:
    """Return the code of ``run(program)``, which executes a list of calls.

    The program's first word is the number of its steps; each step is (address, number of arguments, arguments...).
    """
    cases = range(MOST_ARGUMENTS + 1)
    lines = [
        "define void @run(ptr %program) {",
        "entry:",
        "  %steps = load i64, ptr %program",
        "  %first = getelementptr i64, ptr %program, i64 1",
        "  br label %next",
        "next:",
        "  %k = phi i64 [ 0, %entry ], [ %k1, %ran ]",
        "  %at = phi ptr [ %first, %entry ], [ %at1, %ran ]",
        "  %more = icmp slt i64 %k, %steps",
        "  br i1 %more, label %call, label %done",
        "call:",
        "  %f = load ptr, ptr %at",
        "  %countp = getelementptr i64, ptr %at, i64 1",
        "  %n = load i64, ptr %countp",
        "  %arguments = getelementptr i64, ptr %at, i64 2",
        f"  switch i64 %n, label %done [ {' '.join(f'i64 {n}, label %with{n}' for n in cases)} ]",
    ]
    for n in cases:
        lines.append(f"with{n}:")
        for k in range(n):
            lines.append(f"  %p{n}.{k} = getelementptr ptr, ptr %arguments, i64 {k}")
            lines.append(f"  %a{n}.{k} = load ptr, ptr %p{n}.{k}")
        lines += [f"  call void %f({', '.join(f'ptr %a{n}.{k}' for k in range(n))})", "  br label %ran"]
    lines += [
        "ran:",
        "  %k1 = add i64 %k, 1",
        "  %words = add i64 %n, 2",
        "  %at1 = getelementptr i64, ptr %at, i64 %words",
        "  br label %next",
        "done:",
        "  ret void",
        "}",
        "",
    ]
    return Code("\n".join(lines))
