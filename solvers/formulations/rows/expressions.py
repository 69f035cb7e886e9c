"""Constraint rows of joints and loads of forces as CasADi expressions, made from declarations, and their derivatives.

A pose is (r, R by rows), 12 numbers; velocities V = (r_dot [space], Omega [body]); both are given for body i, then for
body j. A pose is displaced by d = (dr, dtheta): r + dr, R exp(hat(dtheta)). With lam the multipliers of the rows::

    phi_dot = A V + phi_t,   gamma = A_dot V + (phi_t)_dot,   W = A^T lam, the load of the rows on both bodies
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from ....harness.mechanics import forces, joints
from ....harness.mechanics.declaring import JointDeclaration, Numbers, PointLoad, Pose, cross
from .numbers import NUMBERS, count_force_parameters
from .numbers import list_force_parameters as list_force_parameters
from .numbers import list_joint_parameters as list_joint_parameters
from .symbols import Symbol


@dataclass(frozen=True)
class RowExpressions:
    """Rows of one kind between two bodies, in the symbols ``x`` (24,), ``V`` (12,), ``t``, ``numbers``, ``lam``."""

    x: ca.SX
    V: ca.SX
    t: ca.SX
    numbers: ca.SX
    lam: ca.SX
    phi: ca.SX  # (n,) zero for rows that restrict velocities alone
    phi_t: ca.SX  # (n,) phi_dot less A V
    A: ca.SX  # (n, 12)
    gamma: ca.SX  # (n,)

    @property
    def phi_dot(self) -> ca.SX:
        """Rate of phi (n,) along the motion."""
        return self.A @ self.V + self.phi_t

    @property
    def load_slopes(self) -> ca.SX:
        """Exact slopes dW/d(pose) (12, 12) of the load W = A^T lam."""
        return differentiate_by_pose(self.A.T @ self.lam, self.x)

    @property
    def rate_slopes(self) -> ca.SX:
        """Exact slopes d(phi_dot)/d(pose) (n, 12)."""
        return differentiate_by_pose(self.phi_dot, self.x)


@dataclass(frozen=True)
class PushExpressions:
    """The load of one kind of force on both bodies (12,): forces in space, torques about C in the body."""

    x: ca.SX
    V: ca.SX
    t: ca.SX
    numbers: ca.SX
    load: ca.SX

    @property
    def pose_slopes(self) -> ca.SX:
        """Exact slopes d(load)/d(pose) (12, 12)."""
        return differentiate_by_pose(self.load, self.x)

    @property
    def velocity_slopes(self) -> ca.SX:
        """Exact slopes d(load)/dV (12, 12)."""
        return ca.densify(ca.jacobian(self.load, self.V))


@cache
def express_rows(kind: str, rows: tuple[int, ...] | None = None, *, space: bool = False) -> RowExpressions:
    """Return the constraint rows of a ``kind`` of joint as expressions: all, or those with indices ``rows``.

    With ``space`` the velocities V are (r_dot, omega = R Omega), else (r_dot, Omega). Rows that restrict velocities
    alone come last, and have phi = 0.
    """
    declared = joints.DECLARED[kind]
    x, V, t, numbers = ca.SX.sym("x", 24), ca.SX.sym("V", 12), ca.SX.sym("t"), ca.SX.sym("p", NUMBERS)
    i, j, p = _make_pose(x, V, 0, space), _make_pose(x, V, 1, space), _name_numbers(declared, numbers, t)
    phi, rates = stack_column(declared.phi(i, j, p)), stack_column(declared.rates(i, j, p))
    x_dot = differentiate_pose(x, V, space=space)
    at, at_dot = ca.vertcat(x, t), ca.vertcat(x_dot, 1)
    full = ca.vertcat(ca.jtimes(phi, at, at_dot), rates)
    phi = ca.vertcat(phi, ca.SX(rates.numel(), 1))
    chosen = list(range(full.numel()) if rows is None else rows)
    full, phi = full[chosen], phi[chosen]
    A = ca.jacobian(full, V)  # does not depend on V: rows are linear in velocities
    rest = ca.substitute(full, V, ca.SX.zeros(12))
    lam = ca.SX.sym("lam", len(chosen))
    gamma = ca.jtimes(full, at, at_dot)
    return RowExpressions(x, V, t, numbers, lam, ca.densify(phi), ca.densify(rest), ca.densify(A), ca.densify(gamma))


@cache
def express_push(kind: str) -> PushExpressions:
    """Return the load of a ``kind`` of force on both bodies as an expression; they are opposite."""
    x, V, t, numbers = (
        ca.SX.sym("x", 24),
        ca.SX.sym("V", 12),
        ca.SX.sym("t"),
        ca.SX.sym("p", count_force_parameters(kind)),
    )
    i, j, (force, torque, point) = express_load(kind, x, V, t, numbers)
    load = []
    for body, sign in ((i, 1.0), (j, -1.0)):
        moment = body.R.T @ (torque + cross(point - body.r, force))
        load += [sign * force, sign * moment]
    return PushExpressions(x, V, t, numbers, ca.densify(stack_column(np.concatenate(load))))


def express_load(kind: str, x: ca.SX, V: ca.SX, t: ca.SX, numbers: ca.SX) -> tuple[Pose, Pose, PointLoad]:
    """Return the poses of both bodies, and the load of a ``kind`` of force on body i: force, torque, point [space].

    ``numbers`` are the symbols of the force's parameters, in the order of ``list_force_parameters``.
    """
    declared = forces.DECLARED[kind]
    i, j = _make_pose(x, V, 0), _make_pose(x, V, 1)
    parts: dict[str, Any] = {}
    at = 0
    for name, shape in declared.numbers.items():
        if name == "factor":
            parts[name] = Symbol(express_time_function(numbers[at : at + 7], t))
            at += 7
            continue
        n = int(np.prod(shape))
        a = _wrap_symbols(numbers[at : at + n]).reshape(shape)
        parts[name] = a if shape else a.item()
        at += n
    return i, j, declared.push(i, j, SimpleNamespace(**parts))


def express_time_function(numbers: ca.SX, t: ca.SX) -> ca.SX:
    """Return c_0 + c_1 t + c_2 t^2 + c_3 t^3 + a sin(w t + p), with the seven ``numbers`` c_0 .. c_3, a, w, p."""
    c0, c1, c2, c3, a, w, p = (numbers[k] for k in range(7))
    return c0 + t * (c1 + t * (c2 + t * c3)) + a * ca.sin(w * t + p)


def differentiate_pose(x: ca.SX, V: ca.SX, *, space: bool = False) -> ca.SX:
    """Return x_dot = (r_dot, R_dot by rows) of both bodies; R_dot = R hat(Omega), with ``space`` hat(omega) R."""
    parts = []
    for e in range(2):
        R = make_matrix(x[12 * e + 3 : 12 * e + 12])
        hat = ca.skew(V[6 * e + 3 : 6 * e + 6])
        parts += [V[6 * e : 6 * e + 3], ca.vec((hat @ R if space else R @ hat).T)]
    return ca.vertcat(*parts)


def differentiate_by_pose(g: ca.SX, x: ca.SX) -> ca.SX:
    """Return the slopes dg/d(pose) (n, 12) of ``g`` (n,), a function of poses ``x``, by (dr, dtheta) of both bodies."""
    d = ca.SX.sym("d", 12)
    return ca.densify(ca.jacobian(g, x) @ ca.jacobian(differentiate_pose(x, d), d))


def _make_pose(x: ca.SX, V: ca.SX, e: int, space: bool = False) -> Pose:
    """Return pose and velocities of body ``e`` (0: i, 1: j) from x (24,) and V (12,), as arrays of symbols.

    The angular velocity is omega in space; V has it with ``space``, else it has Omega in the body.
    """
    R = _wrap_symbols(x[12 * e + 3 : 12 * e + 12]).reshape(3, 3)
    Omega = _wrap_symbols(V[6 * e + 3 : 6 * e + 6])
    return Pose(
        _wrap_symbols(x[12 * e : 12 * e + 3]), R, _wrap_symbols(V[6 * e : 6 * e + 3]), Omega if space else R @ Omega
    )


def _name_numbers(declared: JointDeclaration, a: ca.SX, t: ca.SX) -> Numbers:
    """Return a joint's parameters by name, from their column ``a`` (29,).

    Its function of time is that at ``t``, or zero for a kind of joint without one.
    """
    points, n = _wrap_symbols(a[:12]).reshape(4, 3), _wrap_symbols(a[12:21]).reshape(3, 3)
    f = Symbol(express_time_function(a[22:29], t)) if declared.motion else Symbol(ca.SX(0))
    return Numbers(points[0], points[1], points[2], points[3], n, Symbol(a[21]), f)


def _wrap_symbols(a: ca.SX) -> np.ndarray:
    """Return the entries of a CasADi column as an array of ``Symbol``."""
    return np.array([Symbol(a[k]) for k in range(a.numel())], dtype=object)


def stack_column(a: Sequence[Any] | np.ndarray) -> ca.SX:
    """Return a sequence of numbers and symbols as a CasADi column."""
    return ca.vertcat(*[x.x if isinstance(x, Symbol) else x for x in a]) if len(a) else ca.SX(0, 1)


def make_matrix(a: ca.SX) -> ca.SX:
    """Return the matrix (3, 3) of nine numbers that are given row by row."""
    return ca.reshape(a, 3, 3).T


def list_by_rows(a: ca.SX) -> ca.SX:
    """Return the entries of a matrix, row by row, as a dense column."""
    return ca.vec(ca.densify(a).T)


def find_distinct_entries(Z: ca.SX) -> tuple[list[ca.SX], Callable[[Any], ca.SX]]:
    """Return the distinct entries of a matrix that are not constant, and a function that fills the matrix from them.

    Two entries count as one where they are equal, or opposite, for three random sets of values of the symbols.
    """
    Z = ca.densify(Z)
    symbols = ca.symvar(Z)
    random = np.random.default_rng(1)
    probe = ca.Function("probe", symbols, [Z])
    at = np.stack([np.array(probe(*random.standard_normal(len(symbols)))).reshape(-1, order="F") for _ in range(3)])
    found: list[np.ndarray] = []
    values: list[ca.SX] = []
    which = []
    for c in range(Z.numel()):
        if Z[c].is_constant():
            which.append((0, -1))
            continue
        size = 1e-12 * np.max(np.abs(at[:, c]))
        for known, other in enumerate(found):
            sign = next((g for g in (1, -1) if np.max(np.abs(at[:, c] - g * other)) <= size), 0)
            if sign:
                which.append((sign, known))
                break
        else:
            which.append((1, len(found)))
            found.append(at[:, c])
            values.append(Z[c])

    def fill(kept: Any) -> ca.SX:
        """Return Z with ``kept`` in place of its distinct entries."""
        inside = [sign * kept[known] if sign else Z[c] for c, (sign, known) in enumerate(which)]
        return ca.reshape(ca.vertcat(*inside), *Z.shape)

    return values, fill
