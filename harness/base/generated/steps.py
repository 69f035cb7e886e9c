"""Steps of a ``Program`` on flat arrays: fills, copies and products by index tables, and calls of LAPACK."""

import ctypes
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import cython_lapack

from ..code_meter import making_code
from .code import Code, compile_functions
from .functions import Loop

Step = tuple[int, list[np.ndarray]]


def set_to_zero(target: Float[np.ndarray, " n"]) -> Step:
    """Return a step that sets ``target`` = 0."""
    return _make_step("zero", len(target), target)


def take(source: Float[np.ndarray, " m"], table: Int[np.ndarray, " n"], target: Float[np.ndarray, " n"]) -> Step:
    """Return a step that sets ``target`` = source[table]."""
    return _make_step("take", len(table), source, _indices(table), target)


def take_negative(
    source: Float[np.ndarray, " m"], table: Int[np.ndarray, " n"], target: Float[np.ndarray, " n"]
) -> Step:
    """Return a step that sets ``target`` = -source[table]."""
    return _make_step("take_negative", len(table), source, _indices(table), target)


def add_products(
    p: Float[np.ndarray, " m_p"],
    p_table: Int[np.ndarray, " n"],
    q: Float[np.ndarray, " m_q"],
    q_table: Int[np.ndarray, " n"],
    target: Float[np.ndarray, " m"],
    place: Int[np.ndarray, " n"],
) -> Step:
    """Return a step that adds p[p_table] q[q_table] to ``target``[place], term by term: indices may repeat."""
    tables = [_indices(table) for table in (p_table, q_table, place)]
    return _make_step("add_products", len(place), p, tables[0], q, tables[1], target, tables[2])


def call_lapack(name: str, *arguments: np.ndarray) -> Step:
    """Return a step that calls LAPACK's function ``name``; the caller of the program checks ``info``.

    Integers are arrays of int32, characters are arrays of bytes.
    """
    capsule = vars(cython_lapack)["__pyx_capi__"][name]
    get = ctypes.pythonapi.PyCapsule_GetPointer
    get.restype, get.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    get_name = ctypes.pythonapi.PyCapsule_GetName
    get_name.restype, get_name.argtypes = ctypes.c_char_p, [ctypes.py_object]
    return get(capsule, get_name(capsule)), list(arguments)


def make_integer(value: Any) -> Int[np.ndarray, " 1"]:
    """Return an integer as LAPACK takes it: an array of one int32."""
    return np.array([value], dtype=np.int32)


def _indices(table: np.ndarray) -> np.ndarray:
    """Return a table of indices in the form that the loops read: contiguous int64."""
    return np.ascontiguousarray(table, dtype=np.int64)


def _make_step(name: str, n: int, *arrays: np.ndarray) -> Step:
    """Return the step that calls the loop ``name`` over ``n`` elements with ``arrays``."""
    return _compile_loops().address(name), [np.array([n]), *arrays]


@cache
@making_code
def _compile_loops() -> Code:
    """Compile the loops over flat arrays that the steps call."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    return compile_functions(
        {
            "zero": Loop(stored=[ca.SX(0.0)]),
            "take": Loop(gathered=[x], stored=[x]),
            "take_negative": Loop(gathered=[x], stored=[-x]),
            "add_products": Loop(gathered=[x, y], added=[x * y]),
        }
    )
