"""Expressions that NumPy treats as numbers, so that equations written for numbers record their operations."""

import operator
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np


class Symbol:
    """An expression of CasADi that NumPy treats as a number; without it CasADi would convert arrays to its matrices."""

    __hash__ = None  # type: ignore[assignment]

    def __init__(self, x: Any) -> None:
        self.x = x

    def __neg__(self) -> "Symbol":
        return Symbol(-self.x)

    def __bool__(self) -> bool:
        raise TypeError("it branches on the state")


def _binary(of: Callable[[Any, Any], Any], *, swapped: bool) -> Callable[[Symbol, Any], Any]:
    """Return the method of ``Symbol`` for the operation ``of`` two arguments, in reversed order if ``swapped``."""

    def combine(a: Symbol, b: Any) -> Any:
        """Return the result as a ``Symbol``; leave an array ``b`` to NumPy, which calls this for each element."""
        if isinstance(b, np.ndarray):
            return NotImplemented
        y = b.x if isinstance(b, Symbol) else b
        return Symbol(of(y, a.x) if swapped else of(a.x, y))

    return combine


def _unary(of: Callable[[Any], Any]) -> Callable[[Symbol], Symbol]:
    """Return the method of ``Symbol`` for the function ``of`` one argument."""
    return lambda a: Symbol(of(a.x))


for _name in ("add", "sub", "mul", "truediv", "pow"):
    setattr(Symbol, f"__{_name}__", _binary(getattr(operator, _name), swapped=False))
    setattr(Symbol, f"__r{_name}__", _binary(getattr(operator, _name), swapped=True))
for _name in ("lt", "le", "gt", "ge", "eq", "ne"):
    setattr(Symbol, f"__{_name}__", _binary(getattr(operator, _name), swapped=False))
for _name in ("sin", "cos", "tan", "arcsin", "arccos", "arctan", "sinh", "cosh", "tanh", "sqrt", "exp", "log", "fabs"):
    setattr(Symbol, _name, _unary(getattr(ca, _name)))  # NumPy calls these methods on objects
for _name, _of in (("__abs__", _unary(ca.fabs)), ("arctan2", _binary(ca.atan2, swapped=False))):
    setattr(Symbol, _name, _of)
