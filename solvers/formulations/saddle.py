"""Accelerations and reactions at given p, u: [[M, -A^T], [A, 0]] (u_dot, lam) = -(e, c), by a banded Cholesky.

M is block diagonal, so S = A M^-1 A^T couples only rows that share a body. Reordered (reverse Cuthill-McKee) it is a
narrow band for chains and grids, and one LAPACK pbtrf costs O(k band^2). S is positive definite while the kept rows
are independent; the factorisation reports when they no longer are.
"""

from functools import cache

import casadi as ca
import numpy as np
from jaxtyping import Float

from ...harness.base.code_meter import making_code
from ...harness.base.generated import Code, Loop, Program, compile_functions
from ...harness.base.generated.steps import (
    Step,
    add_products,
    make_integer,
    set_to_zero,
    take,
    take_negative,
)
from ...harness.mechanics.fixed_order import inverse
from ...harness.mechanics.types import Status
from .charts import Chart
from .layout import Layout
from .linear import BandFactors, find_band
from .recording import StepFailure
from .sparse_pattern import FixedPattern, FixedProduct


class InverseMass:
    """M^-1 of all bodies as 6 x 6 blocks ``data``: constant in body velocities, B^-1 M^-1 B^-T in those of a chart.

    ``steps`` update the blocks to the coordinates in ``y``. ``pattern`` is the pattern of M^-1 without structural
    zeros, and ``places`` are the indices of its nonzeros in ``data``.
    """

    def __init__(self, layout: Layout, y: Float[np.ndarray, " n"]) -> None:
        """Compute the constant blocks, and prepare the step that converts them to a chart of variable mass."""
        s, chart = layout.system, layout.chart
        self._chart, self._p = chart, y[layout.p]
        free = np.zeros((s.nb, 6, 6))
        free[:, :3, :3] = np.eye(3) / s.mass[:, None, None]
        free[:, 3:, 3:] = inverse(s.regular_inertia)
        used, block = free != 0.0, np.arange(6 * s.nb).reshape(s.nb, 6)
        self.data, self.steps = free.ravel(), list[Step]()
        if not chart.constant_mass:
            self._code, used[:, 3:, 3:], self.data = _compile_mass_blocks(chart), True, np.zeros(free.size)
            table = np.arange(layout.n_p)
            self.steps.append((self._code.address("blocks"), [np.array([s.nb]), free, self._p, table, self.data]))
        self.places = np.flatnonzero(used)
        rows, columns = (a[used] for a in np.broadcast_arrays(block[:, :, None], block[:, None, :]))
        self.pattern = FixedPattern(rows, columns, (layout.n_u, layout.n_u))


@cache
@making_code
def _compile_mass_blocks(chart: Chart) -> Code:
    """Compile the loop over bodies that converts M^-1 in (v, Omega) to B^-1 M^-1 B^-T in the chart's velocities."""
    p, u, free = ca.SX.sym("p", chart.size), ca.SX.sym("u", 6), ca.SX.sym("free", 36)
    T_inverse = ca.inv_minor(ca.jacobian(chart.body_velocity(p, u), u)[3:, 3:])
    block = ca.reshape(free, 6, 6)
    block[3:, 3:] = T_inverse @ block[3:, 3:] @ T_inverse.T
    return compile_functions({"blocks": Loop(rows=[free], gathered=[p], stored=[ca.vec(block)])})


class Saddle:
    """A solver for u_dot and lam with A of a fixed ``pattern`` (k, n_u); it reads ``A``, ``e`` and ``c`` at each call.

    These are arrays of the caller: the nonzeros of A, the load h - f without reactions, and the constraint rows at
    u_dot = 0.
    """

    def __init__(
        self,
        layout: Layout,
        pattern: FixedPattern,
        inverse_mass: InverseMass,
        A: Float[np.ndarray, " nnz"],
        e: Float[np.ndarray, " n_u"],
        c: Float[np.ndarray, " k"],
    ) -> None:
        """Prepare the steps that factorise S = A M^-1 A^T, with M^-1 = ``inverse_mass``, and those that solve."""
        k, n_u = layout.k, layout.n_u
        W, blocks, in_blocks = inverse_mass.pattern, inverse_mass.data, inverse_mass.places
        self._u_dot, self._lam = np.zeros(n_u), np.zeros(k)
        self._info, self._pivots, self._squares = make_integer(0), np.zeros(0), np.zeros(k)
        free, back = np.zeros(n_u), np.zeros(n_u)
        factor = list(inverse_mass.steps)
        solve = [set_to_zero(free), add_products(blocks, in_blocks, e, W.columns, free, W.rows)]
        solve.append(take_negative(e, np.arange(n_u), back))
        if k:
            At_order = np.lexsort((pattern.rows, pattern.columns))  # row-wise A^T from row-wise A
            At = FixedPattern(pattern.columns[At_order], pattern.rows[At_order].astype(np.int64), (n_u, k))
            AW = FixedProduct(pattern, W)
            S = FixedProduct(AW.pattern, At)
            order, place, i, j, below, _ = find_band(S.pattern)
            height = below + 1
            lower = np.flatnonzero((i >= j)[S.pattern.place])
            in_band = (j * height + i - j)[S.pattern.place[lower]]  # by columns, from the diagonal down
            AW_data, cholesky = np.zeros(AW.pattern.nnz), BandFactors(k, below)
            band, right, self._info = cholesky.band, cholesky.right, cholesky.info
            self._pivots = band[::height]
            factor += [
                set_to_zero(AW_data),
                add_products(A, AW.p, blocks, in_blocks[AW.q], AW_data, AW.pattern.place),
                set_to_zero(band),
                add_products(AW_data, S.p[lower], A, At_order[S.q[lower]], band, in_band),
                take(band, np.arange(0, height * k, height), self._squares),
                cholesky.factor,
            ]
            every = np.arange(pattern.nnz)
            solve += [
                take_negative(c, order, right),
                add_products(A, every, free, pattern.columns, right, place[pattern.rows]),
                cholesky.solve,
                take(right, place, self._lam),
                add_products(A, every, self._lam, pattern.rows, back, pattern.columns),
            ]
        solve += [set_to_zero(self._u_dot), add_products(blocks, in_blocks, back, W.columns, self._u_dot, W.rows)]
        self._factor, self._solve = Program(factor), Program(solve)

    def compute_sines(self) -> Float[np.ndarray, " k"]:
        """Factorise A M^-1 A^T; return the sine of the angle between each row and the span of those before it.

        Rows are in the order of the band, angles in the metric of M^-1. A failure of the factorisation is not reported.
        """
        self._factor.run()
        return self._pivots / np.sqrt(self._squares)

    def solve(self) -> tuple[Float[np.ndarray, " n_u"], Float[np.ndarray, " k"]]:
        """Solve for (u_dot, lam), and return them in arrays that the next call overwrites.

        Raises ``StepFailure`` where the kept rows have become dependent.
        """
        self._factor.run()
        if self._info[0] != 0:
            raise StepFailure(
                Status.SINGULAR, "the kept constraint rows became dependent: A M^-1 A^T is not positive definite"
            )
        self._solve.run()
        return self._u_dot, self._lam
