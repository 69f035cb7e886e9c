"""Entries of a kernel for one mechanism, one function each, which share the entries of A that vary.

``SymbolicMechanism`` has one function for accelerations, in which A is not stored; methods that iterate with the factor
at one pose and the rows at others need separate ones.
"""

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca

from ....harness.base.generated import GeneratedFunction
from ....harness.mechanics.system import GROUND
from .expressions import express_rows, find_distinct_entries, list_by_rows
from .means import express_mean_rows
from .mechanism import (
    SymbolicMechanism,
    SymbolicRow,
    SymbolicState,
    list_exact_joint_parameters,
    make_column,
    multiply_row,
)


class SplitMechanism(SymbolicMechanism):
    """A system and its rows, by functions that share A (entries that vary) and ``factor``."""

    def make_functions(self, *, names: Sequence[str]) -> tuple[dict[str, GeneratedFunction], list[int]]:  # type: ignore[override]
        """Return the functions ``names``, and how many distinct entries of A vary, and how many the factor has.

        ``rows`` (t, r, R, v) -> (A, phi, phi_t, gamma); ``factorise`` (A, shift) -> factor, where rows are chosen
        (A, shift, bounds) -> (factor, inverse shares), with ``couple`` (A) -> scaled S;
        ``solve`` (factor, rhs) -> x; ``forces``, ``applied_forces`` (t, r, R, v) -> force;
        ``react`` (t, r, R, v, A, gamma, factor) -> (v_dot, lam); ``push`` (A, x, w) -> w; ``slips`` (A, phi_t, w) -> x;
        ``close_joints`` (r, R, A, phi, factor) -> (r, R); ``project_rates`` (A, phi_t, factor, v) -> (v, impulse);
        ``copy_entries``, ``copy_rows``, ``copy_bodies``, ``copy_poses`` copy A, x, w, and (r, R).
        """
        nb, n, at = self.system.nb, len(self.order), self.state()
        full = self._rows(at)
        entries, fill = self._find_entries(full)
        A, x, w, shift = (ca.SX.sym(*a) for a in (("A", entries.numel()), ("x", n), ("w", 6 * nb), ("shift", 1)))
        phi, phi_t, gamma = (ca.SX.sym(name, n) for name in ("phi", "phi_t", "gamma"))
        rows = {k: SymbolicRow(a, phi[k], phi_t[k], gamma[k]) for k, a in fill(A).items()}
        factor, shares, couple = self._make_factor(rows, [A], shift)
        numbers, kept = factor.exchange_numbers()
        poses, by_body = [at.t, at.r, at.R, at.v], ca.vertsplit(w, 6)

        def stack_by_row(values: dict[int, Any]) -> ca.SX:
            """Return ``values``, given by index of row, as a column."""
            return make_column([values[k] for k in range(n)])

        def react() -> GeneratedFunction:
            """Return the function ``react``: accelerations and reactions of index 1."""
            free = [self._divide_by_mass(b, load) for b, load in enumerate(self._loads(at))]
            lam = factor.solve({k: -row.gamma - multiply_row(row, free) for k, row in rows.items()})
            return GeneratedFunction(
                [*poses, A, gamma, kept], [ca.vertcat(*self._add_response(free, rows, lam)), stack_by_row(lam)]
            )

        def close_joints() -> GeneratedFunction:
            """Return the function ``close_joints``: poses corrected once towards phi = 0."""
            closed = self._close_joints(at, rows, factor)
            return GeneratedFunction([at.r, at.R, A, phi, kept], [closed.r, closed.R])

        def project_rates() -> GeneratedFunction:
            """Return the function ``project_rates``: velocities with phi_dot = 0, and the impulses that change them."""
            impulse = factor.solve({k: -row.phi_t - multiply_row(row, by_body) for k, row in rows.items()})
            return GeneratedFunction(
                [A, phi_t, kept, w], [ca.vertcat(*self._add_response(by_body, rows, impulse)), stack_by_row(impulse)]
            )

        def slips() -> GeneratedFunction:
            """Return the function ``slips``: -phi_dot at the velocities w."""
            slip = {k: -row.phi_t - multiply_row(row, by_body) for k, row in rows.items()}
            return GeneratedFunction([A, phi_t, w], [stack_by_row(slip)])

        def stack_field(name: str) -> ca.SX:
            """Return the field ``name`` of all rows as a column."""
            return stack_by_row({k: getattr(row, name) for k, row in full.items()})

        makers: dict[str, Callable[[], GeneratedFunction]] = {
            "rows": lambda: GeneratedFunction(self._inputs(at), [entries, *map(stack_field, self._results)]),
            "factorise": lambda: GeneratedFunction([A, shift, *self._bounds], [numbers, *shares]),
            "solve": lambda: GeneratedFunction([kept, x], [stack_by_row(factor.solve({k: x[k] for k in range(n)}))]),
            "forces": lambda: GeneratedFunction(poses, [ca.vertcat(*self._loads(at))]),
            "applied_forces": lambda: GeneratedFunction(poses, [ca.vertcat(*self._loads(at, turning=False))]),
            "react": react,
            "close_joints": close_joints,
            "project_rates": project_rates,
            "slips": slips,
            "push": lambda: GeneratedFunction(
                [A, x, w], [ca.vertcat(*self._add_response(by_body, rows, {k: x[k] for k in range(n)}))]
            ),
            "copy_entries": lambda: GeneratedFunction([A], [A]),
            "copy_rows": lambda: GeneratedFunction([x], [x]),
            "copy_bodies": lambda: GeneratedFunction([w], [w]),
            "copy_poses": lambda: GeneratedFunction([at.r, at.R], [at.r, at.R]),
        }
        return {**{name: makers[name]() for name in names}, **couple}, [entries.numel(), numbers.numel()]

    _results: Sequence[str] = ("phi", "phi_t", "gamma")  # results of ``rows``, after A

    def _inputs(self, at: SymbolicState) -> list[ca.SX]:
        """Return the inputs of the function ``rows``: time, poses and velocities."""
        return [*at]

    def _find_entries(
        self, rows: dict[int, SymbolicRow]
    ) -> tuple[ca.SX, Callable[[ca.SX], dict[int, dict[int, ca.SX]]]]:
        """Return the distinct entries of A that vary, joint by joint, and a function that fills A from them.

        A is given and returned by row, then by body (6,).
        """
        values: list[ca.SX] = []
        parts = []
        for part in self.parts:
            of = range(part.first, part.first + len(part.of))
            bodies = list(rows[part.first].A)
            own, filled = find_distinct_entries(ca.horzcat(*(ca.vertcat(*(rows[k].A[b] for b in bodies)) for k in of)))
            parts.append((of, bodies, filled, len(values)))
            values += own

        def fill(kept: ca.SX) -> dict[int, dict[int, ca.SX]]:
            """Return the blocks of A by row and body, with ``kept`` in place of its distinct entries."""
            out: dict[int, dict[int, ca.SX]] = {}
            for of, bodies, filled, first in parts:
                made = filled(kept[first:])
                for c, k in enumerate(of):
                    out[k] = {b: made[6 * e : 6 * e + 6, c] for e, b in enumerate(bodies)}
            return out

        return ca.vertcat(*values) if values else ca.SX(0, 1), fill


class MeanMechanism(SplitMechanism):
    """A split mechanism with mean rows: ``rows`` (h, r0, R0, r, R, v) -> (A, phi), where v are mean velocities."""

    _results = ("phi",)

    def __init__(self, *given: Any) -> None:
        """Add symbols for the step's length and start poses to those of ``SymbolicMechanism``."""
        super().__init__(*given)
        nb = self.system.nb
        self._h, self._r0, self._R0 = ca.SX.sym("h"), ca.SX.sym("r0", 3 * nb), ca.SX.sym("R0", 9 * nb)

    def _inputs(self, at: SymbolicState) -> list[ca.SX]:
        """Return the inputs of the function ``rows``: h, poses at both ends, and mean velocities."""
        return [self._h, self._r0, self._R0, at.r, at.R, at.v]

    def _rows(self, at: SymbolicState) -> dict[int, SymbolicRow]:
        """Return the mean rows of all joints, by their indices in the kernel; phi is that at the end of the step."""
        out: dict[int, SymbolicRow] = {}
        arrays = (self._r0, 3), (self._R0, 9), (at.r, 3), (at.R, 9), (at.v, 6)
        one = list_by_rows(ca.SX.eye(3))
        still = ca.SX.zeros(3), one, ca.SX.zeros(3), one, ca.SX.zeros(6)
        for part in self.parts:
            bodies = [still if b == GROUND else [a[n * b : n * b + n] for a, n in arrays] for b in part.body]
            numbers = ca.SX(ca.DM(list_exact_joint_parameters(self.system, part.joint)))
            phi, forces, X = express_mean_rows(express_rows(part.kind, part.of), numbers, self._h, bodies)
            for k in range(len(part.of)):
                A = {
                    b: ca.vertcat((1.0 - 2.0 * e) * forces[k, :].T, X[e][k, :].T)
                    for e, b in enumerate(part.body)
                    if b != GROUND
                }
                out[part.first + k] = SymbolicRow(A, phi[k], ca.SX(0), ca.SX(0))
        return out
