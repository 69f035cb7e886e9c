"""Numba's part: bundles as numba sees them, ``run`` and functions printed as LLVM IR. Loaded when something compiles."""

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np import arrayobj

OPTIONS = {"error_model": "numpy", "_nrt": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def print_function(function: Callable[..., None], name: str, bundles: tuple) -> str:
    """LLVM IR of ``name`` (words...) -> void."""
    inner = function if hasattr(function, "py_func") else numba.njit(**OPTIONS)(function)
    unpack = [_unpacker(bundle_type(bundle)) for bundle in bundles]
    words = types.CPointer(types.int64)
    if len(bundles) == 1:
        (first,) = unpack

        def entry(a):  # type: ignore[no-untyped-def]
            inner(first(a))

    else:
        first, second = unpack

        def entry(a, b):  # type: ignore[no-untyped-def]
            inner(first(a), second(b))

    made = numba.cfunc(types.void(*[words] * len(bundles)), error_model="numpy", _nrt=False)(entry)
    text: str = made.inspect_llvm()
    return text.replace(f'@{made.native_name}(', f'@"{name}"(').replace(f'@"{made.native_name}"(', f'@"{name}"(')


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
    return types.NamedTuple(fields, type(bundle)) if len(set(fields)) > 1 else types.NamedUniTuple(
        fields[0], len(fields), type(bundle)
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
        return cgutils.pack_struct(builder, [_unpacked(context, builder, one, words, at) for one in of]) if not isinstance(
            of, types.UniTuple | types.NamedUniTuple
        ) else cgutils.pack_array(builder, [_unpacked(context, builder, one, words, at) for one in of])
    return load()


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
