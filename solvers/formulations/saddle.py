"""Accelerations and reactions at given p, u: [[M, -A^T], [A, 0]] (u_dot, lam) = -(e, c), by a banded Cholesky.

M is block diagonal, so S = A M^-1 A^T couples only rows that share a body; reordered (reverse Cuthill-McKee) it is a
narrow band for chains and grids, and one LAPACK pbtrf costs O(k band^2). S is positive definite while the kept rows
are independent; when they cease to be, the factorisation says so.
"""

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float
from scipy.sparse.csgraph import reverse_cuthill_mckee

from ...harness.types import Status
from .generated import Program
from .generated.steps import add_products, call_lapack, integer, set_to_zero, take, take_negative
from .layout import Layout
from .recording import StepFailure
from .sparse_pattern import FixedPattern, FixedProduct


class InverseMass:
    """M^-1 of all bodies as 6 x 6 blocks: constant in body velocities, B^-1 M^-1 B^-T in a chart's own."""

    def __init__(self, layout: Layout) -> None:
        s = layout.system
        self._chart, self._p = layout.chart, layout.p
        self._free = np.zeros((s.nb, 6, 6))
        self._free[:, :3, :3] = np.eye(3) / s.mass[:, None, None]
        self._free[:, 3:, 3:] = np.linalg.inv(s.regular_inertia)
        block = np.arange(6 * s.nb).reshape(s.nb, 6)
        rows, columns = np.broadcast_arrays(block[:, :, None], block[:, None, :])
        self.pattern = FixedPattern(rows.ravel(), columns.ravel(), (layout.n_u, layout.n_u))

    def blocks(self, y: Float[np.ndarray, " n"]) -> Float[np.ndarray, "nb 6 6"]:
        """M^-1 at the coordinates in ``y``."""
        if self._chart.constant_mass:
            return self._free
        T = self._chart.rotation_rates(y[self._p].reshape(-1, self._chart.size))
        try:
            T_inverse = np.linalg.inv(T)
        except np.linalg.LinAlgError:
            message = f"the {self._chart.name} chart is singular: M(q) has no inverse"
            raise StepFailure(Status.SINGULAR, message) from None
        out = self._free.copy()
        out[:, 3:, 3:] = T_inverse @ self._free[:, 3:, 3:] @ np.swapaxes(T_inverse, 1, 2)
        return out

    @property
    def structure(self) -> Bool[np.ndarray, "nb 6 6"]:
        """Which entries of the blocks differ from zero, at any coordinates."""
        used = self._free != 0.0
        if not self._chart.constant_mass:
            used[:, 3:, 3:] = True
        return used


class Saddle:
    """The solve, for A of one fixed ``pattern`` (k, n_u), its values ``A``, and ``e`` and ``c`` in given arrays.

    ``e`` is the load h - f without reactions, ``c`` the constraint row at u_dot = 0.
    """

    def __init__(
        self, layout: Layout, pattern: FixedPattern, inverse_mass: InverseMass,
        A: Float[np.ndarray, " nnz"], e: Float[np.ndarray, " n_u"], c: Float[np.ndarray, " k"],
    ) -> None:  # fmt: skip
        self._inverse_mass, k, n_u = inverse_mass, layout.k, layout.n_u
        self._blocks = np.zeros(36 * layout.system.nb)
        self._constant = layout.chart.constant_mass
        if self._constant:
            self._blocks[:] = inverse_mass.blocks(e).ravel()
        self._u_dot, self._lam = np.zeros(n_u), np.zeros(k)
        self._info = integer(0)
        W, in_blocks = _used_entries(inverse_mass)
        free, back = np.zeros(n_u), np.zeros(n_u)
        self._factor = None
        solve = [set_to_zero(free), add_products(self._blocks, in_blocks, e, W.columns, free, W.rows)]
        solve.append(take_negative(e, np.arange(n_u), back))
        if k:
            At_order = np.lexsort((pattern.rows, pattern.columns))  # row-wise A^T from row-wise A
            At = FixedPattern(pattern.columns[At_order], pattern.rows[At_order].astype(np.int64), (n_u, k))
            AW = FixedProduct(pattern, W)
            S = FixedProduct(AW.pattern, At)
            ones = S.pattern.matrix(np.ones(S.pattern.nnz))
            order = reverse_cuthill_mckee(sp.csr_matrix(ones), symmetric_mode=True)
            place = np.argsort(order)
            i, j = place[S.pattern.rows], place[S.pattern.columns]
            height = int(np.max(i - j)) + 1
            lower = np.flatnonzero((i >= j)[S.pattern.place])
            in_band = (j * height + i - j)[S.pattern.place[lower]]  # by columns, from the diagonal down
            AW_data, band, right = np.zeros(AW.pattern.nnz), np.zeros(height * k), np.zeros(k)
            uplo, size, one = np.frombuffer(b"L", dtype=np.uint8), integer(k), integer(1)
            width, lead = integer(height - 1), integer(height)
            self._factor = Program(
                [
                    set_to_zero(AW_data),
                    add_products(A, AW.p, self._blocks, in_blocks[AW.q], AW_data, AW.pattern.place),
                    set_to_zero(band),
                    add_products(AW_data, S.p[lower], A, At_order[S.q[lower]], band, in_band),
                    call_lapack("dpbtrf", uplo, size, width, band, lead, self._info),
                ]
            )
            every = np.arange(pattern.nnz)
            solve += [
                take_negative(c, order, right),
                add_products(A, every, free, pattern.columns, right, place[pattern.rows]),
                call_lapack("dpbtrs", uplo, size, width, one, band, lead, right, size, integer(0)),
                take(right, place, self._lam),
                add_products(A, every, self._lam, pattern.rows, back, pattern.columns),
            ]
        solve += [
            set_to_zero(self._u_dot),
            add_products(self._blocks, in_blocks, back, W.columns, self._u_dot, W.rows),
        ]
        self._solve = Program(solve)

    def solve(self, y: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, " n_u"], Float[np.ndarray, " k"]]:
        """(u_dot, lam) at the coordinates in ``y``, in arrays that the next call changes."""
        if not self._constant:
            self._blocks[:] = self._inverse_mass.blocks(y).ravel()
        if self._factor is not None:
            self._factor.run()
            if self._info[0] != 0:
                raise StepFailure(
                    Status.SINGULAR, "the kept constraint rows became dependent: A M^-1 A^T is not positive definite"
                )
        self._solve.run()
        return self._u_dot, self._lam


def _used_entries(inverse_mass: InverseMass) -> tuple[FixedPattern, np.ndarray]:
    """The pattern of M^-1 without entries that are always zero, and where each stands in the blocks."""
    in_blocks = np.flatnonzero(inverse_mass.structure)
    whole = inverse_mass.pattern
    pattern = FixedPattern(whole.rows[whole.place[in_blocks]], whole.columns[whole.place[in_blocks]], whole.shape)
    return pattern, in_blocks[np.argsort(pattern.place)]
