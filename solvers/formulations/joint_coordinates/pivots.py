"""The elimination of K in an order found from numbers, as lists of indices (compiled once for all mechanisms).

Code of a mechanism has one order written out. Where its pivots are poor, another one is a list of integers that
``factor_by_lists`` and ``solve_by_lists`` read: nothing is compiled, and CasADi is not needed.
"""

from collections.abc import Collection, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..compiled.algebra import clear
from ..compiled.entries import compile_inline
from .elimination import EliminationOrder, Matrix, NoInertia, compute_pivot_sizes, find_order

AGAIN = 0.03  # least share of its size at the start, for a pivot of an order found later
ROUNDING = 1e-9  # entries of rows below it are rounding: the largest are 1 where a joint holds anything


class LostRank(ValueError):
    """Raised where no order of elimination has safe pivots."""


class Pattern(NamedTuple):
    """Rows and columns of K's entries, of which the last ones are constant, and the numbers of velocities and rows."""

    pairs: Any  # (n, 2), each of K's halves once
    constants: Any
    nu: int
    held: int  # number of rows of opened balls, and of velocities that these free
    rows: int  # number of rows that close loops

    @property
    def first(self) -> int:
        """Index of the first row of K that closes a loop."""
        return self.nu + 2 * self.held

    @property
    def variable(self) -> int:
        """Number of K's entries that are not constant; they come first."""
        return len(self.pairs) - len(self.constants)

    def build_matrix(self, K: np.ndarray) -> Matrix:
        """Return K as a dictionary of columns, from the array ``K`` of its entries in the order of ``pairs``."""
        out: Matrix = {k: {} for k in range(self.first + self.rows)}
        for (k, row), value in zip(self.pairs.tolist(), K.tolist(), strict=True):
            out[k][row] = out[row][k] = value
        return out


def order_rows(K: Matrix, nu: int, held: int, size: Sequence[float] | None = None) -> EliminationOrder:
    """Return an order of elimination of the numeric matrix K, with all loop rows last if that takes fewer products.

    K has ``nu`` velocities, ``held`` velocities freed by opened balls, as many rows that close these, then loop rows. A
    row of an opened ball is eliminated after the freed velocity that only it constrains: before that, its pivot depends
    on the parent's rotation alone and vanishes in some orientations. Pivots are compared with ``size``, as in
    ``find_order``. Rows of K that are rounding are emptied in place. Raises ``NoInertia`` where H is singular and no
    loop row makes up for it.
    """
    n, first = nu + held, nu + 2 * held
    _drop_rounding(K, n)
    behind: dict[int, Collection[int]] = {k: (k - held,) for k in range(n, first)}
    if first == len(K):
        return find_order(K, n, behind, first, size)
    mixed = find_order(K, n, behind, size=size)
    try:
        last = find_order(K, n, {**behind, **dict.fromkeys(range(first, len(K)), range(first))}, first, size)
    except NoInertia:
        return mixed  # a loop row pulls along what has no inertia at this pose
    return last if last.products < mixed.products else mixed


def find_safe_order(pattern: Pattern, here: np.ndarray, start: np.ndarray) -> EliminationOrder:
    """Return an order of elimination for the entries ``here`` of K that is safe, compared with those at the ``start``.

    Raises ``LostRank`` where a row's pivot is below ``AGAIN`` of its size at the start, where the number of independent
    rows differs from that at the start, or where H is singular.
    """
    n = pattern.nu + pattern.held
    at_start = pattern.build_matrix(start)
    kept = len(order_rows(at_start, pattern.nu, pattern.held).rows)
    size = compute_pivot_sizes(at_start, n)
    largest = max(size[n:], default=0.0)
    of_rows = [*size[:n], *(x or largest for x in size[n:])]
    for compared in (None, of_rows):  # a row may vanish here where another one takes its place
        now = pattern.build_matrix(here)
        if compared is not None:
            compared = [*compute_pivot_sizes(now, n)[:n], *of_rows[n:]]
        try:
            order = order_rows(now, pattern.nu, pattern.held, compared)
        except NoInertia:
            continue
        safe = all(
            abs(pivot) >= AGAIN * of_rows[k] for k, pivot in zip(order.rows, order.pivots, strict=True) if k >= n
        )
        if len(order.rows) == kept and safe:
            return order
    raise LostRank


def _drop_rounding(K: Matrix, nu: int) -> None:
    """Remove in place the entries of those rows of K that are rounding, as of a tree joint that is declared twice.

    ``nu`` is the number of velocities; rows after them are constraints.
    """
    size = compute_pivot_sizes(K, nu)
    nothing = (ROUNDING / max(size[:nu], default=1.0)) * ROUNDING
    for k in range(nu, len(K)):
        if size[k] < nothing:
            for u in K[k]:
                del K[u][k]
            K[k] = {}


class EliminationLists(NamedTuple):
    """The bundle ``s`` of an elimination by lists: columns of L, each with its pivot first; indices; work arrays."""

    K: Any
    source: Any  # (m,) entries of K
    target: Any  # (m,) their places in ``W``
    start: Any  # (n + 1,) first place of each column
    row: Any  # (size,) of each place
    update: Any  # places from which products are subtracted, in order of execution
    value: Any  # (n,) pivots where the order was found
    W: Any  # (size,) D and L D
    L: Any  # (size,) 1/D and L
    least: Any  # (1,) least pivot over its value, at most 1
    b: Any  # (nu + rows,) right-hand side
    x: Any  # (size of K,)
    u: Any  # (nu,) results
    lam: Any  # (rows,) results, with the opposite sign; 0 of rows that are left out
    first: int  # row that closes a loop
    ahead: int  # columns of the order before the first such row


def make_lists(pattern: Pattern, order: EliminationOrder, K: np.ndarray) -> EliminationLists:
    """Return the index lists by which compiled functions eliminate the entries ``K`` in the given ``order``.

    Arrays of right-hand sides and results are placeholders, which each call replaces by its own.
    """
    rank = {k: n for n, k in enumerate(order.rows)}
    n, size, nothing = len(order.rows), pattern.first + pattern.rows, len(order.rows)
    left: list[set[int]] = [set() for _ in range(n)]
    for k, row in pattern.pairs.tolist():
        a, b = rank.get(k, nothing), rank.get(row, nothing)
        if a != b and nothing not in (a, b):
            left[min(a, b)].add(max(a, b))
    place: dict[tuple[int, int], int] = {}
    start, rows, update = [0], list[int](), list[tuple[int, int]]()
    for a in range(n):
        below = sorted(left[a])
        for b in (a, *below):
            place[b, a] = len(rows)
            rows.append(order.rows[b])
        start.append(len(rows))
        for j, b in enumerate(below):
            left[b].update(below[j + 1 :])
            update += [(c, b) for c in below[j:]]
    at = [
        place.get((max(a, b), min(a, b)), -1)
        for a, b in ((rank.get(k, nothing), rank.get(row, nothing)) for k, row in pattern.pairs.tolist())
    ]
    source = np.flatnonzero(np.array(at, dtype=np.int64) >= 0)
    ahead = next((a for a, k in enumerate(order.rows) if k >= pattern.first), n)
    columns = np.array(start, dtype=np.int64)
    # indices without a sign: machine code need not look whether one counts from the end
    of_places, updates, targets, sources = (
        np.array(x, dtype=np.uint32) for x in (rows, [place[pair] for pair in update], np.array(at)[source], source)
    )
    W, L = np.zeros((2, len(rows)))
    return EliminationLists(
        K,
        sources,
        targets,
        columns,
        of_places,
        updates,
        np.array(order.pivots),
        W,
        L,
        np.zeros(1),
        np.zeros(pattern.nu + pattern.rows),
        np.zeros(size),
        np.zeros(pattern.nu),
        np.zeros(pattern.rows),
        pattern.first,
        ahead,
    )


def factor_by_lists(s: Any) -> None:
    """Factorise ``K`` = L D L^T in the order of the lists ``s``, and set ``least``, the least pivot over its ``value``.

    Of each column the array ``L`` has 1/D first, in place of the diagonal of L, which is 1, then the entries below it.
    ``least`` is at most 1, for pivots that are nowhere less than where the order was found; the march compares it with
    limits below 1.
    """
    clear(s.W)
    for n in range(len(s.source)):
        s.W[s.target[n]] = s.K[s.source[n]]
    least, at = 1.0, 0
    for k in range(len(s.value)):
        first, end = s.start[k], s.start[k + 1]
        pivot = s.W[first]
        least = min(least, pivot / s.value[k])
        inverse = 1.0 / pivot
        s.L[first] = inverse
        for a in range(first + 1, end):
            s.L[a] = s.W[a] * inverse
        for a in range(first + 1, end):
            x = s.W[a]
            for b in range(a, end):
                s.W[s.update[at]] -= s.L[b] * x
                at += 1
    s.least[0] = least


def solve_by_lists(s: Any) -> None:
    """Solve K (u, -lam) = b with the factor of ``factor_by_lists``, and set ``u`` and ``lam`` of the bundle ``s``."""
    clear(s.x)
    nu = len(s.u)
    for k in range(nu):
        s.x[k] = s.b[k]
    for k in range(len(s.lam)):
        s.x[s.first + k] = s.b[nu + k]
    _substitute(s, 0)
    for k in range(nu):
        s.u[k] = s.x[k]


def solve_rows_by_lists(s: Any) -> None:
    """Solve K (u, -lam) = (0, b) for ``lam`` alone; ``b`` of the bundle ``s`` begins with the rows."""
    for k in range(s.ahead, len(s.value)):
        s.x[s.row[s.start[k]]] = 0.0
    for k in range(len(s.lam)):
        s.x[s.first + k] = s.b[k]
    _substitute(s, s.ahead)


@compile_inline
def _substitute(s: Any, ahead: int) -> None:
    """Substitute forward and back in ``x``, without the first ``ahead`` columns of the order; set ``lam``."""
    clear(s.lam)
    n = len(s.value)
    for k in range(ahead, n):
        first = s.start[k]
        x = s.x[s.row[first]]
        for a in range(first + 1, s.start[k + 1]):
            s.x[s.row[a]] -= s.L[a] * x
    for k in range(n - 1, ahead - 1, -1):
        first = s.start[k]
        row = s.row[first]
        x = s.x[row] * s.L[first]
        for a in range(first + 1, s.start[k + 1]):
            x -= s.L[a] * s.x[s.row[a]]
        s.x[row] = x
        if row >= s.first:
            s.lam[row - s.first] = -x
