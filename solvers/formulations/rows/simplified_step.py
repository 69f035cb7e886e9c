"""ODE-GC's step by the simplified Newton method (``methods.gc_step``) for one mechanism, as lists of operations."""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from ....harness.mechanics.fixed_order import inverse
from ..generated import GeneratedFunction
from .expressions import differentiate_pose, express_rows, make_matrix
from .mechanism import (
    JointPart,
    SymbolicMechanism,
    SymbolicState,
    join_ends,
    list_exact_joint_parameters,
    make_column,
    multiply_row,
    snap_zeros,
)
from .wrenches import distinct_entries, measure_rows_in_space

IN_A_PRODUCT = 16  # ratios of pivots, each above 1e-9, of which one logarithm is taken


class SimplifiedStep(SymbolicMechanism):
    """The functions of a step for a system of spherical and revolute joints under gravity."""

    def make_functions(  # type: ignore[override]
        self, *, gauge: float, b_term: float, direction: int, use_f_bar: int, keep_nu: int
    ) -> tuple[dict[str, GeneratedFunction], list[int]]:
        """Return the functions of a step, and the numbers of entries kept of the start and of the factor.

        ``begin`` (t, plan, r, R, v, nu_start) -> (known, kept, slip, f_bar) at the start of a step;
        ``factor`` (t, r, R) -> (factor, (rank, log10 det S over its diagonal)), where rows are chosen
        (t, r, R, bounds) -> (factor, found, inverse shares), with ``couple`` (t, r, R) -> scaled S;
        ``iterate`` (t, plan, r, R, v, known, kept, nu, factor) -> (v, nu, (change^2,)) at the end;
        ``correct`` (t, r, R, factor) -> (r, R); ``copy`` (v, nu) and ``copy_poses`` (r, R).
        """
        nb, n, at, plan = self.system.nb, len(self.order), self.state(), ca.SX.sym("plan", 3)
        half = plan[0]
        B = b_term * half
        nu, nu_start, known = ca.SX.sym("nu", n), ca.SX.sym("nu_start", n), ca.SX.sym("known", 6 * nb)
        spun = at._replace(
            v=ca.vertcat(
                *[
                    ca.vertcat(v[:3], make_matrix(at.R[9 * b : 9 * b + 9]) @ v[3:])
                    for b, v in enumerate(ca.vertsplit(at.v, 6))
                ]
            )
        )
        first, w = self._momenta(at, half), [known[6 * b : 6 * b + 6] for b in range(nb)]
        values: list[ca.SX] = []
        starts: list[Callable[[Any], ca.SX]] = []
        f_bars, slips = [ca.SX(0)] * n, [ca.SX(0)] * n
        wrenches = [_wrenches(part.kind, part.of, part.body[1] >= 0, direction) for part in self.parts]
        given = [self._list_inputs(spun, part) for part in self.parts]
        for part, wrench, at_start in zip(self.parts, wrenches, given, strict=True):
            Z, D, f_bar, slip = wrench(*at_start, B)
            load = D @ (-half * f_bar) if use_f_bar else ca.SX.zeros(Z.shape[0])
            if keep_nu:
                load -= Z @ nu_start[_slice_rows(part)]
            _add_load(first, part, load)
            own, filled = distinct_entries(Z)
            starts.append(_skip_first(filled, len(values)))
            values += own
            for k in range(len(part.of)):
                f_bars[part.first + k], slips[part.first + k] = f_bar[k] if use_f_bar else ca.SX(0), slip[k]
        kept = ca.SX.sym("kept", max(1, len(values)))
        for part, wrench, at_end, start in zip(self.parts, wrenches, given, starts, strict=True):
            Z, D, f_bar, _ = wrench(*at_end, -B)
            own, filled = distinct_entries(Z - gauge * start(kept) if gauge else Z)
            load = filled(own) @ nu[_slice_rows(part)]
            _add_load(w, part, load - half * (D @ f_bar) if use_f_bar else load)

        rows = self._rows(at)
        poses = [at.t, at.r, at.R]
        factor, shares, couple = self._make_factor(rows, poses)
        free = [
            self._divide_by_mass(b, ca.vertcat(p[:3], make_matrix(at.R[9 * b : 9 * b + 9]).T @ p[3:]))
            for b, p in enumerate(w)
        ]
        whole = [factor.inverse[k] > 0 for k in self.order]
        ratios = [ca.if_else(whole[c], factor.pivots[c] / factor.diagonal[k], 1) for c, k in enumerate(self.order)]
        products = [_multiply(ratios[c : c + IN_A_PRODUCT]) for c in range(0, n, IN_A_PRODUCT)]
        log_det = sum((ca.log(x) for x in products), ca.SX(0)) / np.log(10.0)
        found = ca.vertcat(sum(whole, ca.SX(0)), log_det)
        numbers = factor.exchange_numbers()
        told = ca.SX.sym("factor", numbers.numel())
        factor.exchange_numbers(told)
        x = factor.solve({k: -multiply_row(row, free) for k, row in rows.items()})
        v = self._add_response(free, rows, x)
        square = sum(
            (self._energy(b, a - o) for b, (a, o) in enumerate(zip(v, ca.vertsplit(at.v, 6), strict=True))), ca.SX(0)
        )
        change = make_column([x[k] for k in range(n)])
        closed = self._close_joints(at, rows, factor)
        return {
            "begin": GeneratedFunction(
                [at.t, plan, at.r, at.R, at.v, nu_start],
                [
                    ca.vertcat(*first),
                    ca.vertcat(*values) if values else ca.SX(1, 1),
                    *map(make_column, (slips, f_bars)),
                ],
            ),
            "factor": GeneratedFunction([*poses, *self._bounds], [numbers, found, *shares]),
            **couple,
            "iterate": GeneratedFunction(
                [at.t, plan, *poses[1:], at.v, known, kept, nu, told],
                [ca.vertcat(*v), nu + change * (1.0 / (1.0 - gauge)), square],
            ),
            "correct": GeneratedFunction([*poses, told], [closed.r, closed.R]),
            "copy": GeneratedFunction([at.v, nu], [at.v, nu]),
            "copy_poses": GeneratedFunction(poses[1:], poses[1:]),
        }, [kept.numel(), numbers.numel()]

    def _momenta(self, at: SymbolicState, half: ca.SX) -> list[ca.SX]:
        """Return (m r_dot + dt m g, R J Omega) of each body: momenta in space plus the impulse of gravity."""
        s, out = self.system, []
        for b, v in enumerate(ca.vertsplit(at.v, 6)):
            weight = 2.0 * half * ca.SX(ca.DM(s.mass[b] * s.gravity))
            spin = make_matrix(at.R[9 * b : 9 * b + 9]) @ (self._inertia(b) @ v[3:])
            out.append(ca.vertcat(s.mass[b] * v[:3] + weight, spin))
        return out

    def _energy(self, b: int, v: ca.SX) -> ca.SX:
        """Return v . M v of body ``b``, twice the kinetic energy at its velocities ``v`` (6,)."""
        return self.system.mass[b] * ca.dot(v[:3], v[:3]) + ca.dot(v[3:], self._inertia(b) @ v[3:])

    def _inertia(self, b: int) -> ca.DM:
        """Return the inertia of body ``b`` about C, with exact zeros instead of rounding."""
        return ca.sparsify(ca.DM(snap_zeros(self.system.regular_inertia[b])))

    def _list_inputs(self, spun: SymbolicState, part: JointPart) -> list[Any]:
        """Return the inputs of ``_wrenches``, except B, for the rows of a joint; ``spun`` has velocities in space."""
        s, bodies = self.system, []
        for b in part.body:
            J = snap_zeros(s.regular_inertia[max(b, 0)]), snap_zeros(inverse(s.regular_inertia[max(b, 0)]))
            numbers = s.mass[b] * s.gravity, s.mass[b : b + 1], J[1].ravel(), J[0].ravel()
            bodies.append(ca.DM(np.concatenate(numbers)) if b >= 0 else ca.DM.zeros(22))
        return [*join_ends(spun, part.body), spun.t, list_exact_joint_parameters(s, part.joint), *bodies]


@cache
def _wrenches(kind: str, of: tuple[int, ...], both: bool, direction: int) -> ca.Function:
    """Return the wrenches of a kind of joint's rows as a CasADi function of poses, spatial velocities, numbers and B.

    It returns Z = D + B D_dot (6 or 12, n), D, f_bar and M_bar phi_dot^2; ``both``: of two bodies, none the ground.
    """
    e, x, B = express_rows(kind, of, space=True), ca.SX.sym("x", len(of)), ca.SX.sym("B")
    numbers, ends = [ca.SX.sym(f"numbers_{end}", 22) for end in "ij"], 2 if both else 1
    rate = ca.jtimes(e.A.T @ x, ca.vertcat(e.x, e.t), ca.vertcat(differentiate_pose(e.x, e.V, space=True), 1))
    m_bar, f_bar = measure_rows_in_space(e, [[a, a, a, a] for a in numbers[:ends]], direction)
    D = e.A.T[: 6 * ends, :]
    Z = D + B * ca.jacobian(rate, x)[: 6 * ends, :]
    given = [e.x, e.V, e.t, e.numbers, *numbers, B]
    return ca.Function("wrenches", given, [Z, D, f_bar, m_bar * e.phi_dot**2])


def _slice_rows(part: JointPart) -> slice:
    """Return the slice of a joint's rows among the kernel's."""
    return slice(part.first, part.first + len(part.of))


def _add_load(w: list[ca.SX], part: JointPart, load: ca.SX) -> None:
    """Add the ``load`` of a joint to the entries of its bodies in ``w``, which is changed."""
    for e, b in enumerate(part.body):
        if b >= 0:
            w[b] = w[b] + load[6 * e : 6 * e + 6]


def _skip_first(filled: Callable[[Any], ca.SX], first: int) -> Callable[[Any], ca.SX]:
    """Return ``filled`` as a function of all entries, of which those that it reads begin at ``first``."""
    return lambda kept: filled(kept[first:])


def _multiply(factors: Sequence[ca.SX]) -> Any:
    """Return the product of ``factors``, 1 if there are none."""
    out: Any = 1
    for x in factors:
        out = out * x
    return out
