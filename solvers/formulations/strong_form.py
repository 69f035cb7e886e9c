"""Eq. (65): accelerations and lam_ddot of the strong form, with M_bar, C_bar, K_bar, f_bar of Eqs. (30)-(32).

    M u_dot + h - f - A^T F = 0,  F = M_bar lam_ddot + M_bar_dot lam_dot + C_bar lam_dot + K_bar lam - f_bar
    M_bar phi_ddot + (M_bar_dot + C_bar) phi_dot + K_bar phi = 0

Solved for (u_dot, F) first: F is the reaction, and lam_ddot follows row by row. So lam and lam_dot are quadratures;
they act on nothing, and with C_bar = K_bar = 0 (no springs, no dampers, none given) and phi_dot = 0 the acceleration is
that of plain index 1 without stabilisation. Here f_bar = c . f and C_bar = -c^T df/dV c, K_bar = -c^T df/dx c per row,
diagonal as in Eq. (35), in the coordinate-free velocities V.
"""

from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from jaxtyping import Float

from ...harness.base.code_meter import making_code
from ...harness.base.generated import Code, Loop, Program, compile_functions
from ...harness.base.generated.steps import add_products, set_to_zero
from ...harness.mechanics.system import GROUND
from .assembly import Assembly, Batch
from .layout import Layout
from .rows.expressions import list_force_parameters
from .saddle import InverseMass, Saddle
from .sparse_pattern import FixedPattern
from .symbolic import ELEMENTS, make_spring_derivative_element, make_strong_row_element
from .system_elements import (
    find_jacobian_pattern,
    index_pair_ends,
    iterate_joint_kinds,
    make_body_batch,
    make_force_batches,
)


class StrongRates(NamedTuple):
    """The solution of Eq. (65): p_dot, u_dot, lam_ddot and the reaction F."""

    p_dot: Float[np.ndarray, " n_p"]
    u_dot: Float[np.ndarray, " n_u"]
    lam_ddot: Float[np.ndarray, " k"]
    reaction: Float[np.ndarray, " k"]  # reaction of the kept rows


class RowTerms(NamedTuple):
    """The diagonals of Eq. (65) on the kept rows, and A (k, n_u) as nonzeros of ``StrongForm.pattern``."""

    p_dot: Float[np.ndarray, " n_p"]
    e: Float[np.ndarray, " n_u"]  # h - f
    A: Float[np.ndarray, " nnz"]
    gamma: Float[np.ndarray, " k"]  # A_dot u
    phi_dot: Float[np.ndarray, " k"]
    phi: Float[np.ndarray, " k"]
    M_bar: Float[np.ndarray, " k"]
    M_bar_dot: Float[np.ndarray, " k"]
    C_bar: Float[np.ndarray, " k"]
    K_bar: Float[np.ndarray, " k"]
    f_bar: Float[np.ndarray, " k"]


class StrongForm:
    """Eq. (65) on the kept rows, with optional Baumgarte terms; it owns its arrays: use one instance for each run.

    What Eqs. (31), (32) leave open are arguments: the ``direction`` of c, and ``c_bar`` [kg/s] and ``k_bar`` [N/m] of
    point rows, which are added to those of Eq. (32).
    """

    def __init__(
        self,
        layout: Layout,
        alpha: float = 0.0,
        beta: float = 0.0,
        direction: str = "a",
        c_bar: float = 0.0,
        k_bar: float = 0.0,
    ) -> None:
        """Assemble the terms of Eq. (65) and prepare its solution; ``alpha`` and ``beta`` [1/s] are Baumgarte's."""
        self._layout = layout
        self._bare = Layout(layout.system, layout.chart, np.zeros(0, dtype=np.int64))  # z has no lam here
        self._direction, self._given = direction, (c_bar, k_bar)
        self.pattern, place = find_jacobian_pattern(layout)
        self._slices, n_out = _slice_outputs(layout, self.pattern.nnz)
        self._motion = Assembly(self._bare, self._make_batches(layout, place), n_out, differentiable=False)
        self._at_rest = np.zeros(layout.n_u)
        s = layout.system
        self._gravity = np.concatenate((s.mass[:, None] * s.gravity, np.zeros((s.nb, 3))), axis=1).ravel()
        self._springs = _Springs(self._bare) if len(s.spring_k) else None
        loads = make_force_batches(self._bare, in_chart=False)
        loaded = any(len(b.z) for b in loads)
        self._loads = Assembly(self._bare, loads, layout.n_u, differentiable=False) if loaded else None
        *of_motion, self._of_c = (self._motion.out[part] for part in self._slices)
        own = [np.zeros(layout.k) for _ in range(3)]
        self._f = self._gravity.copy()
        self._at = at = RowTerms(*of_motion, *own)
        at.C_bar[:], at.K_bar[:] = c_bar, k_bar
        c, self._lam, self._lam_dot, self._F, self._lam_ddot = (np.zeros(layout.k) for _ in range(5))
        self._saddle = Saddle(layout, self.pattern, InverseMass(layout, self._motion.y), at.A, at.e, c)
        terms = self.pattern.rows, self.pattern.columns
        count, code = np.array([layout.k]), _compile_rows(alpha, beta)
        shared = [at.phi, at.phi_dot, at.M_bar, at.M_bar_dot, at.C_bar, at.K_bar]
        self._before = Program(
            [
                set_to_zero(at.f_bar),
                add_products(self._of_c, np.arange(self.pattern.nnz), self._f, terms[1], at.f_bar, terms[0]),
                (code.address("right"), [count, *shared, at.gamma, c]),
            ],
            code,
        )
        outer = self._lam, self._lam_dot, self._F
        self._after = Program([(code.address("lam_ddot"), [count, *shared, *outer, at.f_bar, self._lam_ddot])], code)

    def terms(self, pu: Float[np.ndarray, " n"], t: float = 0.0) -> RowTerms:
        """Evaluate all terms of Eq. (65) at ``pu`` = (p, u) and time ``t`` [s], and return a copy of them."""
        self._evaluate(pu, t)
        return RowTerms(*(part.copy() for part in self._at))

    def all_rows(self, reaction: Float[np.ndarray, " k"]) -> Float[np.ndarray, " nrows"]:
        """Return ``reaction`` as a vector over all rows of phi, zero on the dropped ones."""
        return self._layout.all_rows(reaction)

    def rates(
        self,
        pu: Float[np.ndarray, " n"],
        lam: Float[np.ndarray, " k"],
        lam_dot: Float[np.ndarray, " k"],
        t: float = 0.0,
    ) -> StrongRates:
        """Solve Eq. (65) for p_dot, u_dot, lam_ddot and the reaction; ``pu`` are (p, u), ``t`` is in s.

        The results are arrays that the next call overwrites. Raises ``StepFailure`` where the kept rows are dependent.
        """
        self._evaluate(pu, t)
        u_dot, F = self._saddle.solve()
        self._lam[:], self._lam_dot[:], self._F[:] = lam, lam_dot, F
        self._after.run()
        return StrongRates(self._at.p_dot, u_dot, self._lam_ddot, self._F)

    def _evaluate(self, pu: np.ndarray, t: float) -> None:
        """Evaluate the terms of Eq. (65) at ``pu`` = (p, u) and time ``t`` [s], and the right side of the system.

        C_bar and K_bar of springs are added to those given; a negative K_bar is set to zero.
        """
        self._motion.set_inputs(pu, self._at_rest, t)
        self._motion.evaluate.run()
        if self._loads is not None:
            np.add(self._gravity, self._loads.values(pu, self._at_rest, t), out=self._f)
        if self._springs is not None:
            c = self.pattern.make_matrix(self._of_c)
            rows = self._at.C_bar, self._at.K_bar
            for to, least, slope in zip(rows, self._given, self._springs.compute_slopes(pu), strict=True):
                to[:] = least + np.asarray((c @ slope).multiply(c).sum(axis=1)).ravel()
            np.maximum(self._at.K_bar, 0.0, out=self._at.K_bar)  # a negative value would drive phi away exponentially
        self._before.run()

    def _make_batches(self, layout: Layout, place: np.ndarray) -> list[Batch]:
        """Return the batches of bodies, forces and joints, whose outputs go to ``self._slices``.

        ``place`` is the index of the nonzero of A to which each entry of the joints' rows is added, -1 if dropped.
        """
        bare = self._bare
        A, gamma, phi_dot, phi, M_bar, M_bar_dot, c = (part.start for part in self._slices[2:])
        batches, used = [make_body_batch(bare), *make_force_batches(bare)], 0
        for of in iterate_joint_kinds(bare):
            inertia, moves = (_list_inertias(layout, b) for b in (of.i, of.j)), (of.j != GROUND)[:, None].astype(float)
            row = layout.index_rows(of.rows)
            entries = place[used : used + 12 * row.size].reshape(len(row), 12 * row.shape[1])
            used += entries.size
            parts = [(A, entries), *((start, row) for start in (gamma, phi_dot, phi, M_bar, M_bar_dot)), (c, entries)]
            out = np.concatenate([np.where(index < 0, -1, start + index) for start, index in parts], axis=1)
            parameters = np.concatenate((of.numbers, *inertia, moves), axis=1)
            z = np.concatenate((of.ends.z, of.ends.t), axis=1)
            element = make_strong_row_element(of.kind, layout.chart, self._direction)
            batches.append(Batch(element, parameters, z, of.ends.w, out))
        return batches


@lru_cache(ELEMENTS)
@making_code
def _compile_rows(alpha: float, beta: float) -> Code:
    """Compile the scalar formulas of Eq. (65), row by row: "right", the constraint row at u_dot = 0, and "lam_ddot".

    ``alpha`` and ``beta`` [1/s] are Baumgarte's, added to "right".
    """
    names = ("phi", "phi_dot", "M_bar", "M_bar_dot", "C_bar", "K_bar", "gamma", "lam", "lam_dot", "F", "f_bar")
    phi, phi_dot, M_bar, M_bar_dot, C_bar, K_bar, gamma, lam, lam_dot, F, f_bar = (ca.SX.sym(name) for name in names)
    shared = [phi, phi_dot, M_bar, M_bar_dot, C_bar, K_bar]
    drift = ((M_bar_dot + C_bar) * phi_dot + K_bar * phi) / M_bar
    c = gamma + drift + 2.0 * alpha * phi_dot + beta**2 * phi
    lam_ddot = (F - (M_bar_dot + C_bar) * lam_dot - K_bar * lam + f_bar) / M_bar
    return compile_functions(
        {
            "right": Loop(rows=[*shared, gamma], stored=[c]),
            "lam_ddot": Loop(rows=[*shared, lam, lam_dot, F, f_bar], stored=[lam_ddot]),
        }
    )


class _Springs:
    """The derivatives of the forces of all springs by velocities V and by poses."""

    def __init__(self, bare: Layout) -> None:
        """Assemble the two slopes (12, 12) of each spring into sparse matrices; columns of the ground are left out."""
        s, n = bare.system, bare.n_u
        ends = index_pair_ends(bare, s.spring_i, s.spring_j)
        at, z = ends.free, np.concatenate((ends.z, ends.t), axis=1)
        row = np.broadcast_to(at[:, None, :], (len(at), 12, 12)).reshape(len(at), -1)  # by columns
        column = np.broadcast_to(at[:, :, None], (len(at), 12, 12)).reshape(len(at), -1)
        keep = ((row >= 0) & (column >= 0)).ravel()
        self._pattern = FixedPattern(row.ravel()[keep], column.ravel()[keep], (n, n))
        entry, self._m = np.where(keep, np.cumsum(keep) - 1, -1).reshape(len(at), -1), int(keep.sum())
        out = np.concatenate((entry, np.where(entry < 0, -1, self._m + entry)), axis=1)
        batch = Batch(make_spring_derivative_element(bare.chart), list_force_parameters(s, "spring"), z, ends.w, out)
        self._slopes, self._at_rest = Assembly(bare, [batch], 2 * self._m, differentiable=False), np.zeros(n)

    def compute_slopes(self, pu: np.ndarray) -> tuple[Any, Any]:
        """Return -df/dV and -df/dx of all springs at ``pu`` = (p, u), as two sparse matrices (n_u, n_u).

        A change dx of pose is a displacement along V, in m and rad.
        """
        found, of = self._slopes.values(pu, self._at_rest), self._pattern
        return of.make_matrix(of.sum_entries(found[: self._m])), of.make_matrix(of.sum_entries(found[self._m :]))


def _slice_outputs(layout: Layout, nnz: int) -> tuple[list[slice], int]:
    """Return the slices of the assembly's output by quantity, and its length.

    The quantities are those of ``RowTerms`` up to M_bar_dot, then c of Eq. (31); A and c have ``nnz`` entries.
    """
    k = layout.k
    ends = np.cumsum((0, layout.n_p, layout.n_u, nnz, k, k, k, k, k, nnz))
    return [slice(int(a), int(b)) for a, b in pairwise(ends)], int(ends[-1])


def _list_inertias(layout: Layout, bodies: np.ndarray) -> np.ndarray:
    """Return mass and inertia of ``bodies`` as rows (10,): m, then J by rows; 1 and the identity for the ground."""
    s = layout.system
    table = np.tile(np.append(1.0, np.eye(3)), (s.nb + 1, 1))
    table[: s.nb, 0], table[: s.nb, 1:] = s.mass, s.regular_inertia.reshape(-1, 9)
    return table[bodies]  # the ground is -1: the last
