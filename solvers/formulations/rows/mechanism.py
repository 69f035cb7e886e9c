"""Index 1 of a whole mechanism as one list of operations: its numbers are constants, so that zeros vanish.

S = A M^-1 A^T = L D L^T by scalars, in the order of the kernel's blocks; where a pivot is below ``DEPENDENT`` of its
own diagonal, its row is redundant there and 1/D is 0, as in the kernel.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ....harness.mechanics.system import GROUND, MultibodySystem
from ..generated import Straight
from .expressions import force_numbers, joint_numbers, push_expressions, row_expressions

DEPENDENT = 1e-9  # as in ``compiled.factor``
NOISE = 1e-15  # of the largest of its array: a constant that is zero but for rounding


class Part(NamedTuple):
    """Rows of one joint: its kind, their numbers within it, its bodies (-1: the ground), its first row, its numbers."""

    kind: str
    rows: tuple[int, ...]
    body: tuple[int, int]
    first: int
    numbers: np.ndarray


class State(NamedTuple):
    """Symbols of time, poses and velocities of all bodies."""

    t: ca.SX
    r: ca.SX  # (3 nb,)
    R: ca.SX  # (9 nb,) by rows
    v: ca.SX  # (6 nb,)


class Rows(NamedTuple):
    """All rows at a state: A by parts and ends, None on the ground, then scalars in the kernel's order."""

    A: list[list[Any]]
    phi: list[ca.SX]
    phi_t: list[ca.SX]
    gamma: list[ca.SX]


class Factor(NamedTuple):
    """L below the diagonal by columns {row: entry}, 1/D, and the order of the pivots."""

    L: dict[int, dict[int, ca.SX]]
    inverse: dict[int, ca.SX]
    order: list[int]


class Mechanism:
    """Expressions of a system; ``order`` lists the kernel's rows as they are eliminated."""

    def __init__(self, system: MultibodySystem, parts: Sequence[Part], order: Sequence[int]) -> None:
        self.system, self.parts, self.order = system, parts, [int(k) for k in order]
        self.J_inv = _snapped(np.linalg.inv(system.regular_inertia)) if system.nb else np.zeros((0, 3, 3))
        nb = system.nb
        self.at = State(ca.SX.sym("t"), ca.SX.sym("r", 3 * nb), ca.SX.sym("R", 9 * nb), ca.SX.sym("v", 6 * nb))

    def accelerate(self) -> tuple[Straight, int]:
        """(t, r, R, v) -> (v_dot, lam, factor); and the size of the factor."""
        rows = self._rows(self.at, self.at.R)
        f = [self._inverse_mass(b, load) for b, load in enumerate(self._loads())]
        factor = self._factor(rows)
        rhs = [-g for g in rows.gamma]
        self._subtract_rates(rows, f, rhs)
        lam = self._solve(factor, rhs)
        self._add_loads(rows, lam, f)
        numbers = self._numbers(factor)
        return Straight([*self.at], [ca.vertcat(*f), _column(lam), _column(numbers)]), len(numbers)

    def project(self, size: int) -> Straight:
        """(t, r, R, v, factor) -> (r, R, v), one pass each with the factor given."""
        at, kept = self.at, ca.SX.sym("factor", size)
        rows = self._rows(at, at.R)
        factor = self._with(self._factor(rows), kept)
        change = [ca.SX.zeros(6) for _ in range(self.system.nb)]
        self._add_loads(rows, self._solve(factor, [-x for x in rows.phi]), change)
        r = [at.r[3 * b : 3 * b + 3] + change[b][:3] for b in range(self.system.nb)]
        R = [_turned(_matrix(at.R, b), change[b][3:]) for b in range(self.system.nb)]
        moved = State(at.t, ca.vertcat(*r), ca.vertcat(*[ca.vec(a.T) for a in R]), at.v)
        rows = self._rows(moved, moved.R)
        v = [at.v[6 * b : 6 * b + 6] for b in range(self.system.nb)]
        rhs = [-x for x in rows.phi_t]
        self._subtract_rates(rows, v, rhs)
        self._add_loads(rows, self._solve(factor, rhs), v)
        return Straight([*at, kept], [moved.r, moved.R, ca.vertcat(*v)])

    def rows(self) -> Straight:
        """(t, r, R, v) -> (X, Y, way, phi, phi_t, gamma), as the kernel stores them."""
        rows, n = self._rows(self.at, self.at.R), len(self.order)
        X, Y, way = [ca.SX(n, 3), ca.SX(n, 3)], [ca.SX(n, 3), ca.SX(n, 3)], ca.SX(n, 3)
        for part, A in zip(self.parts, rows.A, strict=True):
            own = slice(part.first, part.first + len(part.rows))
            for e, (b, A_b) in enumerate(zip(part.body, A, strict=True)):
                if A_b is not None:
                    X[e][own, :], Y[e][own, :] = A_b[:, 3:], A_b[:, 3:] @ ca.sparsify(ca.DM(self.J_inv[b]))
                    if e == 0:
                        way[own, :] = A_b[:, :3]
        stored = [ca.vec(ca.densify(ca.vertcat(*a)).T) for a in (X, Y, [way])]
        return Straight([*self.at], [*stored, *map(_column, (rows.phi, rows.phi_t, rows.gamma))])

    def factorise(self) -> tuple[Straight, int]:
        """(shift, X, way) -> factor, of rows that the kernel stores; and its size. Zeros in all poses are left out."""
        n, rows = len(self.order), self._rows(self.at, self.at.R)
        shift, X, way = ca.SX.sym("shift"), ca.SX.sym("X", 6 * n), ca.SX.sym("way", 3 * n)
        for part, A in zip(self.parts, rows.A, strict=True):
            for e, A_b in enumerate(A):
                if A_b is None:
                    continue
                for a in range(len(part.rows)):
                    row = part.first + a
                    for c in range(6):
                        if not A_b[a, c].is_constant():
                            stored = X[3 * (n * e + row) + c - 3] if c > 2 else (1 - 2 * e) * way[3 * row + c]
                            A_b[a, c] = stored
        numbers = self._numbers(self._factor(rows, shift))
        return Straight([shift, X, way], [_column(numbers)]), len(numbers)

    def solve(self, size: int) -> Straight:
        """(factor, rhs) -> S^-1 rhs"""
        n, kept = len(self.order), ca.SX.sym("factor", size)
        rhs = ca.SX.sym("rhs", n)
        factor = self._with(self._factor(self._rows(self.at, self.at.R)), kept)
        return Straight([kept, rhs], [_column(self._solve(factor, [rhs[k] for k in range(n)]))])

    def copy(self) -> Straight:
        """(r, R, v) -> (r, R, v)"""
        return Straight([*self.at[1:]], [*self.at[1:]])

    def keep(self) -> Straight:
        """rows -> rows"""
        x = ca.SX.sym("x", len(self.order))
        return Straight([x], [x])

    def forces(self, *, gyroscopic: bool) -> Straight:
        """(t, r, R, v) -> the load on all bodies, less Omega x J Omega where asked for."""
        return Straight([*self.at], [ca.densify(ca.vertcat(*self._loads(gyroscopic=gyroscopic)))])

    def _rows(self, at: State, R: ca.SX) -> Rows:
        out = Rows([], *([ca.SX(0)] * len(self.order) for _ in range(3)))
        for part in self.parts:
            e = row_expressions(part.kind, part.rows)
            free = ca.Function("free", [e.x, e.V, e.t, e.numbers], [e.A, e.phi, e.phi_t, e.gamma])
            x, V = self._ends(at, R, part.body)
            A, phi, phi_t, gamma = free(x, V, at.t, part.numbers)
            out.A.append([A[:, 6 * k : 6 * k + 6] if b != GROUND else None for k, b in enumerate(part.body)])
            for series, values in zip(out[1:], (phi, phi_t, gamma), strict=True):
                for k in range(len(part.rows)):
                    series[part.first + k] = values[k]
        return out

    def _ends(self, at: State, R: ca.SX, body: Sequence[int]) -> tuple[ca.SX, ca.SX]:
        x, V = [], []
        for b in body:
            if b == GROUND:
                x += [ca.SX.zeros(3), ca.SX(ca.DM(np.eye(3).ravel()))]
                V.append(ca.SX.zeros(6))
            else:
                x += [at.r[3 * b : 3 * b + 3], R[9 * b : 9 * b + 9]]
                V.append(at.v[6 * b : 6 * b + 6])
        return ca.vertcat(*x), ca.vertcat(*V)

    def _loads(self, *, gyroscopic: bool = True) -> list[ca.SX]:
        s, at = self.system, self.at
        out = []
        for b in range(s.nb):
            Omega, J = at.v[6 * b + 3 : 6 * b + 6], ca.DM(_snapped(s.regular_inertia[b]))
            torque = -ca.cross(Omega, ca.sparsify(J) @ Omega) if gyroscopic else ca.SX.zeros(3)
            out.append(ca.vertcat(ca.SX(ca.DM(s.mass[b] * s.gravity)), torque))
        for kind in ("spring", "torsion", "load"):
            e = push_expressions(kind)
            free = ca.Function("free", [e.x, e.V, e.t, e.numbers], [e.load])
            for m, numbers in enumerate(force_numbers(s, kind)):
                j = GROUND if kind == "load" else int(getattr(s, f"{kind}_j")[m])
                ends = (int(getattr(s, f"{kind}_i")[m]), j)
                load = free(*self._ends(at, at.R, ends), at.t, numbers)  # of several units: none is small beside others
                for k, b in enumerate(ends):
                    if b != GROUND:
                        out[b] = out[b] + load[6 * k : 6 * k + 6]
        return out

    def _inverse_mass(self, b: int, load: ca.SX) -> ca.SX:
        return ca.vertcat(load[:3] / self.system.mass[b], ca.sparsify(ca.DM(self.J_inv[b])) @ load[3:])

    def _factor(self, rows: Rows, shift: Any = 0) -> Factor:
        S: dict[int, dict[int, ca.SX]] = {k: {} for k in self.order}  # by columns, at and below the diagonal
        place = {k: n for n, k in enumerate(self.order)}
        held: dict[int, list[tuple[int, int]]] = {}
        for p, part in enumerate(self.parts):
            for e, b in enumerate(part.body):
                if b != GROUND:
                    held.setdefault(b, []).append((p, e))
        for b, users in held.items():
            M = ca.sparsify(ca.DM(np.block([
                [np.eye(3) / self.system.mass[b], np.zeros((3, 3))], [np.zeros((3, 3)), self.J_inv[b]],
            ])))  # fmt: skip
            for p, e in users:
                Y = rows.A[p][e] @ M
                for q, g in users:
                    block = Y @ rows.A[q][g].T
                    for a in range(block.shape[0]):
                        for c in range(block.shape[1]):
                            row, left = self.parts[p].first + a, self.parts[q].first + c
                            if place[row] >= place[left] and not block[a, c].is_zero():
                                S[left][row] = S[left].get(row, 0) + block[a, c]
        diagonal = {k: S[k].get(k, ca.SX(0)) for k in self.order}
        for k in self.order:
            S[k][k] = diagonal[k] * (1 + shift)
        L: dict[int, dict[int, ca.SX]] = {}
        inverse: dict[int, ca.SX] = {}
        for k in self.order:
            column = S.pop(k)
            pivot = column.pop(k, ca.SX(0))
            inverse[k] = ca.if_else(pivot > DEPENDENT * diagonal[k], 1 / pivot, 0)
            below = sorted(column, key=place.__getitem__)
            L[k] = {row: column[row] * inverse[k] for row in below}
            for n, c in enumerate(below):
                for row in below[n:]:
                    S[c][row] = S[c].get(row, 0) - L[k][row] * column[c]
        return Factor(L, inverse, self.order)

    def _numbers(self, factor: Factor) -> list[ca.SX]:
        return [x for k in factor.order for x in (factor.inverse[k], *factor.L[k].values())]

    def _with(self, factor: Factor, kept: ca.SX) -> Factor:
        """The factor whose numbers are ``kept``, in the order of ``_numbers``."""
        at, L, inverse = 0, {}, {}
        for k in factor.order:
            inverse[k] = kept[at]
            L[k] = {row: kept[at + 1 + n] for n, row in enumerate(factor.L[k])}
            at += 1 + len(L[k])
        return Factor(L, inverse, factor.order)

    def _solve(self, factor: Factor, rhs: Sequence[ca.SX]) -> list[ca.SX]:
        x = list(rhs)
        for k in factor.order:
            for row, entry in factor.L[k].items():
                x[row] = x[row] - entry * x[k]
        for k in reversed(factor.order):
            x[k] = x[k] * factor.inverse[k]
            for row, entry in factor.L[k].items():
                x[k] = x[k] - entry * x[row]
        return x

    def _subtract_rates(self, rows: Rows, w: Sequence[ca.SX], out: list[ca.SX]) -> None:
        """out -= A w"""
        for part, A in zip(self.parts, rows.A, strict=True):
            for b, own in zip(part.body, A, strict=True):
                if own is not None:
                    rate = own @ w[b]
                    for k in range(len(part.rows)):
                        out[part.first + k] = out[part.first + k] - rate[k]

    def _add_loads(self, rows: Rows, x: Sequence[ca.SX], w: list[ca.SX]) -> None:
        """w += M^-1 A^T x"""
        load = [ca.SX.zeros(6) for _ in w]
        for part, A in zip(self.parts, rows.A, strict=True):
            own = _column(x[part.first : part.first + len(part.rows)])
            for b, A_b in zip(part.body, A, strict=True):
                if A_b is not None:
                    load[b] = load[b] + A_b.T @ own
        for b, of in enumerate(load):
            w[b] = w[b] + self._inverse_mass(b, of)


def part_numbers(system: MultibodySystem, joint: int) -> np.ndarray:
    """Numbers of a joint, free of rounding where they are zero."""
    numbers = joint_numbers(system, np.array([joint]))[0]
    for part in (slice(0, 6), slice(6, 12), slice(12, 21)):
        numbers[part] = _snapped(numbers[part])
    return numbers


def _snapped(a: np.ndarray) -> np.ndarray:
    out = np.array(a, dtype=float)
    out[np.abs(out) < NOISE * np.max(np.abs(out), initial=0.0)] = 0.0
    return out


def _matrix(R: ca.SX, b: int) -> ca.SX:
    return ca.reshape(R[9 * b : 9 * b + 9], 3, 3).T


def _turned(R: ca.SX, a: ca.SX) -> ca.SX:
    """R exp(hat(a)) of a correction: series cut at a^18."""
    s: Any = ca.dot(a, a)
    f = g = ca.SX(1)
    for n in range(18, 0, -2):
        f, g = 1 - s * (1.0 / (n * (n + 1))) * f, 1 - s * (1.0 / ((n + 1) * (n + 2))) * g
    hat = ca.skew(a)
    return R @ (ca.SX.eye(3) + f * hat + 0.5 * g * (hat @ hat))


def _column(a: Sequence[ca.SX]) -> ca.SX:
    return ca.densify(ca.vertcat(*a)) if len(a) else ca.SX(0, 1)
