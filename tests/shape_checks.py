"""Shapes that annotations of arrays promise, checked at each call; other types are the checker's of types.

Scalars of numpy pass where there may be no axes, and any numbers for floats: derivatives are taken by complex steps.
"""

import functools
import inspect
import operator
from collections.abc import Callable
from types import FunctionType, UnionType
from typing import Any, Union, get_args, get_origin

import numpy as np
from beartype import BeartypeConf, beartype
from jaxtyping import AbstractArray, Float, Shaped

CONF = BeartypeConf(is_pep484_tower=True)


def check(function: Callable) -> Callable:
    """``function`` with the shapes of its arrays checked."""
    hints = {name: widened(hint) for name, hint in inspect.get_annotations(function).items() if is_shaped(hint)}
    if not hints or not isinstance(function, FunctionType):
        return function
    copy = FunctionType(
        function.__code__, function.__globals__, function.__name__, function.__defaults__, function.__closure__
    )
    functools.update_wrapper(copy, function, assigned=("__module__", "__qualname__", "__doc__", "__kwdefaults__"))
    copy.__annotations__ = hints
    return beartype(conf=CONF)(copy)


def is_shaped(hint: Any) -> bool:
    """Whether an array with a shape is part of ``hint``."""
    return (isinstance(hint, type) and issubclass(hint, AbstractArray)) or any(map(is_shaped, get_args(hint)))


def widened(hint: Any) -> Any:
    """``hint`` with scalars where there may be no axes, and any numbers for its floats."""
    if isinstance(hint, type) and issubclass(hint, AbstractArray):
        array = Shaped[hint.array_type, hint.dim_str] if hint.dtype is Float else hint
        return array | np.number if all(axis.startswith("*") for axis in hint.dim_str.split()) else array
    parts = tuple(map(widened, get_args(hint)))
    if get_origin(hint) in (Union, UnionType):
        return functools.reduce(operator.or_, parts)
    return tuple[parts] if get_origin(hint) is tuple else hint
