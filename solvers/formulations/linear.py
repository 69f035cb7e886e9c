"""Factorisations of matrices of one fixed pattern, given by their nonzeros: banded, or sparse if the band is wide."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Int, Num
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import splu

from ...harness.base.generated import Program
from ...harness.base.generated.steps import Step, call_lapack, make_integer
from .sparse_pattern import FixedPattern

BAND_WORK = 2e7  # products in a factorisation of a band, beyond which SuperLU is faster


class BandOrder(NamedTuple):
    """An order of unknowns and equations with a narrow band (reverse Cuthill-McKee), and the widths of that band."""

    order: Int[np.ndarray, " n"]  # our index of each unknown in the band's order
    place: Int[np.ndarray, " n"]  # the band's index of each of our unknowns
    row: Int[np.ndarray, " nnz"]  # row of each nonzero, in their order
    column: Int[np.ndarray, " nnz"]
    below: int
    above: int

    @property
    def work(self) -> float:
        """Number of products in an LU factorisation of the band."""
        return float(len(self.order) * self.below * (self.below + self.above))


def find_band(pattern: FixedPattern) -> BandOrder:
    """Return an order of unknowns with a narrow band, by reverse Cuthill-McKee, for a square matrix of this pattern."""
    ones = sp.csr_matrix((np.ones(pattern.nnz), (pattern.rows, pattern.columns)), shape=pattern.shape)
    order = reverse_cuthill_mckee(sp.csr_matrix(ones + ones.T), symmetric_mode=True).astype(np.int64)
    place = np.argsort(order)
    row, column = place[pattern.rows], place[pattern.columns]
    return BandOrder(order, place, row, column, int(np.max(row - column)), int(np.max(column - row)))


class BandFactors:
    """Steps that factorise a banded matrix of n rows in place, and solve with it in place, by LAPACK.

    ``band`` stores the matrix by columns, ``height`` entries in each. Given both widths, the factorisation is LU with
    pivoting, of a real or complex matrix: a column has ``below`` places for fill, then its entries from the uppermost
    down; a zero pivot gives inf. Without ``above`` it is Cholesky, of a positive definite matrix: a column has its
    lower half, from the diagonal down. ``right`` is the right side, and after ``solve`` the solution. ``info`` is 0, or
    positive where LU meets a zero pivot or Cholesky one that is not positive.
    """

    def __init__(self, n: int, below: int, above: int | None = None, kind: type = float) -> None:
        """Allocate a matrix of ``n`` rows with these widths of the band; ``kind`` is float or complex."""
        self.height = below + 1 if above is None else 2 * below + above + 1
        self.band: np.ndarray = np.zeros(n * self.height, dtype=kind)
        self.right: np.ndarray = np.zeros(n, dtype=kind)
        self.info, size, lead = make_integer(0), make_integer(n), make_integer(self.height)
        widths = [make_integer(width) for width in (below, above) if width is not None]
        stored: list[np.ndarray] = [self.band, lead]  # arguments of the factor, the same for both routines
        if above is None:
            routine = "dpb"
            first = second = [np.frombuffer(b"L", dtype=np.uint8), size, *widths]
        else:
            routine = "zgb" if kind is complex else "dgb"
            first, second = [size, size, *widths], [np.frombuffer(b"N", dtype=np.uint8), size, *widths]
            stored.append(np.zeros(n, dtype=np.int32))  # rows exchanged
        self.factor = call_lapack(f"{routine}trf", *first, *stored, self.info)
        self.solve = call_lapack(f"{routine}trs", *second, make_integer(1), *stored, self.right, size, make_integer(0))


class Factors:
    """LU factors of a matrix of fixed ``pattern``, real or complex, which solve systems in place.

    ``x`` is the right side, and the solution after ``solve``, in the order of the factors: x[i] belongs to the caller's
    unknown ``order[i]``, and unknown k is x[``place[k]``]. A zero pivot gives inf, which Newton's iteration then
    rejects; for a wide band SuperLU factorises, and raises RuntimeError.
    """

    def __init__(self, pattern: FixedPattern, kind: type = float) -> None:
        """Choose between a band and, where that is too wide, SuperLU; ``kind`` is float or complex."""
        order, n = find_band(pattern), pattern.shape[0]
        self._pattern, self.steps = pattern, list[Step]()
        if order.work > BAND_WORK:
            self.x: np.ndarray = np.zeros(n, dtype=kind)
            self.order = self.place = np.arange(n)
            return
        self.order, self.place = order.order, order.place
        factors = BandFactors(n, order.below, order.above, kind)
        self._band, self.x, self.steps = factors.band, factors.right, [factors.solve]
        self._entries = (factors.height - 1) * order.column + order.row + order.below + order.above
        self._factor, self._solve = Program([factors.factor]), Program(self.steps)

    def factorise(self, data: Num[np.ndarray, " nnz"]) -> None:
        """Factorise the matrix with nonzeros ``data``, in the order of the pattern."""
        if not self.steps:
            self._superlu = splu(self._pattern.make_matrix(data))
            return
        self._band.fill(0.0)
        self._band[self._entries] = data
        self._factor.run()

    def solve(self) -> None:
        """Replace the right side in ``x`` by the solution, both in the order of the factors."""
        if self.steps:
            self._solve.run()
        else:
            self.x[:] = self._superlu.solve(self.x)


def make_solve_call(
    before: list[Step], factors: Sequence[Factors], after: list[Step], keeps: Any
) -> Callable[[], None]:
    """Return a function that runs the steps ``before``, solves with each of ``factors``, and runs the steps ``after``.

    It is one call of machine code unless SuperLU takes part. ``keeps`` owns the memory of the steps and is kept alive.
    """
    direct = all(f.steps for f in factors)
    between = [step for f in factors for step in f.steps] if direct else []
    first = Program([*before, *between, *(after if direct else [])], (keeps, factors))
    last = Program([] if direct else after, keeps)

    def run() -> None:
        """Run the steps before, solve, and run those after; in one program unless SuperLU takes part."""
        first.run()
        if not direct:
            for f in factors:
                f.solve()
            last.run()

    return run
