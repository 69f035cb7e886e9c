"""Generate loops over tables of operations in 80 or 113 bits, as LLVM IR: ``expand``, ``sum``, ``join``, ``split``.

``expand`` (table, rows, C, stride, orders) applies a table of rows (kind, a, b, result, second argument) to the
coefficients C (numbers, stride), order by order; ``sum`` (C, n, stride, h, out) evaluates the series of the first n
numbers at h; ``join`` (x, n, stride, C) and ``split`` (C, n, stride, x) turn sums of three doubles, which hold 113
bits, to order 0 of numbers and back. The rules are those of ``taylor``.
"""

import platform
import re
from functools import cache

import llvmlite.binding as llvm

from ...base.generated import Code

TYPES = {80: ("x86_fp80", "l"), 113: ("fp128", "f128")}  # type in LLVM, and suffix of the functions of libm
PARTS = 3  # doubles in a number
KINDS = ("add", "sub", "neg", "mul", "scale", "div", "state")
FUNCTIONS = ("sin", "cos", "exp", "log", "sqrt", "atan2", "none")  # evaluated for order 0; "none" is 0


class Machine:
    """The compiled functions of one precision, with their code, which must outlive them."""

    def __init__(self, type_: str, suffix: str) -> None:
        """Compile for the type ``type_`` of LLVM, whose functions in libm have this suffix."""
        self._code = Code(_print_functions(type_, suffix))
        self.join, self.split, self.expand, self.sum = (
            self._code.function(name, n) for name, n in (("join", 4), ("split", 4), ("expand", 5), ("sum", 5))
        )


@cache
def compile_machine(bits: int) -> Machine:
    """Compile the functions for numbers of 80 or 113 ``bits``; raise ValueError unless on x86-64 and Linux."""
    if platform.machine() not in ("x86_64", "AMD64") or platform.system() != "Linux":
        raise ValueError("arithmetic of 80 and 113 bits needs an x86-64 processor and Linux")
    for library in ("libgcc_s.so.1", "libm.so.6"):
        llvm.load_library_permanently(library)
    return Machine(*TYPES[bits])


def _print_loop(name: str, first: str, last: str, before: str, start: str, body: str, after: str) -> str:
    """Return LLVM IR of a loop over %name.j from ``first`` to ``last``, whose result is %name.

    ``body`` computes %name.new from %name.sum, which begins as ``start``; ``before`` names the block before the loop,
    ``after`` is the code that follows.
    """
    return f"""
  %{name}.any = icmp sle i64 {first}, {last}
  br i1 %{name}.any, label %{name}.turn, label %{name}.done
{name}.turn:
  %{name}.j = phi i64 [ {first}, %{before} ], [ %{name}.next, %{name}.turn ]
  %{name}.sum = phi T [ {start}, %{before} ], [ %{name}.new, %{name}.turn ]{body}
  %{name}.next = add i64 %{name}.j, 1
  %{name}.more = icmp sle i64 %{name}.next, {last}
  br i1 %{name}.more, label %{name}.turn, label %{name}.done
{name}.done:
  %{name} = phi T [ {start}, %{before} ], [ %{name}.new, %{name}.turn ]{after}"""


def _print_map(name: str, source: str, target: str, body: str) -> str:
    """Return LLVM IR of a function from ``source`` to ``target``, one of %x (sums of doubles) and %C (numbers).

    ``body`` is the code for one element, at the addresses %xp and %p.
    """
    return f"""
define void @{name}(ptr {source}, i64 %n, i64 %stride, ptr {target}) {{
entry:
  br label %turn
turn:
  %e = phi i64 [ 0, %entry ], [ %e1, %turn ]
  %at = mul i64 %e, %stride
  %p = getelementptr T, ptr %C, i64 %at
  %xp = getelementptr [{PARTS} x double], ptr %x, i64 %e{body}
  %e1 = add i64 %e, 1
  %more = icmp slt i64 %e1, %n
  br i1 %more, label %turn, label %done
done:
  ret void
}}"""


def _print_product(name: str, p: str, q: str) -> str:
    """Return LLVM IR of %name.pq = p_j q_k-j, a term of the coefficient k of a product."""
    return f"""
  %{name}.i = sub i64 %k, %{name}.j
  %{name}.pp = getelementptr T, ptr {p}, i64 %{name}.j
  %{name}.qp = getelementptr T, ptr {q}, i64 %{name}.i
  %{name}.p = load T, ptr %{name}.pp
  %{name}.q = load T, ptr %{name}.qp
  %{name}.pq = fmul T %{name}.p, %{name}.q"""


def _print_functions(type_: str, suffix: str) -> str:
    """Return LLVM IR of all functions of the module for numbers of a type; ``suffix`` is that of libm's functions.

    In the text T stands for the type and ZERO for its 0.
    """
    zero = f"0xK{'0' * 20}" if suffix == "l" else f"0xL{'0' * 32}"
    keep = "\n  store T %{}, ptr %Zk\n  br label %next".format
    kinds = [f"i64 {n}, label %{name}" for n, name in enumerate((*KINDS, *(f"at.{f}" for f in FUNCTIONS)))]
    functions = "".join(
        f"""
at.{f}:
  br i1 %first, label %call.{f}, label %chain
call.{f}:
  %f.{f} = call T @{f}{suffix}({"T %a" + (", T %second" if f == "atan2" else "")}){keep("f." + f)}"""
        for f in FUNCTIONS[:-1]
    )
    declared = "\n".join(f"declare T @{f}{suffix}(T{', T' if f == 'atan2' else ''})" for f in FUNCTIONS[:-1])
    join = """
  %x1p = getelementptr double, ptr %xp, i64 1
  %x2p = getelementptr double, ptr %xp, i64 2
  %x0 = load double, ptr %xp
  %x1 = load double, ptr %x1p
  %x2 = load double, ptr %x2p
  %w0 = fpext double %x0 to T
  %w1 = fpext double %x1 to T
  %w2 = fpext double %x2 to T
  %low = fadd T %w1, %w2
  %sum = fadd T %w0, %low
  store T %sum, ptr %p"""
    split = """
  %c = load T, ptr %p
  call void @part(T %c, ptr %xp)"""
    text = f"""{declared}{_print_map("join", "%x", "%C", join)}{_print_map("split", "%C", "%x", split)}
define internal void @part(T %x, ptr %out) {{
  %a = fptrunc T %x to double
  %aw = fpext double %a to T
  %x1 = fsub T %x, %aw
  %b = fptrunc T %x1 to double
  %bw = fpext double %b to T
  %x2 = fsub T %x1, %bw
  %c = fptrunc T %x2 to double
  %p1 = getelementptr double, ptr %out, i64 1
  %p2 = getelementptr double, ptr %out, i64 2
  store double %a, ptr %out
  store double %b, ptr %p1
  store double %c, ptr %p2
  ret void
}}
define void @sum(ptr %C, i64 %n, i64 %stride, ptr %parts, ptr %out) {{
entry:
  %h = alloca T
  call void @join(ptr %parts, i64 1, i64 1, ptr %h)
  %hv = load T, ptr %h
  %last = sub i64 %stride, 1
  br label %element
element:
  %e = phi i64 [ 0, %entry ], [ %e1, %s.done ]
  %at = mul i64 %e, %stride
  %row = getelementptr T, ptr %C, i64 %at{
        _print_loop(
            "s",
            "0",
            "%last",
            "element",
            "ZERO",
            '''
  %i = sub i64 %last, %s.j
  %cp = getelementptr T, ptr %row, i64 %i
  %c = load T, ptr %cp
  %up = fmul T %s.sum, %hv
  %s.new = fadd T %up, %c''',
            '''
  %o = getelementptr [3 x double], ptr %out, i64 %e
  call void @part(T %s, ptr %o)''',
        )
    }
  %e1 = add i64 %e, 1
  %more = icmp slt i64 %e1, %n
  br i1 %more, label %element, label %done
done:
  ret void
}}
define void @expand(ptr %table, i64 %n, ptr %C, i64 %stride, i64 %orders) {{
entry:
  br label %order
order:
  %k = phi i64 [ 0, %entry ], [ %k1, %ordered ]
  %k1 = add i64 %k, 1
  %kT = sitofp i64 %k to T
  %k1T = sitofp i64 %k1 to T
  %first = icmp eq i64 %k, 0
  br label %operation
operation:
  %o = phi i64 [ 0, %order ], [ %o1, %next ]
  %row = getelementptr [5 x i64], ptr %table, i64 %o
  %row1 = getelementptr i64, ptr %row, i64 1
  %row2 = getelementptr i64, ptr %row, i64 2
  %row3 = getelementptr i64, ptr %row, i64 3
  %row4 = getelementptr i64, ptr %row, i64 4
  %kind = load i64, ptr %row
  %ia = load i64, ptr %row1
  %ib = load i64, ptr %row2
  %iz = load i64, ptr %row3
  %is = load i64, ptr %row4
  %ma = mul i64 %ia, %stride
  %mb = mul i64 %ib, %stride
  %mz = mul i64 %iz, %stride
  %ms = mul i64 %is, %stride
  %A = getelementptr T, ptr %C, i64 %ma
  %B = getelementptr T, ptr %C, i64 %mb
  %Z = getelementptr T, ptr %C, i64 %mz
  %S = getelementptr T, ptr %C, i64 %ms
  %Ak = getelementptr T, ptr %A, i64 %k
  %Bk = getelementptr T, ptr %B, i64 %k
  %Zk = getelementptr T, ptr %Z, i64 %k
  %Zk1 = getelementptr T, ptr %Z, i64 %k1
  %a = load T, ptr %Ak
  %b = load T, ptr %Bk
  %b0 = load T, ptr %B
  %second = load T, ptr %S
  switch i64 %kind, label %next [ {" ".join(kinds)} ]
add:
  %sum = fadd T %a, %b{keep("sum")}
sub:
  %difference = fsub T %a, %b{keep("difference")}
neg:
  %negative = fneg T %a{keep("negative")}
scale:
  %scaled = fmul T %a, %b0{keep("scaled")}
state:
  %higher = fdiv T %a, %k1T
  store T %higher, ptr %Zk1
  br label %next
mul:{
        _print_loop(
            "m",
            "0",
            "%k",
            "mul",
            "ZERO",
            _print_product("m", "%A", "%B")
            + '''
  %m.new = fadd T %m.sum, %m.pq''',
            keep("m"),
        )
    }
div:{
        _print_loop(
            "d",
            "1",
            "%k",
            "div",
            "%a",
            _print_product("d", "%B", "%Z")
            + '''
  %d.new = fsub T %d.sum, %d.pq''',
            chr(10) + "  %quotient = fdiv T %d, %b0" + keep("quotient"),
        )
    }
at.none:
  br i1 %first, label %nothing, label %chain
nothing:
  store T ZERO, ptr %Zk
  br label %next{functions}
chain:{
        _print_loop(
            "c",
            "1",
            "%k",
            "chain",
            "ZERO",
            _print_product("c", "%A", "%B")
            + '''
  %c.jT = sitofp i64 %c.j to T
  %c.term = fmul T %c.pq, %c.jT
  %c.new = fadd T %c.sum, %c.term''',
            chr(10) + "  %chained = fdiv T %c, %kT" + keep("chained"),
        )
    }
next:
  %o1 = add i64 %o, 1
  %more = icmp slt i64 %o1, %n
  br i1 %more, label %operation, label %ordered
ordered:
  %again = icmp slt i64 %k1, %orders
  br i1 %again, label %order, label %done
done:
  ret void
}}
"""
    return re.sub(r"(?<![%\w.])T\b", type_, text.replace("ZERO", zero))
