"""User forces (``mechanics.user_forces``) as CasADi expressions: the law itself, run on arrays of symbols.

Its operations on numbers are thus differentiated exactly. A law that branches on the state (``if``, ``min``, ``max``)
or calls functions of ``math`` has no expression, and solvers that need one refuse it.
"""

from typing import Any

import casadi as ca
import numpy as np

from ...harness.base.code_meter import making_code
from ...harness.mechanics.system import MultibodySystem
from ...harness.mechanics.user_forces import ForceLaw
from .rows.symbols import Symbol
from .symbolic import Element, make_load_element, make_moving_body


@making_code
def make_user_element(law: ForceLaw, chart: Any, *, in_chart: bool) -> Element:
    """Return the element of a user's force law between bodies i and j; its inputs z end with the time.

    The output is the load -B^T f if ``in_chart``, else f in V. Raises whatever the law raises when run on symbols.
    """
    i, j, t = make_moving_body(chart, "i"), make_moving_body(chart, "j"), ca.SX.sym("t")
    x = [(b.pose.r, b.pose.R, b.V[:3], b.V[3:]) for b in (i, j)]
    r, R, v, Omega = (np.array([_wrap_entries(a) for a in of_both]) for of_both in zip(*x, strict=True))
    F, T = np.zeros((2, 2, 3), dtype=object)
    law.build_function()(Symbol(t), r[:, :, 0], R, v[:, :, 0], Omega[:, :, 0], F, T)
    f = [ca.vertcat(_stack_column(F[e]), b.pose.R.T @ _stack_column(T[e])) for e, b in enumerate((i, j))]
    return make_load_element((i, j), ca.vertcat(*f), ca.SX(0, 1), t, in_chart=in_chart)


def refuse_without_expression(system: MultibodySystem, chart: Any) -> str | None:
    """Return the refusal of a user force that cannot be run on symbols, and thus not be differentiated, or None."""
    for k, law in enumerate(system.user_law):
        try:
            make_user_element(law, chart, in_chart=True)
        except Exception as error:  # a user's law on symbols may raise anything
            return (
                f"cannot differentiate user force {k} symbolically: {error}; write it without if, min or max and "
                "with numpy's functions, or use gc_weak_form or rkmk_dop853"
            )
    return None


def _wrap_entries(a: ca.SX) -> np.ndarray:
    """Return the entries of a CasADi matrix as an array of ``Symbol`` of the same shape, which a user's law accepts."""
    return np.array([[Symbol(a[k, c]) for c in range(a.shape[1])] for k in range(a.shape[0])], dtype=object)


def _stack_column(a: np.ndarray) -> ca.SX:
    """Return an array of symbols and numbers as a CasADi column."""
    return ca.vertcat(*[x.x if isinstance(x, Symbol) else x for x in a])
