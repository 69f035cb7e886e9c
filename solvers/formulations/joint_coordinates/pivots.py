"""The elimination of K in an order found at numbers, as lists of places (compiled once for all mechanisms).

Code of a mechanism has one order written out. Where its pivots are poor, another one is a list of whole numbers that
``factor_by_lists`` and ``solve_by_lists`` read: nothing is compiled, nor is CasADi needed.
"""

from collections.abc import Collection
from typing import Any, NamedTuple

import numpy as np

from ..compiled.algebra import clear
from ..compiled.entries import inner
from .elimination import Matrix, Order, find_order, sizes

AGAIN = 0.03  # of its size at the start: a pivot of an order found later
ROUNDING = 1e-9  # of entries of rows, whose largest are 1 where a joint holds anything


class LostRank(ValueError):
    """No order of elimination has safe pivots."""


class Pattern(NamedTuple):
    """Places of K's entries, of which the last ones are constant, and numbers of velocities and of rows."""

    pairs: Any  # (n, 2), each of K's halves once
    constants: Any
    nu: int
    held: int  # rows of opened balls, and velocities that they free
    rows: int  # that close loops

    @property
    def first(self) -> int:
        """Return the first row that closes a loop."""
        return self.nu + 2 * self.held

    @property
    def variable(self) -> int:
        """Return how many entries are not constant."""
        return len(self.pairs) - len(self.constants)

    def at_numbers(self, K: np.ndarray) -> Matrix:
        """Return K by columns, of an array of its entries."""
        out: Matrix = {k: {} for k in range(self.first + self.rows)}
        for (k, row), value in zip(self.pairs.tolist(), K.tolist(), strict=True):
            out[k][row] = out[row][k] = value
        return out


def order_rows(K: Matrix, nu: int, held: int) -> Order:
    """Return the order at numbers, with rows that close loops behind all others where that takes fewer products.

    Each of the ``held`` rows of opened balls, which follow ``nu`` velocities and as many freed ones, is behind the
    velocity it alone takes away: before, its pivot is of the parent's turns alone and vanishes in some orientations.
    Behind it no pivot does.
    """
    n, first = nu + held, nu + 2 * held
    _drop_rounding(K, n)
    behind: dict[int, Collection[int]] = {k: (k - held,) for k in range(n, first)}
    last = find_order(K, n, {**behind, **dict.fromkeys(range(first, len(K)), range(first))}, first)
    if first == len(K):
        return last
    mixed = find_order(K, n, behind)
    return last if last.products < mixed.products else mixed


def find_order_here(pattern: Pattern, here: np.ndarray, start: np.ndarray) -> Order:
    """Return the order at entries ``here``; LostRank where a pivot of a row is not safe beside its size at the start.

    The same where not as many rows hold.
    """
    n = pattern.nu + pattern.held
    at_start, now = pattern.at_numbers(start), pattern.at_numbers(here)
    kept = len(order_rows(at_start, pattern.nu, pattern.held).rows)
    order, size = order_rows(now, pattern.nu, pattern.held), sizes(at_start, n)
    largest = max(size[n:], default=0.0)
    of_rows = [(abs(pivot), size[k] or largest) for k, pivot in zip(order.rows, order.pivots, strict=True) if k >= n]
    if len(order.rows) != kept or any(pivot < AGAIN * of for pivot, of in of_rows):
        raise LostRank
    return order


def _drop_rounding(K: Matrix, nu: int) -> None:
    """Take away entries of rows that have nothing but rounding: of a joint of the tree that is declared twice."""
    size = sizes(K, nu)
    nothing = (ROUNDING / max(size[:nu], default=1.0)) * ROUNDING
    for k in range(nu, len(K)):
        if size[k] < nothing:
            for u in K[k]:
                del K[u][k]
            K[k] = {}


class Lists(NamedTuple):
    """An order, by columns of L, each with its pivot first; where K's entries go; and room."""

    K: Any
    source: Any  # (m,) entries of K
    target: Any  # (m,) and their places in ``W``
    start: Any  # (n + 1,) first place of each column
    row: Any  # (size,) of each place
    update: Any  # places from which products are taken away, in the order in which they are
    value: Any  # (n,) pivots where the order was found
    W: Any  # (size,) D and L D
    L: Any  # (size,) 1/D and L
    least: Any  # (1,) pivot over its value
    b: Any  # (nu + rows,) right-hand side
    x: Any  # (size of K,)
    u: Any  # (nu,) results
    lam: Any  # (rows,) results, with the opposite sign; 0 of rows that are left out
    first: int  # row that closes a loop
    ahead: int  # of the order, columns ahead of the first such row


def make_lists(pattern: Pattern, order: Order, K: np.ndarray) -> Lists:
    """Find the places of an order; arrays for results are to be replaced."""
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
    at = [place.get((max(a, b), min(a, b)), -1) for a, b in
          ((rank.get(k, nothing), rank.get(row, nothing)) for k, row in pattern.pairs.tolist())]  # fmt: skip
    source = np.flatnonzero(np.array(at, dtype=np.int64) >= 0)
    ahead = next((a for a, k in enumerate(order.rows) if k >= pattern.first), n)
    columns, of_places, updates = (
        np.array(x, dtype=np.int64) for x in (start, rows, [place[pair] for pair in update])
    )  # fmt: skip
    W, L = np.zeros((2, len(rows)))
    return Lists(
        K, source, np.array(at, dtype=np.int64)[source], columns, of_places, updates, np.array(order.pivots), W, L,
        np.zeros(1), np.zeros(pattern.nu + pattern.rows), np.zeros(size), np.zeros(pattern.nu), np.zeros(pattern.rows),
        pattern.first, ahead,
    )  # fmt: skip


def factor_by_lists(s: Any) -> None:
    """L of ``K``, and its least pivot."""
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
    """K x = b: velocities and rows that close loops."""
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
    """The same for rows alone, which begin ``b`` here."""
    for k in range(s.ahead, len(s.value)):
        s.x[s.row[s.start[k]]] = 0.0
    for k in range(len(s.lam)):
        s.x[s.first + k] = s.b[k]
    _substitute(s, s.ahead)


@inner
def _substitute(s: Any, ahead: int) -> None:
    """Forward and back, without the columns ``ahead``."""
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
