"""Functions of bundles of arrays, compiled by numba once, kept on disk as objects and called by address.

A bundle is a named tuple of C-contiguous arrays, of records (NumPy structured arrays without dimension, whose fields
are read and written by name), of integers and of bundles. A compiled function gets it as words, an int64 array of
addresses and lengths. The word of a ``Program`` points to a list of calls that ``run`` executes. With
``MBSBENCH_PYTHON=1`` they stay Python.
"""

import hashlib
import os
import sys
from collections import namedtuple
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from types import CodeType
from typing import Any, NamedTuple

import numpy as np

from ....harness.base import private_interfaces
from ....harness.base.code_meter import making_code
from ....harness.base.generated import Code, Program
from ....harness.base.generated.program import compile_runner
from .python_code import USER_LAW, PythonFunction, raise_again

# the layout of words, and the code around them
MAKERS = (Path(__file__), Path(__file__).parent / "numba_code.py", Path(private_interfaces.__file__))
PYTHON = "MBSBENCH_PYTHON"  # environment variable: 1 for functions that Python's interpreter runs, for a debugger
PACKAGE = __name__.rsplit(".", 2)[0]  # package whose modules enter a function's digest


def pack_words(bundle: Any) -> list[int]:
    """Return a bundle as int64 words: address and lengths of an array, address of a record, an integer itself.

    Raises ValueError for an array that is not C-contiguous.
    """
    words: list[int] = []
    for x in bundle:
        if isinstance(x, np.ndarray):
            if not x.flags.c_contiguous:
                raise ValueError("arrays of a bundle are C-contiguous: compiled code knows their addresses alone")
            words += [x.ctypes.data, *x.shape]
        elif isinstance(x, tuple):
            words += pack_words(x)
        else:
            words.append(int(x))
    return words


def describe_layout(bundle: Any) -> str:
    """Return a text of the types of a bundle's fields, a part of the key of code compiled for it."""
    parts = []
    for name, x in zip(bundle._fields, bundle, strict=True):
        if isinstance(x, np.ndarray):
            parts.append(f"{name}:{x.ndim}{x.dtype.descr if x.dtype.names else x.dtype.str}")
        else:
            parts.append(f"{name}:({describe_layout(x)})" if isinstance(x, tuple) else f"{name}:int")
    return f"{type(bundle).__name__}({' '.join(parts)})"


OPTIONS_OF: dict[Callable[..., Any], str] = {}  # options of functions defined in others


class InlineFunction:
    """A function that compiled functions call: numba's own once something compiles, plain Python until then."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        self.function, self.options = function, options
        OPTIONS_OF[function] = repr(options)

    def __call__(self, *given: Any) -> Any:
        return self.function(*given)


def compile_inline(function: Callable[..., Any]) -> Any:
    """Mark a function that numba compiles into its callers, each operation rounded; nothing is compiled yet.

    The options are fixed here because numba compiles such a function once and would otherwise adopt the options of the
    first caller: rounding would depend on the order in which functions are compiled.
    """
    return InlineFunction(function, {"forceinline": True, "fastmath": False})


def compile_inline_fused(function: Callable[..., Any]) -> Any:
    """Mark a function like ``compile_inline``, but with fused multiply-adds, for linear algebra."""
    return InlineFunction(function, {"forceinline": True, "fastmath": {"contract"}})


def compile_separately(function: Callable[..., Any]) -> Any:
    """Mark a function that numba compiles as a function of its own, because it is called from several places."""
    return InlineFunction(function, {"fastmath": False})


_CHOICES: list[Callable[[Callable[..., None]], bool]] = [lambda function: os.environ.get(PYTHON) == "1"]


def interpret_functions(choose: Callable[[Callable[..., None]], bool]) -> None:
    """Let Python's interpreter run each function for which ``choose(function)`` holds, from now on in this process.

    Nothing may have been compiled in this process: numba's functions take the place of those in the modules.
    """
    _CHOICES.append(choose)


def is_interpreted(function: Callable[..., None]) -> bool:
    """Return whether Python's interpreter runs a compiled function: all where ``MBSBENCH_PYTHON`` is 1."""
    return _CHOICES[-1](function)


def run(entry: "Program | int") -> None:
    """Run a program, given as an object or by its address ``Program.entry``; raise what its functions raised.

    In machine code numba's ``run`` takes its place.
    """
    if isinstance(entry, BoundFunction):
        entry()
    elif isinstance(entry, Program):
        entry.run()
    else:
        compile_runner().function("run", 1)(int(entry) + 8)
    raise_again()


def call_law(address: int, t: float, state: np.ndarray, load: np.ndarray) -> None:
    """Call a user's force law(t, state, load) at its address: it reads t [s] and ``state``, and sets ``load``.

    In machine code numba's ``call_law`` takes its place.
    """
    USER_LAW(int(address))(t, state.ctypes.data, load.ctypes.data)


class BoundFunction(Program):
    """A compiled function with its bundle, called from Python, or from compiled code by ``run(bound.entry)``."""

    def __init__(self, function: Callable[..., None], bundle: Any) -> None:
        """Compile or load ``function`` for those fields of the bundle that it names, or let Python interpret it."""
        name = f"{function.__module__.rsplit('.', 1)[-1]}.{function.__qualname__}"
        self._python = PythonFunction(function, bundle) if is_interpreted(function) else None
        if self._python:
            super().__init__([(self._python.address, [np.zeros(1)])], (self._python, bundle), name)
            return
        part = select_fields(bundle, digest_callees(function).names)
        code = _compile_entry(function, name, part)
        self.words = np.array(pack_words(part), dtype=np.int64)
        super().__init__([(code.address(name), [self.words])], (code, bundle), name)

    def __call__(self) -> None:
        """Run the function on its bundle; an exception in compiled code is raised again here."""
        if self._python:
            self._python()
        else:
            self.run()
            raise_again()


def select_fields(bundle: Any, names: frozenset[str]) -> Any:
    """Return a bundle, and the bundles in it, reduced to the fields among ``names``.

    Raises ValueError where an entry among ``names`` is unset.
    """
    for name, none in getattr(bundle, "_field_defaults", {}).items():
        if name in names and getattr(bundle, name) == none:
            raise ValueError(f"a function names {name!r}, which its {type(bundle).__name__} does not have")
    found = {
        name: select_fields(x, names) if isinstance(x, tuple) else x
        for name, x in zip(bundle._fields, bundle, strict=True)
        if name in names
    }
    kept = {name: x for name, x in found.items() if not isinstance(x, tuple) or len(x)}
    return _make_tuple_type(type(bundle).__name__, tuple(kept))(**kept)


@cache
def _make_tuple_type(name: str, fields: tuple[str, ...]) -> Callable[..., Any]:
    """Return the named tuple type of these fields, the same object for equal ones."""
    return namedtuple(name, fields)  # type: ignore[misc]


_CODES: dict[str, Code] = {}


def _compile_entry(function: Callable[..., None], name: str, bundle: Any) -> Code:
    """Return the code of ``function`` for bundles laid out as ``bundle``: known already, kept on disk, or made now."""
    key = f"{name}\0{digest_callees(function).digest}\0{describe_layout(bundle)}"
    if key not in _CODES:

        def print_code() -> str:
            """Compile the function and return its LLVM IR."""
            from .numba_code import print_function  # takes half a second, and is needed only where something compiles

            return print_function(function, name, bundle)

        _CODES[key] = Code(print_code, key)
    return _CODES[key]


class CodeIdentity(NamedTuple):
    """The identity of a compiled function: a digest of its code, and the names of attributes in it."""

    digest: str  # digest of its bytecode and that of all functions that it calls, of constants, and of versions
    names: frozenset[str]  # names of attributes in them


@cache
@making_code
def digest_callees(function: Callable[..., None]) -> CodeIdentity:
    """Return a digest of ``function`` and of all functions it calls, and the names of attributes in them.

    Comments and docstrings of these functions do not enter the digest.
    """
    digest = hashlib.sha256(f"{sys.version} {_numba_version()}".encode() + b"".join(f.read_bytes() for f in MAKERS))
    names: set[str] = set()
    seen: list[Callable[..., Any]] = [function]
    for one in seen:  # the list grows during the loop
        digest.update(f"{one.__module__}.{one.__qualname__} {_options(one)}".encode())
        for code in _iterate_codes(one.__code__):
            names.update(code.co_names)
            constants = [x for x in code.co_consts if not isinstance(x, CodeType) and x != one.__doc__]
            digest.update(code.co_code + repr((constants, code.co_names, code.co_varnames)).encode())
            for name in code.co_names:
                value = one.__globals__.get(name)
                called = value.function if isinstance(value, InlineFunction) else getattr(value, "py_func", None)
                if called is not None:
                    if called not in seen:
                        seen.append(called)
                elif isinstance(value, np.ndarray):
                    digest.update(value.tobytes())
                elif isinstance(value, int | float | tuple):
                    digest.update(f"{name}={value!r}".encode())
    return CodeIdentity(digest.hexdigest(), frozenset(names))


def _iterate_codes(code: CodeType) -> Iterator[CodeType]:
    """Yield a code object and all code objects nested in it."""
    yield code
    for one in code.co_consts:
        if isinstance(one, CodeType):
            yield from _iterate_codes(one)


def _options(function: Callable[..., Any]) -> str:
    """Return numba's options of a function marked in this module, as text; empty for others."""
    return OPTIONS_OF.get(function, "")


@cache
def _numba_version() -> str:
    """Return the version of the numba package, without importing it."""
    from importlib.metadata import version

    return version("numba")
