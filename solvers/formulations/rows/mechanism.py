"""Index 1 of one mechanism as a single list of operations, in which its numbers are constants, so that zeros vanish.

S = A M^-1 A^T = L D L^T by scalars, in the order of the kernel's blocks; where a pivot is below ``DEPENDENT`` times its
diagonal entry, its row is redundant there and 1/D is 0, as in the kernel: the rank may change with the configuration.
Where rows of loops may be chosen anew (``compiled.row_choice``), that bound is an input for each row, infinite for one
that is left out; inverse pivots are a result, and S is one of the function ``couple``.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ....harness.base.generated import GeneratedFunction
from ....harness.mechanics import forces
from ....harness.mechanics.fixed_order import inverse
from ....harness.mechanics.system import GROUND, MultibodySystem
from ..joint_coordinates.elimination import Factor, Matrix
from .expressions import (
    express_push,
    express_rows,
    list_by_rows,
    list_force_parameters,
    list_joint_parameters,
    make_matrix,
)

DEPENDENT = 1e-9  # the bound of ``compiled.factor``
NOISE = 1e-15  # share of the largest of an array below which a constant is rounding of zero
# power of the angle at which the series of a correction ends. Tried by code made anew: 8 and 36 change no bit of four
# runs of RATTLE, whose corrections are small.
LAST = 18


class JointPart(NamedTuple):
    """Rows of a joint by their indices ``of``, its bodies, and the index of the first of these rows in the kernel."""

    kind: str
    of: tuple[int, ...]
    joint: int
    body: tuple[int, int]
    first: int


class SymbolicState(NamedTuple):
    """Symbols of time, poses and velocities of all bodies."""

    t: ca.SX
    r: ca.SX  # (3 nb,)
    R: ca.SX  # (9 nb,) by rows
    v: ca.SX  # (6 nb,)


class SymbolicRow(NamedTuple):
    """A constraint row at a state; A (6,) on each of its bodies that is not the ground."""

    A: dict[int, ca.SX]
    phi: ca.SX
    phi_t: ca.SX
    gamma: ca.SX


class RankedFactor(Factor):
    """L and 1/D of S with its diagonal times 1 + ``shift``; 1/D is 0 where a row depends on those before.

    ``bounds`` (n,): pivots over diagonal entries below which a row is left out, in place of ``DEPENDENT``.
    """

    def __init__(self, S: Matrix, order: Sequence[int], shift: Any = 0.0, bounds: ca.SX | None = None) -> None:
        self.diagonal, self._bounds = {k: S[k][k] for k in order}, bounds
        super().__init__({k: {**S[k], k: S[k][k] * (1.0 + shift)} for k in order}, order)

    def invert(self, k: int, pivot: Any) -> Any:
        """Return 1/D of row ``k`` from its ``pivot``; 0 where that is below the row's bound times its diagonal."""
        bound = DEPENDENT if self._bounds is None else self._bounds[k]
        inverse = ca.if_else(pivot > bound * self.diagonal[k], 1 / pivot, 0)
        return ca.fabs(inverse)  # without it CasADi turns every product with it into a division and a choice

    def inverse_shares(self) -> ca.SX:
        """Return each row's diagonal entry over its pivot as a column (n,); 0 for a row left out."""
        return make_column([self.inverse[k] * self.diagonal[k] for k in range(len(self.order))])

    def exchange_numbers(self) -> tuple[ca.SX, ca.SX]:
        """Replace the entries of 1/D and L by symbols; return their former expressions and the symbols as columns."""
        places: list[tuple[dict[int, Any], int]] = []
        for k in self.order:
            places += [(self.inverse, k), *((self.L[k], row) for row in self.L[k])]
        numbers = make_column([column[row] for column, row in places])
        kept = ca.SX.sym("factor", numbers.numel())
        for n, (column, row) in enumerate(places):
            column[row] = kept[n]
        return numbers, kept


class SymbolicMechanism:
    """A system, its rows by parts, and the order in which the kernel eliminates them.

    ``chooses``: rows of loops may be chosen anew, by bounds that are inputs.
    """

    def __init__(
        self, system: MultibodySystem, parts: Sequence[JointPart], order: Sequence[int], chooses: bool
    ) -> None:
        """Store the rows and their ``order`` of elimination, and the inertias as constants in which zeros are exact."""
        self.system, self.parts, self.order = system, parts, order
        self._bounds = [ca.SX.sym("bounds", len(order))] if chooses else []
        inertia = system.regular_inertia
        self.J, self.J_inv = ([ca.sparsify(ca.DM(snap_zeros(a))) for a in of] for of in (inertia, inverse(inertia)))

    def state(self) -> SymbolicState:
        """Return new symbols for time, poses and velocities of all bodies."""
        nb = self.system.nb
        return SymbolicState(ca.SX.sym("t"), ca.SX.sym("r", 3 * nb), ca.SX.sym("R", 9 * nb), ca.SX.sym("v", 6 * nb))

    def make_functions(self) -> tuple[dict[str, GeneratedFunction], list[int]]:
        """Return the functions ``accelerate``, ``project`` and ``copy``, and the size of the factor.

        ``accelerate`` (t, r, R, v) -> (v_dot, lam, factor), ``project`` (t, r, R, v, factor) -> (r, R, v), ``copy``
        (r, R, v) -> (r, R, v). The size is in a list, alone. A projection is one correction of poses and one of
        velocities with the given factor. Where rows are chosen, ``accelerate`` also reads bounds and returns inverse
        shares, and there is ``couple`` (t, r, R, v) -> S, each row and column over the root of its diagonal entry.
        """
        n, at = len(self.order), self.state()
        rows = self._rows(at)
        factor, shares, couple = self._make_factor(rows, [*at])
        free = [self._divide_by_mass(b, load) for b, load in enumerate(self._loads(at))]
        lam = factor.solve({k: -row.gamma - multiply_row(row, free) for k, row in rows.items()})
        v_dot = self._add_response(free, rows, lam)
        numbers, kept = factor.exchange_numbers()
        moved = self._close_joints(at, rows, factor)
        rows = self._rows(moved)
        v = ca.vertsplit(at.v, 6)
        x = factor.solve({k: -row.phi_t - multiply_row(row, v) for k, row in rows.items()})
        return {
            "accelerate": GeneratedFunction(
                [*at, *self._bounds], [ca.vertcat(*v_dot), make_column([lam[k] for k in range(n)]), numbers, *shares]
            ),
            "project": GeneratedFunction([*at, kept], [moved.r, moved.R, ca.vertcat(*self._add_response(v, rows, x))]),
            "copy": GeneratedFunction([*at[1:]], [*at[1:]]),
            **couple,
        }, [numbers.numel()]

    def _make_factor(
        self, rows: dict[int, SymbolicRow], inputs: Sequence[ca.SX], shift: Any = 0.0
    ) -> tuple[RankedFactor, list[ca.SX], dict[str, GeneratedFunction]]:
        """Return the factor of S = A M^-1 A^T, [inverse shares] and {"couple": its function}.

        The last two are empty unless rows are chosen. ``inputs`` are the symbols that the rows depend on; ``shift``
        times the diagonal is added to it.
        """
        S, n = self._make_schur_complement(rows), len(self.order)
        factor = RankedFactor(S, self.order, shift, self._bounds[0] if self._bounds else None)
        if not self._bounds:
            return factor, [], {}
        root = [ca.sqrt(ca.if_else(S[k][k] > 0, 1 / S[k][k], 0)) for k in range(n)]
        scaled = ca.vertcat(*(S[a].get(c, ca.SX(0)) * root[a] * root[c] for a in range(n) for c in range(n)))
        return factor, [factor.inverse_shares()], {"couple": GeneratedFunction([*inputs], [scaled])}

    def _close_joints(self, at: SymbolicState, rows: dict[int, SymbolicRow], factor: Factor) -> SymbolicState:
        """Return the state after one correction of the poses towards phi = 0 along M^-1 A^T, with the ``factor``."""
        x = factor.solve({k: -row.phi for k, row in rows.items()})
        change = self._add_response([ca.SX.zeros(6)] * self.system.nb, rows, x)
        R = [_turn_by_series(make_matrix(at.R[9 * b : 9 * b + 9]), a[3:]) for b, a in enumerate(change)]
        return at._replace(r=at.r + ca.vertcat(*[a[:3] for a in change]), R=ca.vertcat(*map(list_by_rows, R)))

    def _rows(self, at: SymbolicState) -> dict[int, SymbolicRow]:
        """Return the constraint rows of all joints at a state, by their indices in the kernel."""
        out: dict[int, SymbolicRow] = {}
        for part in self.parts:
            e = express_rows(part.kind, part.of)
            free = ca.Function("free", [e.x, e.V, e.t, e.numbers], [e.A, e.phi, e.phi_t, e.gamma])
            A, *scalars = free(*self._list_inputs(part, at))
            for k in range(len(part.of)):
                own = {b: A[k, 6 * e : 6 * e + 6].T for e, b in enumerate(part.body) if b != GROUND}
                out[part.first + k] = SymbolicRow(own, *(x[k] for x in scalars))
        return out

    def _list_inputs(self, part: JointPart, at: SymbolicState) -> list[Any]:
        """Return the inputs of a joint's expressions: poses (24,) and velocities (12,), the time and its parameters."""
        return [*join_ends(at, part.body), at.t, list_exact_joint_parameters(self.system, part.joint)]

    def _make_schur_complement(self, rows: dict[int, SymbolicRow]) -> Matrix:
        """Return S = A M^-1 A^T as {column: {row: entry}}, both halves; entries that vanish are left out."""
        S: Matrix = {k: {k: ca.SX(0)} for k in rows}
        holding: dict[int, list[int]] = {}  # rows on each body so far
        for k, row in rows.items():
            for b, a in row.A.items():
                y = self._divide_by_mass(b, a)
                for other in [*holding.setdefault(b, []), k]:
                    x = ca.dot(rows[other].A[b], y)
                    if not x.is_zero():
                        S[k][other] = S[other][k] = S[k].get(other, 0) + x
                holding[b].append(k)
        return S

    def _loads(self, at: SymbolicState, *, turning: bool = True) -> list[ca.SX]:
        """Return the load (6,) of gravity and applied forces on each body, [space; body].

        Unless ``turning`` is False, the gyroscopic torque Omega x J Omega is subtracted.
        """
        s, out = self.system, list[ca.SX]()
        for b, v in enumerate(ca.vertsplit(at.v, 6)):
            gyroscopic = -ca.cross(v[3:], self.J[b] @ v[3:]) if turning else ca.SX.zeros(3)
            out.append(ca.vertcat(ca.SX(ca.DM(s.mass[b] * s.gravity)), gyroscopic))
        for kind, declared in forces.DECLARED.items():
            e = express_push(kind)
            free = ca.Function("free", [e.x, e.V, e.t, e.numbers], [e.load])
            # numbers of several units: none is small compared with others
            for m, numbers in enumerate(list_force_parameters(s, kind)):
                j = int(getattr(s, f"{kind}_j")[m]) if declared.pair else GROUND
                ends = int(getattr(s, f"{kind}_i")[m]), j
                add_to_bodies(out, ends, free(*join_ends(at, ends), at.t, numbers))
        return out

    def _divide_by_mass(self, b: int, load: ca.SX) -> ca.SX:
        """Return M^-1 load of body ``b``."""
        return ca.vertcat(load[:3] * (1.0 / self.system.mass[b]), self.J_inv[b] @ load[3:])

    def _add_response(self, w: Sequence[ca.SX], rows: dict[int, SymbolicRow], x: dict[int, ca.SX]) -> list[ca.SX]:
        """Return w + M^-1 A^T x for each body: its velocities ``w`` (6,) changed by the rows' multipliers ``x``."""
        load = [ca.SX.zeros(6) for _ in w]
        for k, row in rows.items():
            for b, a in row.A.items():
                load[b] = load[b] + a * x[k]
        return [w_b + self._divide_by_mass(b, load[b]) for b, w_b in enumerate(w)]


def add_to_bodies(w: list[ca.SX], body: Sequence[int], load: ca.SX) -> None:
    """Add the ``load`` (12,) on a pair of bodies to their entries in ``w``, in place; the ground's half is dropped."""
    for e, b in enumerate(body):
        if b != GROUND:
            w[b] = w[b] + load[6 * e : 6 * e + 6]


def join_ends(at: SymbolicState, body: Sequence[int]) -> tuple[ca.SX, ca.SX]:
    """Return the poses (24,) and velocities (12,) of a pair of bodies, with the ground at rest."""
    still = ca.SX.zeros(3), list_by_rows(ca.SX.eye(3)), ca.SX.zeros(6)
    (r_i, R_i, v_i), (r_j, R_j, v_j) = (
        still if b == GROUND else (at.r[3 * b : 3 * b + 3], at.R[9 * b : 9 * b + 9], at.v[6 * b : 6 * b + 6])
        for b in body
    )
    return ca.vertcat(r_i, R_i, r_j, R_j), ca.vertcat(v_i, v_j)


def list_exact_joint_parameters(system: MultibodySystem, joint: int) -> np.ndarray:
    """Return the parameters (29,) of a joint in the order of the expressions, with exact zeros instead of rounding.

    That is done to its points, its directions u and w, and its axes n, each group with its own scale.
    """
    numbers = list_joint_parameters(system, np.array([joint]))[0]
    for part in (slice(0, 6), slice(6, 12), slice(12, 21)):
        numbers[part] = snap_zeros(numbers[part])
    return numbers


def snap_zeros(a: np.ndarray) -> np.ndarray:
    """Return ``a`` with exact zeros for entries below ``NOISE`` times the largest one."""
    return np.where(np.abs(a) < NOISE * np.max(np.abs(a), initial=0.0), 0.0, a)


def multiply_row(row: SymbolicRow, w: Sequence[ca.SX]) -> Any:
    """Return the product A w, a scalar, of one constraint row and the velocities ``w`` (6,) of all bodies."""
    return sum((ca.dot(a, w[b]) for b, a in row.A.items()), ca.SX(0))


def _turn_by_series(R: ca.SX, a: ca.SX) -> ca.SX:
    """Return R exp(hat(a)) for a small rotation vector ``a`` (3,) [rad], by series that end at the power ``LAST``."""
    s: Any = ca.dot(a, a)
    f = g = ca.SX(1)
    for n in range(LAST, 0, -2):
        f, g = 1 - s * (1.0 / (n * (n + 1))) * f, 1 - s * (1.0 / ((n + 1) * (n + 2))) * g
    hat = ca.skew(a)
    return R @ (ca.SX.eye(3) + f * hat + 0.5 * g * (hat @ hat))


def make_column(a: Sequence[ca.SX]) -> ca.SX:
    """Return the expressions ``a`` as a dense column (n, 1)."""
    return ca.densify(ca.vertcat(*a)) if len(a) else ca.SX(0, 1)
