"""Accelerations and reactions at given p, u: [[M, -A^T], [A, 0]] (u_dot, lam) = -(e, c), by a banded Cholesky.

M is block diagonal, so S = A M^-1 A^T couples only rows that share a body; reordered (reverse Cuthill-McKee) it is a
narrow band for chains and grids, and one LAPACK pbtrf costs O(k band^2). S is positive definite while the kept rows
are independent; when they cease to be, the factorisation says so.
"""

from functools import partial

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float
from scipy.linalg import lapack
from scipy.sparse.csgraph import reverse_cuthill_mckee

from ...harness.mechanics.lent import pushed, taken_back
from ...harness.types import Status
from .layout import Layout
from .recording import StepFailure
from .sparse_pattern import FixedPattern, FixedProduct


class InverseMass:
    """M^-1 of all bodies as 6 x 6 blocks: constant in body velocities, B^-1 M^-1 B^-T in a chart's own.

    M with all inertia that is lent; ``taken_back`` is what a ``Saddle`` takes back of it.
    """

    def __init__(self, layout: Layout) -> None:
        s = layout.system
        self._chart, self._p = layout.chart, layout.p
        self._free = np.zeros((s.nb, 6, 6))
        self._free[:, :3, :3] = np.eye(3) / s.mass[:, None, None]
        self._free[:, 3:, 3:] = np.linalg.inv(s.regular_inertia)
        self._coupled = s.taken_back if np.any(s.taken_back) else None
        block = np.arange(6 * s.nb).reshape(s.nb, 6)
        rows, columns = np.broadcast_arrays(block[:, :, None], block[:, None, :])
        self.pattern = FixedPattern(rows.ravel(), columns.ravel(), (layout.n_u, layout.n_u))

    def blocks(self, y: Float[np.ndarray, " n"]) -> Float[np.ndarray, "nb 6 6"]:
        """M^-1 at the coordinates in ``y``."""
        if self._chart.constant_mass:
            return self._free
        T = self._rates(y)
        try:
            T_inverse = np.linalg.inv(T)
        except np.linalg.LinAlgError:
            message = f"the {self._chart.name} chart is singular: M(q) has no inverse"
            raise StepFailure(Status.SINGULAR, message) from None
        out = self._free.copy()
        out[:, 3:, 3:] = T_inverse @ self._free[:, 3:, 3:] @ np.swapaxes(T_inverse, 1, 2)
        return out

    def taken_back(self, y: Float[np.ndarray, " n"]) -> Float[np.ndarray, "nb 3 3"] | None:
        """P of module ``lent`` at the coordinates in ``y``; None where all that is lent may stay."""
        if self._coupled is None or self._chart.constant_mass:
            return self._coupled
        T = self._rates(y)
        return np.swapaxes(T, 1, 2) @ self._coupled @ T

    def _rates(self, y: np.ndarray) -> np.ndarray:
        return self._chart.rotation_rates(y[self._p].reshape(-1, self._chart.size))


class Saddle:
    """The solve, for A of one fixed ``pattern`` (k, n_u)."""

    def __init__(self, layout: Layout, pattern: FixedPattern, inverse_mass: InverseMass) -> None:
        self._A, self._inverse_mass, self._k = pattern, inverse_mass, layout.k
        At_order = np.lexsort((pattern.rows, pattern.columns))  # row-wise A^T from row-wise A
        At = FixedPattern(pattern.columns[At_order], pattern.rows[At_order].astype(np.int64), pattern.shape[::-1])
        self._At_order = At_order
        self.A_inverse_mass = FixedProduct(pattern, inverse_mass.pattern)
        self._S = FixedProduct(self.A_inverse_mass.pattern, At)
        if layout.k == 0:
            return
        S = self._S.pattern
        self._order = reverse_cuthill_mckee(sp.csr_matrix(S.matrix(np.ones(S.nnz))), symmetric_mode=True)
        place = np.empty(layout.k, dtype=np.int64)
        place[self._order] = np.arange(layout.k)
        i, j = place[S.rows], place[S.columns]
        self._lower = np.flatnonzero(i >= j)
        self._band_place = (i - j)[self._lower], j[self._lower]
        self._band = np.zeros((int(np.max(i - j)) + 1, layout.k), order="F")

    def solve(
        self,
        y: Float[np.ndarray, " n"],
        A: Float[np.ndarray, " nnz"],
        e: Float[np.ndarray, " n_u"],
        c: Float[np.ndarray, " k"],
    ) -> tuple[Float[np.ndarray, " n_u"], Float[np.ndarray, " k"]]:
        """(u_dot, lam) from ``e``, the load h - f without reactions, and ``c``, the constraint row at u_dot = 0."""
        blocks, P = self._inverse_mass.blocks(y), self._inverse_mass.taken_back(y)
        factor = self._factor(blocks, A) if self._k else None

        def solve(load: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
            less = e - np.ravel(load)
            free = np.matmul(blocks, less.reshape(-1, 6, 1)).ravel()  # minus the free acceleration
            if factor is None:
                return -free, np.zeros(0)
            lam = self._solve_S(factor, self._A.times(A, free) - c)
            return np.matmul(blocks, (self._A.transposed_times(A, lam) - less).reshape(-1, 6, 1)).ravel(), lam

        def by_bodies(u_dot: np.ndarray, lam: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return u_dot.reshape(-1, 6), lam

        if P is None:
            return solve(0.0)
        try:
            u_dot, lam = taken_back(lambda load: by_bodies(*solve(load)), partial(pushed, P))
        except ArithmeticError as error:
            raise StepFailure(Status.SINGULAR, str(error)) from None
        return u_dot.ravel(), lam

    def _factor(self, blocks: np.ndarray, A: np.ndarray) -> np.ndarray:
        S = self._S.data(self.A_inverse_mass.data(A, blocks.ravel()), A[self._At_order])
        self._band[self._band_place] = S[self._lower]
        factor, info = lapack.dpbtrf(self._band, lower=1)
        if info != 0:
            raise StepFailure(
                Status.SINGULAR, "the kept constraint rows became dependent: A M^-1 A^T is not positive definite"
            )
        return factor

    def _solve_S(self, factor: np.ndarray, right: np.ndarray) -> np.ndarray:
        solution, _ = lapack.dpbtrs(factor, right[self._order], lower=1)
        out = np.empty(self._k)
        out[self._order] = solution
        return out
