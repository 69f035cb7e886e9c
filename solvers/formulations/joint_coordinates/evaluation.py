"""Accelerations and projections by the code of a mechanism, as programs, with its own elimination or one by lists."""

from typing import Any, NamedTuple

import numpy as np

from ....harness.base.generated import Program
from ..compiled.algebra import take_larger
from ..compiled.entries import BoundFunction
from .code import JointCode
from .elimination import EliminationOrder
from .pivots import factor_by_lists, find_safe_order, make_lists, solve_by_lists, solve_rows_by_lists

Calls = list[tuple[int, list[np.ndarray]]]


class Gap(NamedTuple):
    """The bundle of ``find_gap``: phi, the rows left out of the elimination, and the result."""

    phi: Any  # (rows,)
    out: Any  # numbers of the rows left out
    gap: Any  # (1,) result


def find_gap(s: Any) -> None:
    """Set ``s.gap`` to the largest phi [m or 1] of the rows that are left out of the elimination."""
    gap = 0.0
    for n in range(len(s.out)):
        gap = take_larger(gap, abs(s.phi[s.out[n]]))
    s.gap[0] = gap


class Evaluation:
    """The arrays and programs that evaluate a mechanism by its code, in the order ``chosen`` or in the code's own."""

    def __init__(self, made: JointCode, nq: int, chosen: EliminationOrder | None = None) -> None:
        """Allocate the arrays of one motion; keep this object alive as long as its programs."""
        self.made, self.nq, self.order = made, nq, chosen or made.order
        self.K = self._allocate_entries()
        self._lists = make_lists(made.pattern, chosen, self.K) if chosen else None
        self._L, self._lam = np.zeros(made.entries), np.zeros(made.rows)
        self._b, self._rhs = np.zeros((2, made.pattern.nu + made.rows))
        self._keeps: list[Any] = []

    def _allocate_entries(self) -> np.ndarray:
        """Return a new array for the entries of K, with the constant ones, which come last, set."""
        pattern = self.made.pattern
        return np.concatenate((np.zeros(pattern.variable), pattern.constants))

    def make_call(self, name: str, *arrays: np.ndarray) -> Calls:
        """Return the call of the code's function ``name`` with these arrays, in a list; nothing is run."""
        return [(self.made.code.address(name), list(arrays))]

    def accelerate(self, t: np.ndarray, y: np.ndarray, y_dot: np.ndarray, least: np.ndarray) -> Program:
        """Return the program that computes ``y_dot`` and the ``least`` relative pivot from ``t`` [s] and ``y``."""
        if self.made.whole and not self._lists:
            return Program(self.make_call("accelerate", t, y, y_dot, least), self)
        q_dot, u_dot = np.split(y_dot, [self.nq])
        steps = self.entries(t, y, self._b, q_dot) + self.factor(least) + self.solve(self._b, u_dot, self._lam)
        return Program(steps, self)

    def finish(
        self,
        t: np.ndarray,
        y: np.ndarray,
        after: np.ndarray,
        y_dot: np.ndarray,
        lam: np.ndarray,
        guard: np.ndarray,
        *,
        factored: bool = False,
    ) -> Program:
        """Return the program that projects ``y`` onto the loops, into ``after``, and computes ``y_dot`` and ``lam``.

        Accelerations and ``lam`` are those before the projection. ``guard`` gets the least pivot, and the largest phi
        of rows left out. With ``factored`` the last factor is that of K at ``y``, to rounding, and has set the least
        pivot.
        """
        q_dot, u_dot = np.split(y_dot, [self.nq])
        q, step, phi, gaps = np.zeros(self.nq), np.zeros(len(u_dot)), np.zeros(self.made.rows), self._rhs
        factor = [] if factored else self.factor(guard[:1])
        steps = self.entries(t, y, self._b, q_dot) + factor + self.solve(self._b, u_dot, lam)
        close = self.solve(gaps, step, self._lam) if self.made.rows else []
        steps += [
            *self.make_call("gaps", t, y, gaps),
            *close,
            *self.make_call("move", t, y, step, q, gaps, phi),
            *close,
        ]
        steps += self._measure_gap(phi, guard[1:])
        return Program(steps + self.make_call("conclude", y, q, step, after, q_dot), self)

    def record(self, t: np.ndarray, y: np.ndarray, y_dot: np.ndarray, lam: np.ndarray, *results: np.ndarray) -> Program:
        """Return the program that sets ``results`` to r, R, v, v_dot of all bodies, and the reactions of all joints."""
        return Program(self.make_call("record", t, y, y_dot, lam, *results), self.made.code)

    def measure(
        self, given: np.ndarray, start: np.ndarray, y: np.ndarray, sums: np.ndarray, error: np.ndarray
    ) -> Program:
        """Return the program that computes the ``error`` of a step relative to its tolerances.

        ``given`` are (t, h, rtol); ``sums`` are both estimates of the error, divided by h.
        """
        return Program(self.make_call("measure", given, start, y, sums, error), self.made.code)

    def step_at_once(self, *arrays: np.ndarray) -> Program:
        """Return the program of the code's function ``step``, all stages in one; only small mechanisms have it."""
        return Program(self.make_call("step", *arrays), self.made.code)

    def entries(self, t: np.ndarray, y: np.ndarray, b: np.ndarray, q_dot: np.ndarray) -> Calls:
        """Return the steps that compute K, the loads ``b`` and the rates ``q_dot`` from ``t`` and ``y``."""
        return self.make_call("entries", t, y, self.K[: self.made.pattern.variable], b, q_dot)

    def factor(self, least: np.ndarray) -> Calls:
        """Return the steps that factorise K, and set ``least`` to its least pivot, relative to the order's own."""
        if self._lists:
            return self._make_list_steps(factor_by_lists, least=least)
        return self.make_call("factor", self.K, self._L, least)

    def solve(self, b: np.ndarray, u: np.ndarray, lam: np.ndarray) -> Calls:
        """Return the steps that solve K (u, -lam) = b with the last factor; ``b`` is by velocities, then by rows."""
        if self._lists:
            return self._make_list_steps(solve_by_lists, b=b, u=u, lam=lam)
        return self.make_call("solve", self._L, b, u, lam)

    def solve_rows(self, b: np.ndarray, lam: np.ndarray) -> Calls:
        """Return the steps that solve for ``lam`` from the right-hand sides ``b`` of rows alone."""
        if self._lists:
            return self._make_list_steps(solve_rows_by_lists, b=b, lam=lam)
        return self.make_call("solve_rows", self._L, b, lam)

    def find_order(self, t: float, y: np.ndarray, start: np.ndarray) -> EliminationOrder:
        """Return an order of elimination whose pivots are safe at ``y``; raise ``LostRank`` if there is none.

        They are compared with the pivots at ``start``, which is y at t = 0.
        """
        return find_safe_order(self.made.pattern, self._evaluate_entries(t, y), self._evaluate_entries(0.0, start))

    def _evaluate_entries(self, t: float, y: np.ndarray) -> np.ndarray:
        """Return the entries of K at ``t`` [s] and ``y`` = (q, u), evaluated by the code."""
        K, pattern = self._allocate_entries(), self.made.pattern
        found = K[: pattern.variable], np.zeros_like(self._b), np.zeros(self.nq)
        Program(self.make_call("entries", np.array([t]), y.copy(), *found)).run()
        return K

    def _measure_gap(self, phi: np.ndarray, gap: np.ndarray) -> Calls:
        """Return the steps that set ``gap`` to the largest phi of the rows left out; none where all rows are in use."""
        kept = {k - self.made.pattern.first for k in self.order.rows}
        out = np.array([k for k in range(self.made.rows) if k not in kept], dtype=np.int64)
        return self._list_steps(BoundFunction(find_gap, Gap(phi, out, gap))) if len(out) else []

    def _make_list_steps(self, function: Any, **arrays: Any) -> Calls:
        """Return the steps that call a compiled ``function`` on the lists of the order of elimination.

        ``arrays`` replace fields of ``EliminationLists``.
        """
        return self._list_steps(BoundFunction(function, self._lists._replace(**arrays)))  # type: ignore[union-attr]

    def _list_steps(self, bound: BoundFunction) -> Calls:
        """Return the steps of a compiled function as a list, and keep the function alive."""
        self._keeps.append(bound)
        return [(address, list(arrays)) for address, arrays in bound.steps]
