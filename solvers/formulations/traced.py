"""User forces (``mechanics.user_forces``) as CasADi expressions: the law itself, run on arrays of symbols.

What it does with numbers is so differentiated exactly; a law that branches on the state (``if``, ``min``, ``max``), or
takes functions of ``math``, has no expression, and solvers on this route refuse it.
"""

import operator
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from ...harness.mechanics.system import MultibodySystem
from ...harness.mechanics.user_forces import Law
from .symbolic import Element, moving


class Symbol:
    """An expression that NumPy takes for a number: CasADi's own would take arrays for its matrices."""

    __hash__ = None  # type: ignore[assignment]

    def __init__(self, x: Any) -> None:
        self.x = x

    def __neg__(self) -> "Symbol":
        return Symbol(-self.x)

    def __bool__(self) -> bool:
        raise TypeError("it branches on the state")


def _binary(of: Callable[[Any, Any], Any], *, swapped: bool) -> Callable[[Symbol, Any], Any]:
    def combined(a: Symbol, b: Any) -> Any:
        if isinstance(b, np.ndarray):
            return NotImplemented  # element by element, by NumPy
        y = b.x if isinstance(b, Symbol) else b
        return Symbol(of(y, a.x) if swapped else of(a.x, y))

    return combined


def _unary(of: Callable[[Any], Any]) -> Callable[[Symbol], Symbol]:
    return lambda a: Symbol(of(a.x))


for _name in ("add", "sub", "mul", "truediv", "pow"):
    setattr(Symbol, f"__{_name}__", _binary(getattr(operator, _name), swapped=False))
    setattr(Symbol, f"__r{_name}__", _binary(getattr(operator, _name), swapped=True))
for _name in ("lt", "le", "gt", "ge", "eq", "ne"):
    setattr(Symbol, f"__{_name}__", _binary(getattr(operator, _name), swapped=False))
for _name in ("sin", "cos", "tan", "arcsin", "arccos", "arctan", "sinh", "cosh", "tanh", "sqrt", "exp", "log", "fabs"):
    setattr(Symbol, _name, _unary(getattr(ca, _name)))  # what NumPy calls on objects
for _name, _of in (("__abs__", _unary(ca.fabs)), ("arctan2", _binary(ca.atan2, swapped=False))):
    setattr(Symbol, _name, _of)


def user_element(law: Law, chart: Any, *, chosen: bool) -> Element:
    """z ends with t; output the load -B^T f on (i, j), or f in V if not ``chosen``."""
    i, j, t = moving(chart, "i"), moving(chart, "j"), ca.SX.sym("t")
    x = [(b.pose.r, b.pose.R, b.V[:3], b.V[3:]) for b in (i, j)]
    r, R, v, Omega = (np.array([_symbols(a) for a in of_both]) for of_both in zip(*x, strict=True))
    F, T = np.zeros((2, 2, 3), dtype=object)
    law.presented()(Symbol(t), r[:, :, 0], R, v[:, :, 0], Omega[:, :, 0], F, T)
    f = [ca.vertcat(_column(F[e]), b.pose.R.T @ _column(T[e])) for e, b in enumerate((i, j))]
    load = [-b.B.T @ f_b if chosen else f_b for b, f_b in zip((i, j), f, strict=True)]
    z = ca.vertcat(i.p, i.u, j.p, j.u, t)
    return Element(z, ca.vertcat(i.u_dot, j.u_dot), ca.SX(0, 1), {"load": ca.vertcat(*load)})


def without_expression(system: MultibodySystem, chart: Any) -> str | None:
    """The refusal of a user force that is no expression."""
    for k, law in enumerate(system.user_law):
        try:
            user_element(law, chart, chosen=True)
        except Exception as error:
            return (
                f"cannot differentiate user force {k} symbolically: {error}; write it without if, min or max and "
                "with numpy's functions, or use gc_weak_form or rkmk_dop853"
            )
    return None


def _symbols(a: ca.SX) -> np.ndarray:
    return np.array([[Symbol(a[k, c]) for c in range(a.shape[1])] for k in range(a.shape[0])], dtype=object)


def _column(a: np.ndarray) -> ca.SX:
    return ca.vertcat(*[x.x if isinstance(x, Symbol) else x for x in a])
