"""Jacobians of an ``ImplicitForm`` by forward differences, as codes use that are given no derivatives.

Columns without a common row change together (Curtis, Powell and Reid 1974), groups from the structure of dF/dy and of
dF/dy'. The increment is sqrt(eps) max(|y|, 1), the scale of the error test at rtol = atol, made exactly representable.
It has no memory: MATLAB's and SciPy's ``num_jac`` adapt a factor that grows without bound where F ignores a variable.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from .dae import ImplicitForm
from .layout import Layout
from .sparse_pattern import FixedPattern

INCREMENT = float(np.sqrt(np.finfo(float).eps))


class DifferencedForm(ImplicitForm):
    """An ``ImplicitForm`` whose Jacobian is computed by forward differences."""

    def __init__(self, layout: Layout, form: str, alpha: float, beta: float) -> None:
        super().__init__(layout, form, alpha, beta)
        self._groups_y, self._groups_y_dot = (group_columns_of_pattern(self.pattern, used) for used in self.structure)

    def jacobian(
        self, y: Float[np.ndarray, " n"], y_dot: Float[np.ndarray, " n"], t: float = 0.0
    ) -> tuple[Float[np.ndarray, " nnz"], Float[np.ndarray, " nnz"]]:
        """Return (dF/dy, dF/dy') as nonzeros of ``pattern``, with errors of about sqrt(eps) of the terms of F."""
        F = self.residual(y, y_dot, t)
        self.difference_evaluations += 1 + len(self._groups_y) + len(self._groups_y_dot)
        return (
            self._compute_differences(F, y, lambda x: self.residual(x, y_dot, t), self._groups_y),
            self._compute_differences(F, y_dot, lambda x: self.residual(y, x, t), self._groups_y_dot),
        )

    def _compute_differences(
        self, F: np.ndarray, x: np.ndarray, residual: Callable, groups: list[Int[np.ndarray, " _"]]
    ) -> np.ndarray:
        """Return the nonzeros of dF/dx by forward differences, with one evaluation of F for each group of columns.

        ``x`` is y or y'; ``residual`` is F as a function of it, and ``F`` its value at ``x``. ``groups`` are those of
        ``group_columns_of_pattern``.
        """
        rows, columns, out = self.pattern.rows, self.pattern.columns, np.zeros(self.pattern.nnz)
        h = x + INCREMENT * np.maximum(np.abs(x), 1.0) - x  # exactly representable
        for entries in groups:
            changed = x.copy()
            changed[columns[entries]] = (x + h)[columns[entries]]
            out[entries] = (residual(changed) - F)[rows[entries]] / h[columns[entries]]
        return out


def group_columns_of_pattern(pattern: FixedPattern, used: np.ndarray) -> list[Int[np.ndarray, " _"]]:
    """Return groups of columns of which no two share a row, each group as the indices of its nonzeros.

    Only the nonzeros flagged in ``used`` count. One evaluation of a difference Jacobian changes all columns of a group.
    Each column joins the first group it fits.
    """
    entries = np.flatnonzero(used)
    entries = entries[np.argsort(pattern.columns[entries], kind="stable")]
    taken, groups = list[np.ndarray](), list[list[np.ndarray]]()  # rows and entries of each group
    for own in np.split(entries, np.flatnonzero(np.diff(pattern.columns[entries])) + 1) if len(entries) else []:
        rows = pattern.rows[own]
        k = next((k for k, others in enumerate(taken) if not others[rows].any()), len(taken))
        if k == len(taken):
            taken.append(np.zeros(pattern.shape[0], dtype=bool))
            groups.append([])
        taken[k][rows] = True
        groups[k].append(own)
    return [np.concatenate(group) for group in groups]
