"""Accelerations and projections by the code of a mechanism, as programs: its own elimination, or one by lists."""

from typing import Any, NamedTuple

import numpy as np

from ..compiled.entries import Bound
from ..generated import Program
from .code import JointCode
from .elimination import Order
from .pivots import factor_by_lists, find_order_here, make_lists, solve_by_lists, solve_rows_by_lists

Steps = list[tuple[int, list[np.ndarray]]]


class Gap(NamedTuple):
    """Rows that are left out."""

    phi: Any  # (rows,)
    out: Any  # their numbers
    gap: Any  # (1,) result


def find_gap(s: Any) -> None:
    """Find the largest phi of rows that are left out."""
    gap = 0.0
    for n in range(len(s.out)):
        gap = max(gap, abs(s.phi[s.out[n]]))
    s.gap[0] = gap


class Evaluation:
    """K's entries and its factor in one order, ``chosen`` or the code's own."""

    def __init__(self, made: JointCode, nq: int, chosen: Order | None = None) -> None:
        """Arrays of one motion; programs are to be kept with this."""
        self.made, self.nq, self.order = made, nq, chosen or made.order
        self.K = self._entries()
        self._lists = make_lists(made.pattern, chosen, self.K) if chosen else None
        self._L, self._lam = np.zeros(made.entries), np.zeros(made.rows)
        self._b, self._rhs = np.zeros((2, made.pattern.nu + made.rows))
        self._keeps: list[Any] = []

    def _entries(self) -> np.ndarray:
        pattern = self.made.pattern
        return np.concatenate((np.zeros(pattern.variable), pattern.constants))

    def step(self, name: str, *arrays: np.ndarray) -> Steps:
        """Return the call of a function of the code."""
        return [(self.made.code.address(name), list(arrays))]

    def accelerate(self, t: np.ndarray, y: np.ndarray, y_dot: np.ndarray, least: np.ndarray) -> Program:
        """Return the program of accelerations."""
        if self.made.whole and not self._lists:
            return Program(self.step("accelerate", t, y, y_dot, least), self)
        q_dot, u_dot = np.split(y_dot, [self.nq])
        steps = self.entries(t, y, self._b, q_dot) + self.factor(least) + self.solve(self._b, u_dot, self._lam)
        return Program(steps, self)

    def finish(
        self, t: np.ndarray, y: np.ndarray, after: np.ndarray, y_dot: np.ndarray, lam: np.ndarray, guard: np.ndarray
    ) -> Program:
        """Return the program of y projected, with accelerations and ``lam`` at what came in; pivots and gap."""
        q_dot, u_dot = np.split(y_dot, [self.nq])
        q, step, phi, gaps = np.zeros(self.nq), np.zeros(len(u_dot)), np.zeros(self.made.rows), self._rhs
        steps = self.entries(t, y, self._b, q_dot) + self.factor(guard[:1]) + self.solve(self._b, u_dot, lam)
        close = self.solve(gaps, step, self._lam) if self.made.rows else []
        steps += [*self.step("gaps", t, y, gaps), *close, *self.step("move", t, y, step, q, gaps, phi), *close]
        steps += self._watch(phi, guard[1:])
        return Program(steps + self.step("conclude", y, q, step, after, q_dot), self)

    def record(self, t: np.ndarray, y: np.ndarray, y_dot: np.ndarray, lam: np.ndarray, *results: np.ndarray) -> Program:
        """Return the program of r, R, v, v_dot of all bodies and of reactions."""
        return Program(self.step("record", t, y, y_dot, lam, *results), self.made.code)

    def measure(
        self, given: np.ndarray, start: np.ndarray, y: np.ndarray, sums: np.ndarray, error: np.ndarray
    ) -> Program:
        """Return the program of the error of a step."""
        return Program(self.step("measure", given, start, y, sums, error), self.made.code)

    def step_at_once(self, *arrays: np.ndarray) -> Program:
        """Return the program of a step of a small mechanism."""
        return Program(self.step("step", *arrays), self.made.code)

    def entries(self, t: np.ndarray, y: np.ndarray, b: np.ndarray, q_dot: np.ndarray) -> Steps:
        """Return steps: K and b."""
        return self.step("entries", t, y, self.K[: self.made.pattern.variable], b, q_dot)

    def factor(self, least: np.ndarray) -> Steps:
        """Return steps: L of K, and its least pivot."""
        if self._lists:
            return self._bound(factor_by_lists, least=least)
        return self.step("factor", self.K, self._L, least)

    def solve(self, b: np.ndarray, u: np.ndarray, lam: np.ndarray) -> Steps:
        """Return steps: what L makes of loads along velocities and of rows."""
        if self._lists:
            return self._bound(solve_by_lists, b=b, u=u, lam=lam)
        return self.step("solve", self._L, b, u, lam)

    def solve_rows(self, b: np.ndarray, lam: np.ndarray) -> Steps:
        """Return steps: the same of rows alone."""
        if self._lists:
            return self._bound(solve_rows_by_lists, b=b, lam=lam)
        return self.step("solve_rows", self._L, b, lam)

    def find_order(self, t: float, y: np.ndarray, start: np.ndarray) -> Order:
        """Return an order whose pivots are safe at y; LostRank if there is none."""
        return find_order_here(self.made.pattern, self._entries_at(t, y), self._entries_at(0.0, start))

    def _entries_at(self, t: float, y: np.ndarray) -> np.ndarray:
        K, pattern = self._entries(), self.made.pattern
        found = K[: pattern.variable], np.zeros_like(self._b), np.zeros(self.nq)
        Program(self.step("entries", np.array([t]), y.copy(), *found)).run()
        return K

    def _watch(self, phi: np.ndarray, gap: np.ndarray) -> Steps:
        kept = {k - self.made.pattern.first for k in self.order.rows}
        out = np.array([k for k in range(self.made.rows) if k not in kept], dtype=np.int64)
        return self._steps(Bound(find_gap, Gap(phi, out, gap))) if len(out) else []

    def _bound(self, function: Any, **arrays: Any) -> Steps:
        return self._steps(Bound(function, self._lists._replace(**arrays)))  # type: ignore[union-attr]

    def _steps(self, bound: Bound) -> Steps:
        self._keeps.append(bound)
        return [(address, list(arrays)) for address, arrays in bound.steps]
