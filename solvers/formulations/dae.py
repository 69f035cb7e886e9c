"""Eqs. (92)-(94) as F(t, y, y') = 0 with y = (p, u, lam), in five forms, with exact sparse Jacobians.

    p'  - G(p) u = 0
    M u' + h - f - A^T lam = 0
    fi  A u' + gamma + 2 alpha phi_dot + beta^2 phi = 0             the derivative stays in the row
    se  A w + gamma + 2 alpha phi_dot + beta^2 phi = 0,  w = M^-1 (f - h + A^T lam)   semi-explicit
    position   phi = 0                                              index 3
    velocity   A u + alpha phi = 0                                  index 2
    both       phi = 0, A u = 0, and p' - G(p) (u + A^T eta) = 0    index 2, Gear, Gupta, Leimkuhler (1985)

"both" has y = (p, u, lam, eta), a ``StabilisedLayout`` layout; its solution has eta = 0. All have the same solutions;
they differ in what an integrator's error test and Newton iteration see.
"""

from functools import cache

import casadi as ca
import numpy as np
from jaxtyping import Bool, Float

from ...harness.base.code_meter import making_code
from ...harness.base.generated import Code, Loop, Program, compile_functions
from ...harness.base.generated.steps import Step, add_products, set_to_zero, take, take_negative
from .assembly import Assembly
from .layout import Layout
from .saddle import InverseMass
from .sparse_pattern import FixedPattern, FixedProduct
from .system_elements import assemble_equations


class ImplicitForm:
    """F(t, y, y') and its Jacobian; ``form`` is "fi", "se", "position", "velocity" or "both" (see the module).

    ``evaluate`` is a program that computes ``F`` from ``y``, ``y_dot`` and ``t``, arrays that machine code may fill.
    The instance owns these arrays: use one instance for each run.
    """

    def __init__(self, layout: Layout, form: str, alpha: float, beta: float) -> None:
        """Assemble the equations of ``form``, and prepare programs of F and of its Jacobian.

        ``alpha`` and ``beta`` [1/s] are Baumgarte's, where the form has them.
        """
        level = "acceleration" if form in ("fi", "se") else form
        self._motion = motion = assemble_equations(layout, level, alpha, beta, differentiable=True)
        self.y, self.t, self.y_dot, self.F = motion.y, motion.t, np.zeros(layout.n), np.zeros(layout.n)
        p, lam, n_u, rest = layout.p, layout.lam, layout.n_u, np.arange(layout.n_p, layout.n)
        at_u_dot = [take(self.y_dot[layout.u], np.arange(n_u), motion.w), motion.evaluate.step]
        rates = (
            _compile_subtraction().address("subtract"),
            [np.array([layout.n_p]), self.y_dot[p], motion.out[p], self.F[p]],
        )
        steps = [*at_u_dot, rates, take(motion.out, rest, self.F[layout.n_p :])]
        # the constraint rows of "se" are those at the accelerations w(y), not at the given u'
        semi = _SemiExplicit(layout, motion, self.y_dot) if form == "se" else None
        if semi is not None:
            last = np.arange(lam.start, lam.stop)
            steps += [*semi.to_accelerations, motion.evaluate.step, take(motion.out, last, self.F[lam])]
        self._parts = parts = semi or _Direct(layout, motion)
        self.evaluate = Program(steps, (motion, _compile_subtraction(), parts))
        self._differentiate = Program([*at_u_dot, *parts.steps], (motion, parts))
        self.difference_evaluations = 0  # evaluations of F spent on Jacobians by differences

    @property
    def pattern(self) -> FixedPattern:
        """Sparsity pattern, column by column, that dF/dy and dF/dy' share."""
        return self._parts.pattern

    @property
    def structure(self) -> tuple[Bool[np.ndarray, " nnz"], Bool[np.ndarray, " nnz"]]:
        """Flags of the nonzeros of ``pattern`` that occur in dF/dy, and of those that occur in dF/dy'."""
        return self._parts.structure

    def residual(
        self, y: Float[np.ndarray, " n"], y_dot: Float[np.ndarray, " n"], t: float = 0.0
    ) -> Float[np.ndarray, " n"]:
        """Evaluate F(t, y, y') and return a copy of it; t matters where drives or loads are functions of time."""
        self.y[:], self.y_dot[:], self.t[0] = y, y_dot, t
        self.evaluate.run()
        return self.F.copy()

    def jacobian(
        self, y: Float[np.ndarray, " n"], y_dot: Float[np.ndarray, " n"], t: float = 0.0
    ) -> tuple[Float[np.ndarray, " nnz"], Float[np.ndarray, " nnz"]]:
        """Return the nonzeros of (dF/dy, dF/dy') in ``pattern``, in arrays that the next call overwrites."""
        self.y[:], self.y_dot[:], self.t[0] = y, y_dot, t
        self._differentiate.run()
        return self._parts.of_y, self._parts.of_y_dot


class _Direct:
    """The Jacobian of every form except "se": derivatives of the elements, with their signs and positions."""

    def __init__(self, layout: Layout, motion: Assembly) -> None:
        """Prepare the steps that evaluate dF/dy and dF/dy' from the derivatives of ``motion``."""
        row, column = motion.row, motion.column
        self._set_pattern(layout, motion, np.flatnonzero((row >= 0) & (column >= 0)), np.zeros((0, 2), dtype=np.int64))
        self._set_data(0)
        self._add = motion.make_derivative_program(self._data, self._place, self._sign)
        self.steps = [self._reset, self._add.step]

    def _set_pattern(self, layout: Layout, motion: Assembly, used: np.ndarray, more: np.ndarray) -> None:
        """Set the sparsity pattern that dF/dy and dF/dy' share, and the position of each entry in it.

        Entries are the derivatives of ``motion`` with indices ``used``, additional ones of dF/dy at ``more`` (m, 2),
        rows and columns, and the ones on the diagonal of dF/dy' that belong to p'.
        """
        row, column, of_w, every = motion.row[used], motion.column[used], motion.of_w[used], np.arange(layout.n_p)
        self.pattern = FixedPattern(
            np.concatenate((row, more[:, 0], every)),
            np.concatenate((np.where(of_w, layout.n_p + column, column), more[:, 1], every)),
            (layout.n, layout.n),
            by_column=True,
        )
        own, self._more, self._of_p_dot = np.split(self.pattern.place, (len(used), len(used) + len(more)))
        self._place = np.full(len(motion.row), -1)
        self._place[used] = np.where(of_w, self.pattern.nnz, 0) + own
        self._sign = np.where(motion.row < layout.n_p, -1.0, 1.0)
        entries = np.concatenate((self._place[used], self._more, self.pattern.nnz + self._of_p_dot))
        of_y, of_y_dot = np.isin(np.arange(2 * self.pattern.nnz), entries).reshape(2, -1)
        self.structure = of_y, of_y_dot

    def _set_data(self, more: int) -> None:
        """Allocate one array for dF/dy, dF/dy', ``more`` further values and a dummy, and make the step that resets it.

        The step sets all to zero but dF/dy' of p', which is the identity.
        """
        nnz = self.pattern.nnz
        at_rest = np.zeros(2 * nnz + more + 1)
        at_rest[nnz + self._of_p_dot] = 1.0  # dF/dy' of p'
        self._data = at_rest.copy()
        self.of_y, self.of_y_dot = self._data[:nnz], self._data[nnz : 2 * nnz]
        self._reset = take(at_rest, np.arange(len(at_rest)), self._data)


class _SemiExplicit(_Direct):
    """The Jacobian of form "se": its constraint rows are c at w(y), with dw/dy = -M^-1 de/dy."""

    def __init__(self, layout: Layout, motion: Assembly, y_dot: Float[np.ndarray, " n"]) -> None:
        """Prepare the steps that evaluate and multiply A, e and M^-1; ``y_dot`` is the form's array of rates."""
        row, column, of_w = motion.row, motion.column, motion.of_w
        first_c, used = layout.n_p + layout.n_u, (row >= 0) & (column >= 0)
        # A = dc/dw and de/d(p, u, lam) are kept apart, behind dF/dy and dF/dy' in the data, to form A M^-1 de
        of_A = np.flatnonzero(used & (row >= first_c) & of_w)
        of_e = np.flatnonzero(used & (row >= layout.n_p) & (row < first_c) & ~of_w)
        A = FixedPattern(row[of_A] - first_c, column[of_A], (layout.k, layout.n_u))
        e = FixedPattern(row[of_e] - layout.n_p, column[of_e], (layout.n_u, layout.n))
        self._inverse_mass = W = InverseMass(layout, motion.y)
        AW = FixedProduct(A, W.pattern)
        AWe = FixedProduct(AW.pattern, e)
        product = np.stack((first_c + AWe.pattern.rows, AWe.pattern.columns), axis=1)
        self._set_pattern(layout, motion, np.flatnonzero(used & ((row < first_c) | ~of_w)), product)
        self._set_data(A.nnz + e.nnz)
        start = 2 * self.pattern.nnz
        # rows of p' and e at the given u' first; then, at w(y), the constraint rows, A and de
        upper = np.where(row < first_c, self._place, -1)
        lower = np.where(row >= first_c, self._place, -1)
        lower[of_A], lower[of_e] = start + A.place, start + A.nnz + e.place
        self._add, self._add_at_w = (
            motion.make_derivative_program(self._data, place, self._sign) for place in (upper, lower)
        )
        minus_e, AW_data, minus = np.zeros(layout.n_u), np.zeros(AW.pattern.nnz), np.zeros(AW.pattern.nnz)
        out, rows, columns = motion.out[layout.u], W.pattern.rows, W.pattern.columns
        self.to_accelerations: list[Step] = [  # w = u' - M^-1 e from e = M u' + h - f - A^T lam
            *W.steps,
            take_negative(out, np.arange(layout.n_u), minus_e),
            take(y_dot[layout.u], np.arange(layout.n_u), motion.w),
            add_products(W.data, W.places, minus_e, columns, motion.w, rows),
        ]
        self.steps = [
            self._reset,
            self._add.step,
            *self.to_accelerations,
            self._add_at_w.step,
            set_to_zero(AW_data),
            add_products(self._data, start + AW.p, W.data, W.places[AW.q], AW_data, AW.pattern.place),
            take_negative(AW_data, np.arange(len(AW_data)), minus),
            add_products(minus, AWe.p, self._data, start + A.nnz + AWe.q, self._data, self._more[AWe.pattern.place]),
        ]


@cache
@making_code
def _compile_subtraction() -> Code:
    """Compile the loop that stores a - b, entry by entry."""
    a, b = ca.SX.sym("a"), ca.SX.sym("b")
    return compile_functions({"subtract": Loop(rows=[a, b], stored=[a - b])})
