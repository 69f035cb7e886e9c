"""Convert code for one number at a time to code for ``LANES`` numbers at a time, in arrays (..., LANES)."""

import re

import numpy as np
from jaxtyping import Float

LANES = 8  # doubles of AVX-512; other processors handle them in parts


def pack_lanes(a: Float[np.ndarray, "n m k"]) -> Float[np.ndarray, "n groups k lanes"]:
    """Arrange the m rows in groups of ``LANES``; the last group is padded with zeros."""
    n, m, k = a.shape
    out = np.zeros((n, -(-m // LANES), LANES, k))
    out.reshape(n, -1, k)[:, :m] = a
    return np.ascontiguousarray(np.swapaxes(out, 2, 3))


def unpack_lanes(a: Float[np.ndarray, "n groups k lanes"], m: int) -> Float[np.ndarray, "n m k"]:
    """Return the m rows from groups of ``LANES``: the inverse of ``pack_lanes``."""
    return np.swapaxes(a, 2, 3).reshape(len(a), -1, a.shape[2])[:, :m]


def vectorise_functions(ir: str) -> str:
    """Return the LLVM IR ``ir`` of functions of numbers with ``LANES`` numbers in place of each number.

    External functions, such as those of libm, are called once for each of these.
    """
    lines = []
    for line in ir.splitlines():
        if "icmp" in line or "br i1" in line:  # concerns the count of elements
            lines.append(line)
            continue
        if own := re.match(r"declare double @(?!llvm)(\w+)\((.*)\)", line):
            lines += [line, *_print_lane_calls(own[1], own[2].count("double"))]
            continue
        line = re.sub(r"@llvm\.(\w+)\.f64", rf"@llvm.\1.v{LANES}f64", line)
        line = re.sub(r"double @(?!llvm)(\w+)\(", r"double @each.\1(", line)
        line = re.sub(r"\b(double|i1)\b", rf"<{LANES} x \1>", line)
        line = re.sub(r" (-?\d\.\d|0x\w{16})(?=,|\)|$)", lambda m: f" {_repeat_constant(f'double {m[1]}')}", line)
        line = re.sub(r"\btrue\b", _repeat_constant("i1 true"), line)
        lines.append(f"{line}, align 8" if re.search(r" = load <|^  store ", line) else line)
    return "\n".join([*lines, ""])


def _repeat_constant(x: str) -> str:
    """Return a constant of LLVM IR repeated in all lanes."""
    return f"<{', '.join([x] * LANES)}>"


def _print_lane_calls(name: str, arguments: int) -> list[str]:
    """Return LLVM IR of a function of lanes that calls the function ``name`` of numbers for each lane."""
    V, letters = f"<{LANES} x double>", "ab"[:arguments]
    lines = [f"define internal {V} @each.{name}({', '.join(f'{V} %{a}' for a in letters)}) {{"]
    for k in range(LANES):
        lines += [f"  %{a}{k} = extractelement {V} %{a}, i32 {k}" for a in letters]
        lines.append(f"  %c{k} = call double @{name}({', '.join(f'double %{a}{k}' for a in letters)})")
        lines.append(f"  %v{k} = insertelement {V} {f'%v{k - 1}' if k else 'undef'}, double %c{k}, i32 {k}")
    return [*lines, f"  ret {V} %v{LANES - 1}", "}"]
