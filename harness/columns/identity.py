"""Compute the fingerprint of a problem: a number that differs between problems if any of their numbers differ."""

import hashlib
from collections.abc import Iterator
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

from ..mechanics.types import Problem
from ..mechanics.user_forces import ForceLaw

LEAST = 1e-6  # in any unit: below it a number counts by its value, above by its digits
GOLDEN = 0.6180339887498949  # its multiples, modulo 1, are all different


def compute_fingerprint(problem: Problem) -> float:
    """Return the weighted sum of asinh(x / ``LEAST``) over masses, inertias, joints, forces, gravity, start and times.

    A relative change of 1e-4 in any one number changes the sum by about 1e-4, rounding by 1e-12.
    """
    start, system = problem.initial, vars(problem.system)
    arrays = [system[k] for k in sorted(system) if isinstance(system[k], np.ndarray)]
    arrays += [start.r, start.R, start.v, start.Omega, np.array([problem.t_end, problem.dt])]
    x = np.concatenate([_flatten_numbers(a) for a in arrays])
    return float(np.sum((1.0 + np.arange(1, len(x) + 1) * GOLDEN % 1.0) * np.arcsinh(x / LEAST)))


def _flatten_numbers(a: np.ndarray) -> np.ndarray:
    """Return the entries of an array as a flat array of floats; user forces count by the numbers of their laws."""
    if a.dtype != object:
        return np.asarray(a, dtype=float).ravel()
    return np.array([x for law in a for x in _list_law_numbers(law)], dtype=float)


def _list_law_numbers(law: ForceLaw) -> Iterator[float]:
    """Yield numbers that stand for a user's force law: a digest of its code, its number of bodies, frame and units."""
    code = hashlib.sha256("\n".join(_describe_value(law.function, set())).encode()).digest()
    yield float(int.from_bytes(code[:6]))
    yield float(law.bodies)
    yield from law.frame.ravel()
    yield from law.units


def _describe_function(f: FunctionType, seen: set[int]) -> Iterator[str]:
    """Yield text that identifies a function in every process: its code, closure, defaults, and globals that it names.

    ``seen`` holds the ids of functions that were already described, so that recursion ends.
    """
    if id(f) in seen:  # it calls itself
        return
    seen.add(id(f))
    yield from _describe_code(f.__code__, f.__globals__, seen)
    for cell in f.__closure__ or ():
        yield from _describe_value(cell.cell_contents, seen)
    yield from _describe_value(f.__defaults__, seen)


def _describe_code(code: CodeType, known: dict[str, Any], seen: set[int]) -> Iterator[str]:
    """Yield the bytecode, constants and names of a code object as text, with the values of globals that it names."""
    yield code.co_code.hex()
    for constant in code.co_consts:
        is_code = isinstance(constant, CodeType)
        yield from _describe_code(constant, known, seen) if is_code else _describe_value(constant, seen)
    for name in code.co_names:  # names of globals and attributes
        yield name
        yield from _describe_value(known.get(name), seen)


def _describe_value(x: Any, seen: set[int]) -> Iterator[str]:
    """Yield text that identifies a constant, global or closure value, without addresses.

    A class or an object of a type that is not listed here is identified by its name only.
    """
    x = getattr(x, "py_func", x)  # compiled by Numba
    if isinstance(x, FunctionType):
        yield from _describe_function(x, seen)
    elif isinstance(x, tuple | list | frozenset):
        yield f"{len(x)} values"
        for one in sorted(x, key=repr) if isinstance(x, frozenset) else x:
            yield from _describe_value(one, seen)
    elif isinstance(x, np.ndarray):
        yield f"{x.shape} {x.dtype} {x.tolist()}"
    elif isinstance(x, ModuleType):
        yield x.__name__
    elif x is None or isinstance(x, bool | int | float | complex | str | bytes | np.generic):
        yield repr(x)
    else:
        yield getattr(x, "__name__", type(x).__name__)  # its repr may contain an address
