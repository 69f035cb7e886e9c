"""The interface to numba: bundles as numba's types, ``run``, functions as LLVM IR; imported when something compiles."""

import sys
from collections.abc import Callable
from functools import cache
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import infer_getattr, intrinsic, lower_getattr_generic, models, register_model

from ....harness.base.private_interfaces import WITHOUT_COUNTS, get_attribute_template, make_array_value, print_llvm
from . import entries
from .entries import PACKAGE, InlineFunction

WORD = ir.IntType(64)
OPTIONS = {"error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True, **WITHOUT_COUNTS}


def print_function(function: Callable[..., None], name: str, bundle: Any) -> str:
    """Compile ``function`` for a bundle; return optimised LLVM IR of a function ``name`` (words) -> void that runs it.

    The marked functions of its module, and of those it imports from, are replaced by numba's.
    """
    replace_marked_functions(function.__module__, set())
    inner = numba.njit(**OPTIONS, forceinline=True)(function)
    view = _make_viewer(Bundle(bundle))

    def entry(words):  # type: ignore[no-untyped-def]
        inner(view(words))

    signature = (types.CPointer(types.int64),)
    text, entered = print_llvm(numba.njit(**OPTIONS)(entry), signature)
    return f"{text}\n{_print_wrapper(name, entered)}\n"


def _print_wrapper(name: str, function: str) -> str:
    """Return IR of ``name`` (words) -> void, which calls ``function``; its exceptions are raised again in Python.

    Calls from Python hold Python's lock (``PYFUNCTYPE``) and check for an exception when they have returned.
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


class Bundle(types.Type):  # type: ignore[misc]
    """Numba's type of a bundle, the address of its words; fields are loaded where they are named."""

    def __init__(self, bundle: Any) -> None:
        """List the fields of a bundle: the index of the first word of each, and its type."""
        self.fields: dict[str, tuple[int, Any]] = {}
        self.length = 0
        for name, x in zip(bundle._fields, bundle, strict=True):
            self.fields[name] = self.length, _field_type(x)
            self.length += 1 + x.ndim if isinstance(x, np.ndarray) else getattr(self.fields[name][1], "length", 1)
        super().__init__(f"{type(bundle).__name__}({self.fields})")


def _field_type(x: Any) -> Any:
    """Return numba's type of a bundle's field: an array, a record, a bundle or an integer."""
    if isinstance(x, np.ndarray):
        of = numba.from_dtype(x.dtype)
        return of if x.dtype.names else types.Array(of, x.ndim, "C")
    return Bundle(x) if isinstance(x, tuple) else types.int64


@register_model(Bundle)
class BundleModel(models.PrimitiveModel):  # type: ignore[misc]
    """Numba's data model of a bundle: an address of words."""

    def __init__(self, manager: Any, of: Any) -> None:
        super().__init__(manager, of, WORD.as_pointer())


@infer_getattr
class BundleFields(get_attribute_template()):  # type: ignore[misc]
    """Numba's typing of a bundle's fields."""

    key = Bundle

    def generic_resolve(self, of: Any, name: str) -> Any:
        """Return the type of field ``name``, None if there is none."""
        return of.fields.get(name, (0, None))[1]


@lower_getattr_generic(Bundle)
def _load_field(context: Any, builder: Any, of: Any, words: Any, name: str) -> Any:
    """Write the IR that loads a bundle's field, as numba requests it where compiled code names the field."""
    at, kind = of.fields[name]
    words = builder.gep(words, [ir.Constant(WORD, at)])
    if isinstance(kind, Bundle):
        return words
    if not isinstance(kind, types.Array):
        value = _load_word(builder, words, 0)
        return value if kind is types.int64 else builder.inttoptr(value, context.get_value_type(kind))
    return builder.call(_make_array_loader(context, builder.module, kind), [words])


def _load_word(builder: Any, words: Any, at: int) -> Any:
    """Write the IR that loads the word at index ``at``, which never changes while a function runs."""
    value = builder.load(builder.gep(words, [ir.Constant(WORD, at)]))
    value.set_metadata("invariant.load", builder.module.add_metadata([]))
    return value


def _make_array_loader(context: Any, module: Any, kind: Any) -> Any:
    """Return the IR function that makes numba's array from the words at an address, written once per module."""
    name = f"mbsbench.load.{kind.dtype}.{kind.ndim}"
    if name in module.globals:
        return module.globals[name]
    function = ir.Function(module, ir.FunctionType(context.get_value_type(kind), [WORD.as_pointer()]), name)
    function.linkage = "linkonce_odr"
    function.attributes.add("alwaysinline")
    builder, words = ir.IRBuilder(function.append_basic_block()), function.args[0]
    data = builder.inttoptr(_load_word(builder, words, 0), context.get_data_type(kind.dtype).as_pointer())
    shape = [_load_word(builder, words, 1 + axis) for axis in range(kind.ndim)]
    strides = [ir.Constant(WORD, context.get_abi_sizeof(context.get_data_type(kind.dtype)))]
    for length in shape[:0:-1]:
        strides.append(builder.mul(strides[-1], length))
    builder.ret(make_array_value(context, builder, kind, data, shape, strides[::-1]))
    return function


def _make_viewer(of: Bundle) -> Any:
    """Return an intrinsic that treats the address of words as a bundle of type ``of``."""

    @intrinsic
    def view(typing: Any, words: Any) -> Any:
        """Return the type and the generator of the intrinsic, which returns its argument unchanged."""

        def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            """Return the address, after marking that as many words as the bundle has can be read there."""
            builder.function.args[-1].attributes.dereferenceable = 8 * max(of.length, 1)
            return given[0]

        return of(words), generate

    return view


def replace_marked_functions(name: str, seen: set[str]) -> None:
    """Replace all marked functions of a module, and of those it imports from, by numba's compiled ones.

    ``seen`` are the names of modules already done; it is extended.
    """
    if name in seen or not name.startswith(PACKAGE) or name == entries.__name__:
        return
    seen.add(name)
    space = vars(sys.modules[name])
    for key, value in list(space.items()):
        if isinstance(value, InlineFunction):
            replace_marked_functions(value.function.__module__, seen)
            space[key] = _compile_inner(value)
        elif value is entries.run:
            space[key] = run
        elif value is entries.call_law:
            space[key] = call_law
        elif callable(value):
            of = getattr(getattr(value, "py_func", value), "__module__", None)
            if isinstance(of, str) and of in sys.modules:
                replace_marked_functions(of, seen)


@cache
def _compile_inner(of: InlineFunction) -> Any:
    """Return numba's function for a marked one, with the options of its mark."""
    return numba.njit(**OPTIONS, **of.options)(of.function)


@intrinsic
def run(typing: Any, entry: Any) -> Any:
    """Run the calls of a program, given by its word, in compiled code."""

    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        """Write the IR that calls the runner at the program's first word with the address of its second."""
        program = builder.inttoptr(given[0], WORD.as_pointer())
        function = ir.FunctionType(ir.VoidType(), [WORD.as_pointer()])
        runner = builder.inttoptr(builder.load(program), function.as_pointer())
        builder.call(runner, [builder.gep(program, [ir.Constant(WORD, 1)])])
        return context.get_dummy_value()

    return types.void(types.int64), generate


@intrinsic
def call_law(typing: Any, address: Any, t: Any, state: Any, load: Any) -> Any:
    """Call a user's law(t, state, load) at the address of its C function, in compiled code."""

    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        """Write the IR that calls the C function with t and the data of both arrays."""
        double = ir.DoubleType()
        law = ir.FunctionType(ir.VoidType(), [double, double.as_pointer(), double.as_pointer()])
        arrays = zip(signature.args[2:], given[2:], strict=True)
        data = [context.make_array(kind)(context, builder, value).data for kind, value in arrays]
        builder.call(builder.inttoptr(given[0], law.as_pointer()), [given[1], *data])
        return context.get_dummy_value()

    return types.void(types.int64, types.float64, state, load), generate
