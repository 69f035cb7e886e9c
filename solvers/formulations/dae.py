"""Eqs. (92)-(94) as F(t, y, y') = 0 with y = (p, u, lam), in five forms, with exact sparse Jacobians::

    p'  - G(p) u = 0
    M u' + h - f - A^T lam = 0
    fi         A u' + gamma + 2 alpha phi_dot + beta^2 phi = 0             the derivative stays in the row
    se         A w + gamma + 2 alpha phi_dot + beta^2 phi = 0,  w = M^-1 (f - h + A^T lam)   semi-explicit
    position   phi = 0                                                     index 3
    velocity   A u + alpha phi = 0                                         index 2
    both       phi = 0, A u = 0, and p' - G(p) (u + A^T eta) = 0           index 2, Gear, Gupta, Leimkuhler (1985)

"both" has y = (p, u, lam, eta), a ``Stabilised`` layout; its solution has eta = 0. All have the same solutions; what
differs is what an integrator's error test and Newton iteration see.
"""

import numpy as np
from jaxtyping import Bool, Float

from .assembly import Assembly
from .layout import Layout
from .saddle import InverseMass
from .sparse_pattern import FixedPattern, FixedProduct
from .system_elements import equations_of_motion


class ImplicitForm:
    """F and its Jacobian; ``form`` as above. Holds buffers: one instance a run."""

    def __init__(self, layout: Layout, form: str, alpha: float, beta: float) -> None:
        self.layout, self.form = layout, form
        level = "acceleration" if form in ("fi", "se") else form
        self._motion = equations_of_motion(layout, level, alpha, beta, differentiable=True)
        self._inverse_mass = InverseMass(layout)
        self._no_u_dot = np.zeros(layout.n_u)
        self._jacobian = _Semi(layout, self._motion) if form == "se" else _Direct(layout, self._motion)
        self.difference_evaluations = 0  # of F, spent on Jacobians by differences

    @property
    def pattern(self) -> FixedPattern:
        """By column, of dF/dy and dF/dy' together."""
        return self._jacobian.pattern

    @property
    def structure(self) -> tuple[Bool[np.ndarray, " nnz"], Bool[np.ndarray, " nnz"]]:
        """Which nonzeros of ``pattern`` belong to dF/dy and which to dF/dy'."""
        of = self._jacobian
        return np.diff(of.of_y.indptr) > 0, (np.diff(of.of_y_dot.indptr) > 0) | (of.p_dot != 0.0)

    def residual(
        self, y: Float[np.ndarray, " n"], y_dot: Float[np.ndarray, " n"], t: float = 0.0
    ) -> Float[np.ndarray, " n"]:
        """F(t, y, y'); t occurs where drives or loads are functions of it."""
        at = self.layout
        F = self._motion.values(y, y_dot[at.u], t)
        if self.form == "se":
            F[at.lam] = self._motion.values(y, self._acceleration(y, y_dot, F[at.u]), t)[at.lam]
        F[at.p] = y_dot[at.p] - F[at.p]
        return F

    def jacobian(
        self, y: Float[np.ndarray, " n"], y_dot: Float[np.ndarray, " n"], t: float = 0.0
    ) -> tuple[Float[np.ndarray, " nnz"], Float[np.ndarray, " nnz"]]:
        """(dF/dy, dF/dy') as nonzeros of ``pattern``."""
        at = self.layout
        if not isinstance(self._jacobian, _Semi):
            return self._jacobian.parts(self._motion.derivatives(y, y_dot[at.u], t))
        w = self._acceleration(y, y_dot, self._motion.values(y, y_dot[at.u], t)[at.u])
        blocks = self._inverse_mass.blocks(y).ravel()
        at_w = self._motion.derivatives(y, w, t).copy()
        at_y_dot = at_w if at.chart.constant_mass else self._motion.derivatives(y, y_dot[at.u], t)
        return self._jacobian.parts(at_y_dot, at_w, blocks)

    def _acceleration(self, y: np.ndarray, y_dot: np.ndarray, e: np.ndarray) -> np.ndarray:
        """w = M^-1 (f - h + A^T lam) from e = M u' + h - f - A^T lam."""
        blocks = self._inverse_mass.blocks(y)
        return y_dot[self.layout.u] - np.matmul(blocks, e.reshape(-1, 6, 1)).ravel()


class _Direct:
    """Jacobian of all forms but se: the elements' own derivatives, signs and places."""

    def __init__(self, layout: Layout, motion: Assembly) -> None:
        row, column = motion.row, motion.column
        used = (row >= 0) & (column >= 0)
        every = np.arange(layout.n_p)
        self.pattern = FixedPattern(
            np.concatenate((np.where(used, row, 0), every)),
            np.concatenate((np.where(used, np.where(motion.of_w, layout.n_p + column, column), 0), every)),
            (layout.n, layout.n),
            by_column=True,
        )
        sign = np.where(row < layout.n_p, -1.0, 1.0) * used
        nothing = np.zeros(layout.n_p)
        self.of_y = self.pattern.weighted(np.concatenate((sign * ~motion.of_w, nothing)))[:, : len(row)]
        self.of_y_dot = self.pattern.weighted(np.concatenate((sign * motion.of_w, nothing)))[:, : len(row)]
        of_p_dot = self.pattern.weighted(np.concatenate((0.0 * sign, nothing + 1.0)))
        self.p_dot = of_p_dot @ np.ones(len(sign) + layout.n_p)

    def parts(self, entries: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self.of_y @ entries, self.of_y_dot @ entries + self.p_dot


class _Semi:
    """Jacobian of se: the constraint rows are those of c at w, with dw/dy = -M^-1 de/dy from the product."""

    def __init__(self, layout: Layout, motion: Assembly) -> None:
        row, column, of_w = motion.row, motion.column, motion.of_w
        first_c, used = layout.n_p + layout.n_u, (row >= 0) & (column >= 0)
        upper, lower = used & (row < first_c), used & (row >= first_c) & ~of_w
        self._A_entries = np.flatnonzero(used & (row >= first_c) & of_w)
        self._e_entries = np.flatnonzero(used & (row >= layout.n_p) & (row < first_c) & ~of_w)
        self._A = FixedPattern(row[self._A_entries] - first_c, column[self._A_entries], (layout.k, layout.n_u))
        self._e = FixedPattern(row[self._e_entries] - layout.n_p, column[self._e_entries], (layout.n_u, layout.n))
        self._A_inverse_mass = FixedProduct(self._A, InverseMass(layout).pattern)
        self._product = FixedProduct(self._A_inverse_mass.pattern, self._e)
        product, every = self._product.pattern, np.arange(layout.n_p)
        place = np.where(of_w, layout.n_p + column, column)
        self.pattern = FixedPattern(
            np.concatenate((np.where(upper, row, 0), np.where(lower, row, 0), first_c + product.rows, every)),
            np.concatenate((np.where(upper, place, 0), np.where(lower, place, 0), product.columns, every)),
            (layout.n, layout.n),
            by_column=True,
        )
        sign = np.where(row < layout.n_p, -1.0, 1.0)
        rest, p_dot = np.ones(product.nnz), np.ones(layout.n_p)
        weights = np.concatenate((sign * upper * ~of_w, 1.0 * lower, -rest, 0.0 * p_dot))
        self.of_y = self.pattern.weighted(weights)[:, : len(weights) - layout.n_p]
        of_y_dot = np.concatenate((sign * upper * of_w, 0.0 * lower, 0.0 * rest, 0.0 * p_dot))
        self.of_y_dot = self.pattern.weighted(of_y_dot)[:, : len(row)]
        of_p_dot = self.pattern.weighted(np.concatenate((np.zeros(len(weights) - layout.n_p), p_dot)))
        self.p_dot = of_p_dot @ np.ones(len(weights))

    def parts(self, at_y_dot: np.ndarray, at_w: np.ndarray, blocks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        A_inverse_mass = self._A_inverse_mass.data(self._A.data(at_w[self._A_entries]), blocks)
        product = self._product.data(A_inverse_mass, self._e.data(at_w[self._e_entries]))
        entries = np.concatenate((at_y_dot, at_w, product))
        return self.of_y @ entries, self.of_y_dot @ at_y_dot + self.p_dot
