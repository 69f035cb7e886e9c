"""A mechanism by recursion for ``joint_coordinates.marching`` and ``symplectic``: its choice of rows, its programs."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ....harness.base.generated import Program
from ....harness.mechanics.joint_tree import Tree
from ....harness.mechanics.system import MultibodySystem
from ..compiled.entries import BoundFunction
from ..joint_coordinates.elimination import DEPENDENT, EliminationOrder
from ..joint_coordinates.pivots import AGAIN, ROUNDING, LostRank
from ..joint_coordinates.stages import list_tolerance_blocks
from .accelerations import AcceleratedTree, CoupledTree, ProjectedTree, accelerate_tree, couple_tree, project_tree
from .limbs import ClosedTree, make_mechanism, select_rows
from .recording import ErrorParts, make_record, measure_error, record_tree

MOST_ROWS = 600  # rows that close loops: their factor is dense, and each needs a sweep over all bodies
DEPENDENT_RATES = "leaves out rows that depend on others, and not every row has a phi to watch: use rkmk_dop853"
NO_INERTIA = "needs inertia for each velocity of a joint; a point mass on a ball has none: use rkmk_dop853"

Calls = list[tuple[int, list[np.ndarray]]]


def refuse_rows(rows: int) -> str:
    """Return the refusal of a mechanism with ``rows`` closing rows, more than ``MOST_ROWS``."""
    return f"eliminates the rows of closed loops densely, up to {MOST_ROWS} of them (got {rows}): use rkmk_dop853"


class Coupling(NamedTuple):
    """S of all closing rows at a state, and the diagonal that S would have if the bodies were free."""

    S: Float[np.ndarray, "nr nr"]
    free: Float[np.ndarray, " nr"]


class TreeMechanism:
    """A mechanism by recursion over its bodies, in place of a ``JointCode``.

    Raises ValueError for more than ``MOST_ROWS`` closing rows, for a velocity without inertia, and for dependent rows
    of a mechanism that is not holonomic.
    """

    is_small = False
    operations = 0  # none are made

    def __init__(self, system: MultibodySystem, tree: Tree) -> None:
        """Build the arrays of the tree, and choose the independent closing rows at the start."""
        self.system, self.tree, self.mechanism = system, tree, make_mechanism(system, tree)
        self.rows = len(self.mechanism.closing.phi)
        if self.rows > MOST_ROWS:
            raise ValueError(refuse_rows(self.rows))
        self.at_start = self.couple_at(0.0, tree.start)
        if not np.all(np.isfinite(self.mechanism.limbs.D)) or not _has_inertia(self.mechanism):
            raise ValueError(NO_INERTIA)
        self.order = choose_rows(self.at_start)
        if self.rows_in_use < self.rows and not system.is_holonomic:
            raise ValueError(DEPENDENT_RATES)

    @property
    def rows_in_use(self) -> int:
        """Number of closing rows in use, those that do not depend on others."""
        return len(self.order.rows)

    @property
    def words(self) -> str:
        """Note for the trajectory, which says that a recursion evaluates the mechanism."""
        return f"recursion over {self.system.nb} {'body' if self.system.nb == 1 else 'bodies'}"

    def make_evaluation(self, chosen: EliminationOrder | None = None) -> "TreeEvaluation":
        """Allocate and return the arrays and programs that evaluate the mechanism; nothing is computed yet.

        Rows are eliminated in the order ``chosen``, by default that of the start.
        """
        return TreeEvaluation(self, chosen)

    def couple_at(self, t: float, y: np.ndarray) -> Coupling:
        """Return S = J H^-1 J^T of all closing rows, in the cut joints' order, at ``t`` [s] and ``y`` = (q, u).

        The second result, a scale, is the diagonal that S has for free bodies. The arrays of the mechanism are left at
        this state.
        """
        of = self.mechanism
        closing = select_rows(of.closing, range(self.rows), np.ones(self.rows))
        q, u = np.split(np.array(y), [self.tree.nq])
        BoundFunction(couple_tree, CoupledTree(of.limbs, closing, np.array([t]), q, u))()
        cut, place, (i, j) = of.cut, of.closing.place, of.cut.body.T[:, of.closing.joint]
        mass = [np.where(e < 0, 0.0, 1.0 / of.whole.mass[e]) for e in (i, j)]
        turn = np.einsum("eak,eak->ea", cut.X, cut.Y) * (np.stack((i, j)) >= 0)
        free = np.einsum("ak,ak->a", cut.way, cut.way) * sum(mass) + np.sum(turn, axis=0)
        return Coupling(np.tril(closing.S) + np.tril(closing.S, -1).T, free[place])


def choose_rows(at: Coupling, size: np.ndarray | None = None) -> EliminationOrder:
    """Return an order of independent closing rows with their pivots, by elimination of the largest relative pivot.

    ``at`` has S at a state. Pivots are relative to ``size``, by default the diagonal of this S; with the diagonal of
    another state, rows that vanish at this one are small. Dependent rows are left out.
    """
    S = at.S.copy()
    size = np.diag(S).copy() if size is None else size
    left = size > max(DEPENDENT**2 * float(np.max(size, initial=0.0)), 0.0)
    left &= size > ROUNDING**2 * at.free
    rows, pivots = list[int](), list[float]()
    while np.any(left):
        relative = np.where(left, np.diag(S) / np.where(left, size, 1.0), -np.inf)
        k = int(np.argmax(relative))
        if not relative[k] > DEPENDENT:
            break
        rows.append(k)
        pivots.append(float(S[k, k]))
        left[k] = False
        S -= np.outer(S[:, k], S[k]) / S[k, k]
    return EliminationOrder(rows, pivots, 0)


class TreeEvaluation:
    """Programs of accelerations, projections and records, with rows in the order ``chosen`` or that of the start."""

    def __init__(self, made: TreeMechanism, chosen: EliminationOrder | None = None) -> None:
        self.made, self.nq, self.order = made, made.tree.nq, chosen or made.order
        self.closing = select_rows(made.mechanism.closing, self.order.rows, self.order.pivots)
        self._limbs, self._loads = made.mechanism.limbs, int(made.mechanism.forces)

    def accelerate(self, t: np.ndarray, y: np.ndarray, y_dot: np.ndarray, least: np.ndarray) -> Program:
        """Return the program that computes ``y_dot`` and the ``least`` relative pivot from ``t`` [s] and ``y``."""
        q, u = np.split(y, [self.nq])
        q_dot, u_dot = np.split(y_dot, [self.nq])
        task = AcceleratedTree(self._limbs, self.closing, t, q, u, q_dot, u_dot, least, self._loads)
        return BoundFunction(accelerate_tree, task)

    def finish(
        self, t: np.ndarray, y: np.ndarray, after: np.ndarray, y_dot: np.ndarray, lam: np.ndarray, guard: np.ndarray
    ) -> Program:
        """Return the program that computes ``y_dot`` and ``lam``, and projects ``y`` onto the loops, into ``after``.

        q_dot in ``y_dot`` is that after the projection, u_dot that before it, as is ``lam``; ``guard`` gets the least
        pivot, and the largest |phi| of rows that are left out.
        """
        (q, u), (q_dot, u_dot), (q_after, u_after) = (np.split(x, [self.nq]) for x in (y, y_dot, after))
        task = ProjectedTree(
            self._limbs,
            self.closing,
            t,
            q,
            u,
            q_dot,
            u_dot,
            guard[:1],
            self._loads,
            q_after,
            u_after,
            lam,
            guard[1:],
            np.zeros(len(q)),
            np.zeros(len(u)),
        )
        return BoundFunction(project_tree, task)

    def record(self, t: np.ndarray, y: np.ndarray, y_dot: np.ndarray, lam: np.ndarray, *results: np.ndarray) -> Program:
        """Return the program that sets ``results`` to r, R, v, v_dot of all bodies, and the reactions of all joints."""
        (q, u), (_, u_dot) = (np.split(x, [self.nq]) for x in (y, y_dot))
        of = self.made.mechanism._replace(closing=self.closing)
        return BoundFunction(
            record_tree, make_record(self.made.system, self.made.tree, of, (t, q, u, u_dot, lam, *results))
        )

    def measure(
        self, given: np.ndarray, start: np.ndarray, y: np.ndarray, sums: np.ndarray, error: np.ndarray
    ) -> Program:
        """Return the program that computes the ``error`` of a step from ``start`` to ``y``, relative to its tolerances.

        ``given`` is (t, h, rtol); ``sums`` (2, n) are both estimates of the error, divided by h.
        """
        blocks = np.array(list_tolerance_blocks(self.made.tree), dtype=np.int64).reshape(-1, 3).T
        low, high, angle = (np.ascontiguousarray(x) for x in blocks)
        return BoundFunction(measure_error, ErrorParts(low, high, angle, given, start, y, sums, error))

    def find_order(self, t: float, y: np.ndarray, start: np.ndarray) -> EliminationOrder:
        """Return an order of rows whose pivots are safe at ``t`` [s] and ``y``; raise ``LostRank`` if there is none.

        They are compared with S at the start; ``start`` is an argument of ``Evaluation`` that is not used here.
        """
        here, size = self.made.couple_at(t, y), np.diag(self.made.at_start.S)
        of = np.where(size > 0.0, size, float(np.max(size, initial=0.0)))
        for compared in (None, of):  # a row may vanish here where another one takes its place
            order = choose_rows(here, compared)
            safe = all(pivot >= AGAIN * of[k] for k, pivot in zip(order.rows, order.pivots, strict=True))
            if len(order.rows) == self.made.rows_in_use and safe:
                return order
        raise LostRank


def _has_inertia(of: ClosedTree) -> bool:
    """Return whether each velocity of a tree moves inertia: ``D``, the inverse inertia along each axis, is positive."""
    l: Any = of.limbs
    for k in range(len(l.parent)):
        n = int(l.slides[k] + l.turns[k])
        if n and not np.all(np.diag(l.D[k, :n, :n]) > 0.0):
            return False
    return True
