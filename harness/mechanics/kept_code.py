"""Store compiled force laws on disk: the machine code of a C callback, under a digest of all that determines it.

Numba's own cache identifies a function by its file and bytecode alone; a law may depend on numbers, arrays and
functions outside it. All of them enter the digest, and a law that refers to anything else is compiled in each process.
"""

import contextlib
import hashlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

from ..base import private_interfaces
from ..base.cache import make_cache_folder
from ..base.code_meter import making_code
from ..base.machine import find_numba_target

LIBRARIES = ("numpy", "math", "cmath", "numba", "builtins", "operator")  # identified by their names and versions


class UndigestibleValue(Exception):
    """A value that no digest can be made of."""


@making_code
def compile_callback(function: Callable[..., Any], returns: Any, *arguments: Any) -> Any:
    """Return ``function`` as numba's C callback, loaded from disk if it was compiled before.

    ``returns`` and ``arguments`` are numba's types of its result and parameters. A function that has no digest is
    compiled in each process.
    """
    path = None
    with contextlib.suppress(UndigestibleValue):
        key = digest_callback(function, arguments, returns)
        root = Path(__file__).resolve().parents[2]
        path = make_cache_folder("user_forces", root / "results" / "local") / f"{key}.pickle"
    return private_interfaces.compile_callback(function, returns, arguments, path)


def digest_callback(function: Callable[..., Any], *more: object) -> str:
    """Return a digest of all that determines a callback's machine code; raise UndigestibleValue if it has none.

    This is its bytecode, constants, closure and globals, the versions of libraries, the processor, and ``more``: here
    the types of its arguments and result.
    """
    import llvmlite
    import llvmlite.binding as llvm
    import numba

    machine = (llvm.get_process_triple(), *find_numba_target())
    versions = (sys.version, np.__version__, numba.__version__, llvmlite.__version__, *machine, *map(str, more))
    found = hashlib.sha256("\0".join(versions).encode())
    for part in _list_parts(function, []):
        found.update(part.encode() if isinstance(part, str) else part)
        found.update(b"\0")
    return found.hexdigest()[:32]


def _list_parts(value: Any, seen: list[Any]) -> Iterator[str | bytes]:
    """Yield text and bytes that identify ``value`` in a digest; raise UndigestibleValue for a type without such text.

    ``seen`` are the functions described so far: a recursive one is yielded by its number there.
    """
    if any(value is known for known in seen):
        yield f"seen {next(k for k, known in enumerate(seen) if known is value)}"
        return
    inner = getattr(value, "py_func", None)
    if isinstance(inner, FunctionType):
        yield repr(sorted(getattr(value, "targetoptions", {}).items()))
        yield from _list_parts(inner, seen)
    elif isinstance(value, FunctionType):
        seen.append(value)
        yield from _list_code_parts(value.__code__, value.__globals__, seen)
        cells = (cell.cell_contents for cell in value.__closure__ or ())
        for part in (value.__defaults__, tuple(sorted((value.__kwdefaults__ or {}).items())), tuple(cells)):
            yield from _list_parts(part, seen)
    elif value is None or isinstance(value, (bool, int, float, complex, str, bytes, np.generic)):
        yield f"{type(value).__name__} {value!r}"
    elif isinstance(value, np.ndarray) and value.dtype != object:
        yield f"{value.dtype} {value.shape} {value.flags.c_contiguous} {value.flags.writeable}"
        yield value.tobytes()
    elif isinstance(value, (tuple, list)):
        yield f"{type(value).__name__} {len(value)}"
        for part in value:
            yield from _list_parts(part, seen)
    elif isinstance(value, CodeType):
        yield from _list_code_parts(value, {}, seen)
    elif isinstance(value, ModuleType) and value.__name__.partition(".")[0] in LIBRARIES:
        yield value.__name__
    elif isinstance(value, (BuiltinFunctionType, np.ufunc, type)) and _find_package(value) in LIBRARIES:
        yield f"{getattr(value, '__module__', '')} {value.__name__}"
    else:
        raise UndigestibleValue(type(value).__name__)


def _find_package(value: Any) -> str:
    """Return the top-level package that a function or type belongs to."""
    return "numpy" if isinstance(value, np.ufunc) else str(value.__module__).partition(".")[0]


def _list_code_parts(code: CodeType, names: dict[str, Any], seen: list[Any]) -> Iterator[str | bytes]:
    """Yield bytecode, names and constants of a code object, with the values that ``names`` gives its globals."""
    yield code.co_code
    yield repr((code.co_names, code.co_varnames, code.co_freevars, code.co_argcount))
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _list_code_parts(constant, names, seen)
        elif isinstance(constant, frozenset):
            yield repr(sorted(map(repr, constant)))
        else:
            yield from _list_parts(constant, seen)
    for name in code.co_names:
        if name in names:
            yield name
            yield from _list_parts(names[name], seen)
