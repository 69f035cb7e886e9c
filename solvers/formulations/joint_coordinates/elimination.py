"""K = [[H, J^T], [J, 0]] = L D L^T by scalars, in an order found once from the numbers of one configuration.

Among the rows and columns with safe pivots there, the one with the fewest neighbours is eliminated first. Rows left
without a pivot depend on the others and are left out. A row after all velocities has a pivot of J H^-1 J^T, which
vanishes only where the rank changes; before a velocity that moves it, its pivot may vanish in any configuration.
"""

from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

import casadi as ca

SAFE = 1e-3  # share of its size at which a pivot is safe
DEPENDENT = 1e-9  # share of its size: between rounding, 1e-15, and ``SAFE``

Matrix = dict[int, dict[int, Any]]  # symmetric, by columns {row: entry}, both halves; zeros left out


class NoInertia(ValueError):
    """Raised where H is singular."""


class EliminationOrder(NamedTuple):
    """Rows in order of elimination, their pivots, and the number of products of L's entries that it takes."""

    rows: list[int]
    pivots: list[float]
    products: int


def find_order(
    K: Matrix,
    nu: int,
    predecessors: Mapping[int, Collection[int]] | None = None,
    sure: int = 0,
    size: Sequence[float] | None = None,
) -> EliminationOrder:
    """Return an order of elimination of the numeric matrix K that is safe and creates few nonzero entries.

    The first ``nu`` rows are those of H; ``predecessors`` lists the rows that each row must come after. The first
    ``sure`` rows have safe pivots in such an order in every configuration. Pivots are compared with ``size``, by
    default ``compute_pivot_sizes`` of K, by which a row that vanishes here counts as safe. Rows without a pivot are
    left out. Raises ``NoInertia`` where H is singular.
    """
    size = compute_pivot_sizes(K, nu) if size is None else size
    K = {k: dict(column) for k, column in K.items()}
    order, pivots, products = list[int](), list[float](), 0
    largest = max(size[nu:], default=0.0)
    left = {k for k in K if k < nu or size[k] > DEPENDENT**2 * largest}
    waits = {k: left.intersection(others) for k, others in (predecessors or {}).items()}
    while left:
        free = [k for k in left if not waits.get(k)]
        safety = {k: abs(K[k].get(k, 0.0)) / size[k] if size[k] > 0.0 else 0.0 for k in free}
        safe = [k for k in free if k < sure or safety[k] > SAFE]
        fewest = min((len(K[k]) for k in safe), default=0)
        rank = {k: _count_fill(K, k) if k < sure else -safety[k] for k in safe if len(K[k]) == fewest}
        k = min(rank, key=rank.__getitem__) if safe else max(free, key=safety.__getitem__)
        if not safety[k] > DEPENDENT:
            break
        order.append(k)
        pivots.append(K[k][k])
        products += len(K[k]) * (len(K[k]) - 1) // 2
        left.remove(k)
        for others in waits.values():
            others.discard(k)
        _eliminate(K, k)
    if any(k < nu for k in left):
        raise NoInertia
    return EliminationOrder(order, pivots, products)


def compute_pivot_sizes(K: Matrix, nu: int) -> list[float]:
    """Return the value with which each row's pivot is compared: the diagonal of H, then that of J H^-1 J^T.

    The latter neglects the off-diagonal entries of H, the first ``nu`` rows of K.
    """
    size = [K[k].get(k, 0.0) for k in range(nu)]
    return size + [sum(x * x / size[u] for u, x in K[k].items() if size[u] > 0.0) for k in range(nu, len(K))]


def _count_fill(K: Matrix, k: int) -> int:
    """Return the fill-in of row ``k``: the number of zero entries of K that its elimination makes nonzero."""
    return sum(b not in K[a] for a in K[k] for b in K[k] if k not in (a, b))


def _eliminate(K: Matrix, k: int) -> None:
    """Eliminate row and column ``k`` of K in place: subtract the product of its column with itself over its pivot."""
    column = K.pop(k)
    pivot = column.pop(k)
    for row in column:
        del K[row][k]
    for row, entry in column.items():
        ratio = entry / pivot
        for other, value in column.items():
            K[row][other] = K[row].get(other, 0.0) - ratio * value


class Factor:
    """L by columns and 1/D of K = L D L^T, as expressions."""

    def __init__(self, K: Matrix, order: Sequence[int]) -> None:
        """Eliminate the rows and columns of K symbolically in this ``order``; rows that are not in it are left out."""
        place = {k: n for n, k in enumerate(order)}
        lower = {k: {row: x for row, x in K[k].items() if place.get(row, -1) >= place[k]} for k in order}
        self.order, self.L, self.inverse, self.pivots = list(order), {}, {}, []  # type: ignore[var-annotated]
        for k in order:
            column = lower.pop(k)
            pivot = column.pop(k)
            below = sorted(column, key=place.__getitem__)
            self.pivots.append(pivot)
            self.inverse[k] = self.invert(k, pivot)
            self.L[k] = {row: column[row] * self.inverse[k] for row in below}
            for n, c in enumerate(below):
                for row in below[n:]:
                    lower[c][row] = lower[c].get(row, ca.SX(0)) - self.L[k][row] * column[c]

    def invert(self, k: int, pivot: Any) -> Any:
        """Return 1/D of row ``k`` from its ``pivot``, an expression; a subclass may set it to 0 for dependent rows."""
        return 1.0 / pivot

    def name_entries(self) -> ca.SX:
        """Replace the expressions of 1/D and L by symbols, except constants, and return these symbols as a column.

        The expressions that they replace are stored in ``entries``.
        """
        self.entries: list[ca.SX] = []
        for k in self.order:
            for column, row in [(self.inverse, k), *((self.L[k], row) for row in self.L[k])]:
                if not ca.SX(column[row]).is_constant():
                    self.entries.append(column[row])
                    column[row] = ca.SX.sym(f"L{len(self.entries)}")
        names = [x for k in self.order for x in (self.inverse[k], *self.L[k].values()) if ca.SX(x).is_symbolic()]
        return ca.densify(ca.vertcat(*names)) if names else ca.SX(0, 1)

    def solve(self, rhs: dict[int, ca.SX]) -> dict[int, ca.SX]:
        """Return the solution x of K x = ``rhs`` as expressions by row; rows left out of the elimination are missing.

        Rows that ``rhs`` does not contain are zero.
        """
        x = {k: rhs.get(k, ca.SX(0)) for k in self.order}
        for k in self.order:
            for row, entry in self.L[k].items():
                x[row] = x[row] - entry * x[k]
        for k in reversed(self.order):
            x[k] = x[k] * self.inverse[k]
            for row, entry in self.L[k].items():
                x[k] = x[k] - entry * x[row]
        return x
