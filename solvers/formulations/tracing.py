"""User forces (``mechanics.user_forces``) as CasADi expressions: the law itself, run on arrays of symbols.

What it does with numbers is so differentiated exactly; a law that branches on the state (``if``, ``min``, ``max``), or
takes functions of ``math``, has no expression, and solvers on this route refuse it.
"""

from typing import Any

import casadi as ca
import numpy as np

from ...harness.code_meter import making_code
from ...harness.mechanics.system import MultibodySystem
from ...harness.mechanics.user_forces import Law
from .rows.symbols import Symbol
from .symbolic import Element, load_of, moving_body


@making_code
def user_element(law: Law, chart: Any, *, chosen: bool) -> Element:
    """z ends with t; output the load -B^T f on (i, j), or f in V if not ``chosen``."""
    i, j, t = moving_body(chart, "i"), moving_body(chart, "j"), ca.SX.sym("t")
    x = [(b.pose.r, b.pose.R, b.V[:3], b.V[3:]) for b in (i, j)]
    r, R, v, Omega = (np.array([_symbols(a) for a in of_both]) for of_both in zip(*x, strict=True))
    F, T = np.zeros((2, 2, 3), dtype=object)
    law.build_function()(Symbol(t), r[:, :, 0], R, v[:, :, 0], Omega[:, :, 0], F, T)
    f = [ca.vertcat(_column(F[e]), b.pose.R.T @ _column(T[e])) for e, b in enumerate((i, j))]
    return load_of((i, j), ca.vertcat(*f), ca.SX(0, 1), t, chosen=chosen)


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
