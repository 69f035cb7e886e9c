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
        self._slices = layout.p, layout.u, layout.lam
        self._inverse_mass = InverseMass(layout)
        self._no_u_dot = np.zeros(layout.n_u)
        self._parts = (_Semi if form == "se" else _Direct)(layout, self._motion)
        self.difference_evaluations = 0  # of F, spent on Jacobians by differences

    @property
    def pattern(self) -> FixedPattern:
        """By column, of dF/dy and dF/dy' together."""
        return self._parts.pattern

    @property
    def structure(self) -> tuple[Bool[np.ndarray, " nnz"], Bool[np.ndarray, " nnz"]]:
        """Which nonzeros of ``pattern`` belong to dF/dy and which to dF/dy'."""
        return self._parts.structure

    def residual(
        self, y: Float[np.ndarray, " n"], y_dot: Float[np.ndarray, " n"], t: float = 0.0
    ) -> Float[np.ndarray, " n"]:
        """F(t, y, y'); t occurs where drives or loads are functions of it."""
        p, u, lam = self._slices
        F = self._motion.values(y, y_dot[u], t)
        if self.form == "se":
            F[lam] = self._motion.values(y, self._acceleration(y, y_dot, F[u]), t)[lam]
        np.subtract(y_dot[p], F[p], out=F[p])
        return F

    def jacobian(
        self, y: Float[np.ndarray, " n"], y_dot: Float[np.ndarray, " n"], t: float = 0.0
    ) -> tuple[Float[np.ndarray, " nnz"], Float[np.ndarray, " nnz"]]:
        """(dF/dy, dF/dy') as nonzeros of ``pattern``, in arrays that the next call changes."""
        u, parts = self._slices[1], self._parts
        parts.reset()
        self._motion.read(y, y_dot[u], t)
        parts.add_at_y_dot.run()
        if isinstance(parts, _Semi):
            w = self._acceleration(y, y_dot, self._motion.values(y, y_dot[u], t)[u])
            self._motion.read(y, w, t)
            parts.add_at_w.run()
            parts.add_product(self._inverse_mass.blocks(y))
        return parts.of_y, parts.of_y_dot

    def _acceleration(self, y: np.ndarray, y_dot: np.ndarray, e: np.ndarray) -> np.ndarray:
        """w = M^-1 (f - h + A^T lam) from e = M u' + h - f - A^T lam."""
        blocks = self._inverse_mass.blocks(y)
        return y_dot[self._slices[1]] - np.matmul(blocks, e.reshape(-1, 6, 1)).ravel()


class _Direct:
    """Jacobian of all forms but se: the elements' own derivatives, signs and places."""

    def __init__(self, layout: Layout, motion: Assembly) -> None:
        row, column = motion.row, motion.column
        self._set_pattern(layout, motion, np.flatnonzero((row >= 0) & (column >= 0)), np.zeros((0, 2), dtype=np.int64))
        self._data = self._at_rest.copy()
        self.of_y, self.of_y_dot = np.split(self._data[:-1], 2)
        self.add_at_y_dot = motion.derivatives_into(self._data, self._place, self._sign)

    def reset(self) -> None:
        """dF/dy = 0, dF/dy' = that of p'."""
        self._data[:] = self._at_rest

    def _set_pattern(self, layout: Layout, motion: Assembly, used: np.ndarray, more: np.ndarray) -> None:
        """The pattern of the ``used`` entries of ``motion``, of ``more`` (row, column) in dF/dy, and of p'."""
        row, column, of_w, every = motion.row[used], motion.column[used], motion.of_w[used], np.arange(layout.n_p)
        self.pattern = FixedPattern(
            np.concatenate((row, more[:, 0], every)),
            np.concatenate((np.where(of_w, layout.n_p + column, column), more[:, 1], every)),
            (layout.n, layout.n),
            by_column=True,
        )
        own, self._more, of_p_dot = np.split(self.pattern.place, (len(used), len(used) + len(more)))
        self._place = np.full(len(motion.row), -1)
        self._place[used] = np.where(of_w, self.pattern.nnz, 0) + own
        self._sign = np.where(motion.row < layout.n_p, -1.0, 1.0)
        self._at_rest = np.zeros(2 * self.pattern.nnz + 1)
        self._at_rest[self.pattern.nnz + of_p_dot] = 1.0
        entries = np.concatenate((self._place[used], self._more, self.pattern.nnz + of_p_dot))
        of_y, of_y_dot = np.isin(np.arange(2 * self.pattern.nnz), entries).reshape(2, -1)
        self.structure = of_y, of_y_dot


class _Semi(_Direct):
    """Jacobian of se: the constraint rows are those of c at w, with dw/dy = -M^-1 de/dy from the product."""

    def __init__(self, layout: Layout, motion: Assembly) -> None:
        row, column, of_w = motion.row, motion.column, motion.of_w
        first_c, used = layout.n_p + layout.n_u, (row >= 0) & (column >= 0)
        of_A = np.flatnonzero(used & (row >= first_c) & of_w)
        of_e = np.flatnonzero(used & (row >= layout.n_p) & (row < first_c) & ~of_w)
        A = FixedPattern(row[of_A] - first_c, column[of_A], (layout.k, layout.n_u))
        e = FixedPattern(row[of_e] - layout.n_p, column[of_e], (layout.n_u, layout.n))
        self._A_inverse_mass = FixedProduct(A, InverseMass(layout).pattern)
        self._product = FixedProduct(self._A_inverse_mass.pattern, e)
        product = np.stack((first_c + self._product.pattern.rows, self._product.pattern.columns), axis=1)
        self._set_pattern(layout, motion, np.flatnonzero(used & ((row < first_c) | ~of_w)), product)
        ends = np.cumsum((2 * self.pattern.nnz, A.nnz, e.nnz))
        self._data = np.zeros(ends[-1] + 1)
        self.of_y, self.of_y_dot = np.split(self._data[: ends[0]], 2)
        self._A, self._e = self._data[ends[0] : ends[1]], self._data[ends[1] : ends[2]]
        upper = np.where(row < first_c, self._place, -1)
        lower = np.where(row >= first_c, self._place, -1)
        lower[of_A], lower[of_e] = ends[0] + A.place, ends[1] + e.place
        self.add_at_y_dot = motion.derivatives_into(self._data, upper, self._sign)
        self.add_at_w = motion.derivatives_into(self._data, lower, self._sign)

    def reset(self) -> None:
        self._data[: len(self._at_rest) - 1] = self._at_rest[:-1]
        self._data[len(self._at_rest) - 1 :] = 0.0

    def add_product(self, blocks: np.ndarray) -> None:
        """-A M^-1 de/dy in the constraint rows of dF/dy."""
        A_inverse_mass = self._A_inverse_mass.data(self._A, blocks.ravel())
        self.of_y[self._more] -= self._product.data(A_inverse_mass, self._e)
