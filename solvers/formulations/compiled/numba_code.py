"""Numba's part: bundles as numba sees them, ``run``, functions as LLVM IR. Loaded when something compiles."""

import contextlib
import sys
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.codegen import CPUCodeLibrary, JITCodeLibrary, JITCPUCodegen
from numba.core.compiler_lock import global_compiler_lock
from numba.extending import intrinsic
from numba.np import arrayobj

from . import entries
from .entries import PACKAGE, Inner

KNOWN = "0.68."  # the version whose private methods do what ``_lowered_only`` needs
OPTIONS = {"error_model": "numpy", "_nrt": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def print_function(function: Callable[..., None], name: str, bundle: Any) -> str:
    """LLVM IR of ``name`` (words) -> void, optimised."""
    arm(function.__module__, set())
    inner = numba.njit(**OPTIONS, forceinline=True)(function)
    unpack = _unpacker(bundle_type(bundle))

    def entry(words):  # type: ignore[no-untyped-def]
        inner(unpack(words))

    signature = (types.CPointer(types.int64),)
    with _lowered_only():
        made = numba.njit(**OPTIONS)(entry)
        made.compile(signature)
    found = made.overloads[signature]
    module = found.library._final_module
    passes, builder = found.library.codegen._module_pass_manager()
    passes.run(module, builder)
    return f"{module}\n{_wrapper(name, found.fndesc.llvm_func_name)}\n"


def _wrapper(name: str, function: str) -> str:
    """IR of ``name`` (words) -> void, which calls ``function``; where that raises, Python does when it is back.

    All calls from Python hold its lock (``PYFUNCTYPE``), which looks for an exception once they have returned.
    """
    text = f"an exception was raised in compiled code ({name})"
    return f'''
@mbsbench.raised = private constant [{len(text) + 1} x i8] c"{text}\\00"
@mbsbench_error = external global ptr
declare void @PyErr_SetString(ptr, ptr)
define void @"{name}"(ptr %words) {{
  %result = alloca ptr
  %raised = alloca ptr
  %status = call i32 @{function}(ptr %result, ptr %raised, ptr %words)
  %failed = icmp sgt i32 %status, 0
  br i1 %failed, label %raise, label %done
raise:
  call void @PyErr_SetString(ptr @mbsbench_error, ptr @mbsbench.raised)
  br label %done
done:
  ret void
}}'''


@contextlib.contextmanager
def _lowered_only() -> Iterator[None]:
    """Numba links functions and neither optimises them nor makes machine code: that is done once for all of an entry.

    Numba has no option for it: five methods of the version ``KNOWN`` stand aside meanwhile. Another version makes
    machine code beside it, at two or three times the price.
    """
    if not numba.__version__.startswith(KNOWN):
        yield
        return
    aside: tuple[tuple[Any, str, Callable[..., Any]], ...] = (
        (CPUCodeLibrary, "_optimize_functions", _keep_layout),
        (CPUCodeLibrary, "_optimize_final_module", lambda library: None),
        (CPUCodeLibrary, "_finalize_final_module", _close),
        (JITCodeLibrary, "get_pointer_to_function", lambda library, name: library._ensure_finalized() or 0),
        (JITCPUCodegen, "set_env", lambda *given: None),
    )
    with global_compiler_lock:
        own = [vars(owner)[name] for owner, name, _ in aside]
        try:
            for owner, name, instead in aside:
                setattr(owner, name, instead)
            yield
        finally:
            for (owner, name, _), method in zip(aside, own, strict=True):
                setattr(owner, name, method)


def _keep_layout(library: Any, module: Any) -> None:
    module.data_layout = library.codegen._data_layout


def _close(library: Any) -> None:
    library._finalize_dynamic_globals()
    library._finalized = True


def bundle_type(bundle: Any) -> Any:
    """Numba's type of a bundle."""
    fields: list[Any] = []
    for x in bundle:
        if isinstance(x, np.ndarray):
            if x.dtype.names:
                fields.append(numba.from_dtype(x.dtype))
            else:
                fields.append(types.Array(numba.from_dtype(x.dtype), x.ndim, "C"))
        else:
            fields.append(bundle_type(x) if isinstance(x, tuple) else types.int64)
    return (
        types.NamedTuple(fields, type(bundle))
        if len(set(fields)) > 1
        else types.NamedUniTuple(fields[0], len(fields), type(bundle))
    )


def _unpacker(of: Any) -> Any:
    @intrinsic
    def unpack(typing: Any, words: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            return _unpacked(context, builder, of, given[0], [0])

        return of(words), generate

    return unpack


def _unpacked(context: Any, builder: Any, of: Any, words: Any, at: list[int]) -> Any:
    """The value of type ``of`` from the words behind ``at``, which it moves."""

    def load() -> Any:
        value = builder.load(builder.gep(words, [ir.Constant(ir.IntType(64), at[0])]))
        at[0] += 1
        return value

    if isinstance(of, types.Array):
        array = context.make_array(of)(context, builder)
        data = builder.inttoptr(load(), context.get_data_type(of.dtype).as_pointer())
        shape = [load() for _ in range(of.ndim)]
        size = context.get_abi_sizeof(context.get_data_type(of.dtype))
        strides, step = [], ir.Constant(ir.IntType(64), size)
        for length in reversed(shape):
            strides.append(step)
            step = builder.mul(step, length)
        arrayobj.populate_array(
            array, data=data, shape=shape, strides=strides[::-1], itemsize=ir.Constant(ir.IntType(64), size),
            meminfo=None,
        )  # fmt: skip
        return array._getvalue()
    if isinstance(of, types.Record):
        return builder.inttoptr(load(), context.get_value_type(of))
    if isinstance(of, types.BaseTuple):
        return (
            cgutils.pack_struct(builder, [_unpacked(context, builder, one, words, at) for one in of])
            if not isinstance(of, types.UniTuple | types.NamedUniTuple)
            else cgutils.pack_array(builder, [_unpacked(context, builder, one, words, at) for one in of])
        )
    return load()


def arm(name: str, seen: set[str]) -> None:
    """Make numba's functions of all ``Inner`` functions of a module and of those it imports from."""
    if name in seen or not name.startswith(PACKAGE) or name == entries.__name__:
        return
    seen.add(name)
    space = vars(sys.modules[name])
    for key, value in list(space.items()):
        if isinstance(value, Inner):
            arm(value.function.__module__, seen)
            space[key] = _made(value)
        elif value is entries.run:
            space[key] = run
        elif value is entries.call_law:
            space[key] = call_law
        elif callable(value):
            of = getattr(getattr(value, "py_func", value), "__module__", None)
            if isinstance(of, str) and of in sys.modules:
                arm(of, seen)


@cache
def _made(of: Inner) -> Any:
    return numba.njit(**OPTIONS, **of.options)(of.function)


@intrinsic
def run(typing: Any, entry: Any) -> Any:
    """Carry out the calls of a program, by its word."""

    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        word = ir.IntType(64)
        program = builder.inttoptr(given[0], word.as_pointer())
        function = ir.FunctionType(ir.VoidType(), [word.as_pointer()])
        runner = builder.inttoptr(builder.load(program), function.as_pointer())
        builder.call(runner, [builder.gep(program, [ir.Constant(word, 1)])])
        return context.get_dummy_value()

    return types.void(types.int64), generate


@intrinsic
def call_law(typing: Any, address: Any, t: Any, state: Any, load: Any) -> Any:
    """law(t, state, load) at the address of its C function."""

    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        double = ir.DoubleType()
        law = ir.FunctionType(ir.VoidType(), [double, double.as_pointer(), double.as_pointer()])
        arrays = zip(signature.args[2:], given[2:], strict=True)
        data = [context.make_array(kind)(context, builder, value).data for kind, value in arrays]
        builder.call(builder.inttoptr(given[0], law.as_pointer()), [given[1], *data])
        return context.get_dummy_value()

    return types.void(types.int64, types.float64, state, load), generate
