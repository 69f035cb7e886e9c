"""Functions of bundles of arrays, compiled by numba once, kept on disk as objects and called by address.

A bundle is a named tuple of C-contiguous arrays, of records (NumPy structured arrays without dimension, whose fields
are read and written by name), of whole numbers and of bundles. Its words, an int64 array, are what a compiled function
gets: addresses and lengths. A ``Program`` word leads to a list of calls that ``run`` carries out.
"""

import hashlib
import sys
from collections import namedtuple
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from types import CodeType
from typing import Any, NamedTuple

import numpy as np

from ....harness.code_meter import making_code
from ..generated import Code, Program

MAKERS = (Path(__file__), Path(__file__).parent / "numba_code.py")  # the layout of words, and the code around them
PACKAGE = __name__.rsplit(".", 2)[0]  # whose modules count for what a function is


def words_of(bundle: Any) -> list[int]:
    """A bundle as int64 words: of an array its address and lengths, of a record its address, a whole number itself."""
    words: list[int] = []
    for x in bundle:
        if isinstance(x, np.ndarray):
            if not x.flags.c_contiguous:
                raise ValueError("arrays of a bundle are C-contiguous: compiled code knows their addresses alone")
            words += [x.ctypes.data, *x.shape]
        elif isinstance(x, tuple):
            words += words_of(x)
        else:
            words.append(int(x))
    return words


def layout_of(bundle: Any) -> str:
    """Types of a bundle's fields in words: part of the key of what is compiled for it."""
    parts = []
    for name, x in zip(bundle._fields, bundle, strict=True):
        if isinstance(x, np.ndarray):
            parts.append(f"{name}:{x.ndim}{x.dtype.descr if x.dtype.names else x.dtype.str}")
        else:
            parts.append(f"{name}:({layout_of(x)})" if isinstance(x, tuple) else f"{name}:int")
    return f"{type(bundle).__name__}({' '.join(parts)})"


OPTIONS_OF: dict[Callable[..., Any], str] = {}  # of functions within others


class Inner:
    """A function that compiled functions call: numba's own once something compiles, plain Python until then."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        self.function, self.options = function, options
        OPTIONS_OF[function] = repr(options)

    def __call__(self, *given: Any) -> Any:
        return self.function(*given)


def inner(function: Callable[..., Any]) -> Any:
    """Mark a function that is compiled into its callers, each operation rounded.

    Said so, for numba compiles it once and would else take over what the first caller has: rounding would depend on
    the order in which functions are compiled.
    """
    return Inner(function, {"forceinline": True, "fastmath": False})


def inner_fused(function: Callable[..., Any]) -> Any:
    """As ``inner``, products and sums in one rounding: linear algebra."""
    return Inner(function, {"forceinline": True, "fastmath": {"contract"}})


def apart(function: Callable[..., Any]) -> Any:
    """Mark a function that stays one where it is called from more than one place."""
    return Inner(function, {"fastmath": False})


def run(entry: int) -> None:
    """Carry out the calls of a program, by its word; in compiled functions only."""
    raise TypeError("run is called by compiled functions")


def call_law(address: int, t: float, state: np.ndarray, load: np.ndarray) -> None:
    """law(t, state, load) of a user's force (``mechanics.user_forces``); in compiled functions only."""
    raise TypeError("call_law is called by compiled functions")


class Bound(Program):
    """A compiled function with its bundle: to be called from Python, or from compiled code by ``run(bound.entry)``."""

    def __init__(self, function: Callable[..., None], bundle: Any) -> None:
        """Hand over only those fields of the bundle that the function names."""
        name = f"{function.__module__.rsplit('.', 1)[-1]}.{function.__qualname__}"
        part = select_fields(bundle, reach(function).names)
        code = _compile_entry(function, name, part)
        self.words = np.array(words_of(part), dtype=np.int64)
        super().__init__([(code.address(name), [self.words])], keeps=(code, bundle))

    def __call__(self) -> None:
        self.run()


def select_fields(bundle: Any, names: frozenset[str]) -> Any:
    """The fields of a bundle, and of bundles in it, that are among ``names``; ValueError where one has its default."""
    for name, none in getattr(bundle, "_field_defaults", {}).items():
        if name in names and getattr(bundle, name) == none:
            raise ValueError(f"a function names {name!r}, which its {type(bundle).__name__} does not have")
    found = {
        name: select_fields(x, names) if isinstance(x, tuple) else x
        for name, x in zip(bundle._fields, bundle, strict=True)
        if name in names
    }
    kept = {name: x for name, x in found.items() if not isinstance(x, tuple) or len(x)}
    return _kind(type(bundle).__name__, tuple(kept))(**kept)


@cache
def _kind(name: str, fields: tuple[str, ...]) -> Callable[..., Any]:
    return namedtuple(name, fields)  # type: ignore[misc]


_CODES: dict[str, Code] = {}


def _compile_entry(function: Callable[..., None], name: str, bundle: Any) -> Code:
    key = f"{name}\0{reach(function).digest}\0{layout_of(bundle)}"
    if key not in _CODES:

        def print_code() -> str:
            from .numba_code import print_function  # half a second, and only where something compiles

            return print_function(function, name, bundle)

        _CODES[key] = Code(print_code, key)
    return _CODES[key]


class Reach(NamedTuple):
    """Parts of a compiled function."""

    digest: str  # of its bytecode and that of all functions that it calls, of constants, and of versions
    names: frozenset[str]  # of attributes in them


@cache
@making_code
def reach(function: Callable[..., None]) -> Reach:
    """Digest of ``function`` and of all that it calls, without comments and docstrings."""
    digest = hashlib.sha256(f"{sys.version} {_numba_version()}".encode() + b"".join(f.read_bytes() for f in MAKERS))
    names: set[str] = set()
    seen: list[Callable[..., Any]] = [function]
    for one in seen:  # grows meanwhile
        digest.update(f"{one.__module__}.{one.__qualname__} {_options(one)}".encode())
        for code in _codes(one.__code__):
            names.update(code.co_names)
            constants = [x for x in code.co_consts if not isinstance(x, CodeType) and x != one.__doc__]
            digest.update(code.co_code + repr((constants, code.co_names, code.co_varnames)).encode())
            for name in code.co_names:
                value = one.__globals__.get(name)
                called = value.function if isinstance(value, Inner) else getattr(value, "py_func", None)
                if called is not None:
                    if called not in seen:
                        seen.append(called)
                elif isinstance(value, np.ndarray):
                    digest.update(value.tobytes())
                elif isinstance(value, int | float | tuple):
                    digest.update(f"{name}={value!r}".encode())
    return Reach(digest.hexdigest(), frozenset(names))


def _codes(code: CodeType) -> Iterator[CodeType]:
    yield code
    for one in code.co_consts:
        if isinstance(one, CodeType):
            yield from _codes(one)


def _options(function: Callable[..., Any]) -> str:
    return OPTIONS_OF.get(function, "")


@cache
def _numba_version() -> str:
    from importlib.metadata import version

    return version("numba")
