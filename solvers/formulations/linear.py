"""Factorisations of matrices of one fixed pattern, given by their nonzeros: banded, or sparse if the band is wide."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Int, Num
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import splu

from .generated import Program
from .generated.steps import Step, call_lapack, integer
from .sparse_pattern import FixedPattern

BAND_WORK = 2e7  # products in a factorisation of a band, beyond which SuperLU is faster


class BandOrder(NamedTuple):
    """The order of unknowns and equations with the narrowest band found (reverse Cuthill-McKee), and its widths."""

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
    """Return an order of unknowns that puts a square matrix of this pattern in a narrow band."""
    ones = sp.csr_matrix((np.ones(pattern.nnz), (pattern.rows, pattern.columns)), shape=pattern.shape)
    order = reverse_cuthill_mckee(sp.csr_matrix(ones + ones.T), symmetric_mode=True).astype(np.int64)
    place = np.argsort(order)
    row, column = place[pattern.rows], place[pattern.columns]
    return BandOrder(order, place, row, column, int(np.max(row - column)), int(np.max(column - row)))


class Factors:
    """LU factors of a matrix of fixed ``pattern``, real or complex, which solve systems in place.

    ``x`` is the right side and then the solution, in an order of its own: ``order`` gives our unknowns in it, ``place``
    its places in ours. A zero pivot gives inf, which Newton's iteration then rejects; SuperLU raises RuntimeError.
    """

    def __init__(self, pattern: FixedPattern, kind: type = float) -> None:
        band, n = find_band(pattern), pattern.shape[0]
        self._pattern, self.steps = pattern, list[Step]()
        self.x: np.ndarray = np.zeros(n, dtype=kind)
        self.order, self.place = band.order, band.place
        if band.work > BAND_WORK:
            self.order = self.place = np.arange(n)
            return
        height, letter = 2 * band.below + band.above + 1, "z" if kind is complex else "d"
        self._band: np.ndarray = np.zeros(n * height, dtype=kind)
        self._entries = (height - 1) * band.column + band.row + band.below + band.above
        size, below, above, lead = (integer(k) for k in (n, band.below, band.above, height))
        pivots, info = np.zeros(n, dtype=np.int32), integer(0)
        factor = call_lapack(f"{letter}gbtrf", size, size, below, above, self._band, lead, pivots, info)
        self.steps = [
            call_lapack(
                f"{letter}gbtrs",
                np.frombuffer(b"N", dtype=np.uint8),
                size,
                below,
                above,
                integer(1),
                self._band,
                lead,
                pivots,
                self.x,
                size,
                info,
            )
        ]
        self._factor, self._solve = Program([factor]), Program(self.steps)

    def factorise(self, data: Num[np.ndarray, " nnz"]) -> None:
        """Factorise the matrix whose nonzeros, in the order of the pattern, are ``data``."""
        if not self.steps:
            self._superlu = splu(self._pattern.matrix(data))
            return
        self._band.fill(0.0)
        self._band[self._entries] = data
        self._factor.run()

    def solve(self) -> None:
        """Replace the right side in ``x`` by the solution, both in the factors' own order."""
        if self.steps:
            self._solve.run()
        else:
            self.x[:] = self._superlu.solve(self.x)


def solve_between(before: list[Step], factors: Sequence[Factors], after: list[Step], keeps: Any) -> Callable[[], None]:
    """Return a function that runs the steps ``before``, solves with each of ``factors``, and runs the steps ``after``.

    It is one call of machine code unless SuperLU takes part. ``keeps``: whatever owns the memory the steps use.
    """
    direct = all(f.steps for f in factors)
    between = [step for f in factors for step in f.steps] if direct else []
    first = Program([*before, *between, *(after if direct else [])], (keeps, factors))
    last = Program([] if direct else after, keeps)

    def run() -> None:
        first.run()
        if not direct:
            for f in factors:
                f.solve()
            last.run()

    return run
