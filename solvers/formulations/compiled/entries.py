"""Functions of bundles of arrays, compiled by numba once, kept on disk as objects and called by address.

A bundle is a named tuple of C-contiguous arrays, of records (NumPy structured arrays without dimension, whose fields
are read and written by name), of whole numbers and of bundles. Its words, an int64 array, are what a compiled function
gets: addresses and lengths. A ``Program`` word leads to a list of calls that ``run`` carries out.
"""

import ast
import hashlib
import inspect
import sys
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ..generated import Code
from ..generated.program import MOST_ARGUMENTS, runner

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


class Inner:
    """A function that compiled functions call: numba's own once something compiles, plain Python until then."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        self.function, self.options = function, options

    def __call__(self, *given: Any) -> Any:
        return self.function(*given)


def inner(function: Callable[..., Any]) -> Any:
    """Mark a function that is compiled into its callers."""
    return Inner(function, {"forceinline": True})


def fused(function: Callable[..., Any]) -> Any:
    """As ``inner``, products and sums in one rounding: linear algebra."""
    return Inner(function, {"forceinline": True, "fastmath": {"contract"}})


def apart(function: Callable[..., Any]) -> Any:
    """A function that stays one where it is called from more than one place."""
    return Inner(function, {})


def run(entry: int) -> None:
    """Carry out the calls of a program, by its word; in compiled functions only."""
    raise TypeError("run is called by compiled functions")


def call_law(address: int, t: float, state: np.ndarray, load: np.ndarray) -> None:
    """law(t, state, load) of a user's force (``mechanics.user_forces``); in compiled functions only."""
    raise TypeError("call_law is called by compiled functions")


class Bound:
    """A compiled function with its bundle: to be called from Python, or from compiled code by ``run(bound.entry)``."""

    def __init__(self, function: Callable[..., None], bundle: Any, words: np.ndarray | None = None) -> None:
        """With ``words`` that the caller fills later on, where the bundle holds this very entry."""
        name = f"{function.__module__.rsplit('.', 1)[-1]}.{function.__qualname__}"
        code = _compiled(function, name, bundle)
        self.words = np.array(words_of(bundle), dtype=np.int64) if words is None else words
        self.program = Program([(code.address(name), [self.words])], keeps=(code, bundle))
        self.entry = self.program.entry

    def __call__(self) -> None:
        Program.run(self.entry)


class Program:
    """Calls of addresses with arrays, in order; ``entry`` is the word by which compiled code runs them."""

    def __init__(self, steps: Sequence[tuple[int, Sequence[np.ndarray]]], keeps: Any = None) -> None:
        self.steps = list(steps)
        if any(len(arrays) > MOST_ARGUMENTS for _, arrays in steps):
            raise ValueError(f"a call takes at most {MOST_ARGUMENTS} arrays")
        words = [runner().address("run"), len(steps)]
        for address, arrays in steps:
            words += [address, len(arrays), *(a.ctypes.data for a in arrays)]
        self._words = np.array(words, dtype=np.int64)
        self._keeps = keeps, [arrays for _, arrays in steps]
        self.entry = self._words.ctypes.data

    @staticmethod
    def run(entry: int) -> None:
        """Carry out the calls of a program, by its word."""
        _runner()(entry + 8)


@cache
def _runner() -> Callable[..., None]:
    return runner().function("run", 1)


_CODES: dict[str, Code] = {}


def _compiled(function: Callable[..., None], name: str, bundle: Any) -> Code:
    key = f"{_source_of(function)}\0{layout_of(bundle)}"
    if key not in _CODES:

        def printed() -> str:
            from .numba_code import print_function  # half a second, and only where something compiles

            return print_function(function, name, bundle)

        _CODES[key] = Code(printed, key)
    return _CODES[key]


def _source_of(function: Callable[..., None]) -> str:
    return "\0".join((function.__qualname__, sources(function.__module__)))


@cache
def sources(module: str) -> str:
    """A digest of the statements of a module and of those of this package that it imports from, and of numba's version.

    Comments and docstrings do not count.
    """
    seen: dict[str, str] = {}
    _collect(module, seen)
    return hashlib.sha256("\0".join((_numba_version(), *(seen[name] for name in sorted(seen)))).encode()).hexdigest()


@cache
def _numba_version() -> str:
    from importlib.metadata import version

    return version("numba")


def _collect(name: str, seen: dict[str, str]) -> None:
    if name in seen or not name.startswith(PACKAGE):
        return
    module = sys.modules[name]
    seen[name] = _statements(Path(inspect.getfile(module)))
    for value in list(vars(module).values()):
        of = getattr(getattr(value, "py_func", value), "__module__", "") if callable(value) else ""
        if isinstance(of, str) and of in sys.modules:
            _collect(of, seen)


@cache
def _statements(path: Path) -> str:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if (
            isinstance(body, list)
            and body
            and isinstance(body[0], ast.Expr)
            and isinstance(body[0].value, ast.Constant)
        ):
            body[0].value.value = ""
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest()
