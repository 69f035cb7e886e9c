"""Measure a problem's equations at its start: sizes, operators, the condition of Newton's matrix, and Eq. (32)."""

from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import scipy.linalg as sl
from jaxtyping import Float

from ....catalogue import registry
from ....mechanics.jacobian import constraint_jacobian
from ....mechanics.motion import applied_loads
from ....mechanics.so3 import exp
from ....mechanics.state import State, States
from ....mechanics.system import MultibodySystem
from ....results.records import RunRecord, parse_settings
from ....results.series import Series
from .measures import NAN, measure

STATES = 5  # number of states at which the operators are compared
LITTLE = 1e-6  # step of differences [m, rad, N s]: rounding and the second-order term are both 1e-9 of it


@measure(needs_series=False, until="known", of_problem=True, natural="firm")
def number(record: RunRecord, series: Series | None, of: str) -> float:
    """Return how many bodies, joints, coordinates, constraint rows or degrees of freedom the problem has at its start.

    ``of`` names what is counted: ``bodies``, ``joints``, ``coordinates`` (six per body), ``rows`` or ``freedoms``; any
    other word gives NaN.
    """
    problem = registry.make_problem(record.problem, record.parameters)
    system = problem.system
    if of == "freedoms":
        return float(6 * system.nb - np.linalg.matrix_rank(constraint_jacobian(system, problem.initial).toarray()))
    sizes = {"bodies": system.nb, "joints": len(system.joint_i), "coordinates": 6 * system.nb, "rows": system.nrows}
    return float(sizes.get(of, NAN))


@measure(needs_series=False, until="known", of_problem=True, natural="firm")
def operators(record: RunRecord, series: Series | None, of: str) -> float:
    """Return the largest relative difference of Lagrange's operator, Eq. (45), from that of Newton and Euler.

    Both are evaluated for one body that rotates about its joint, in ``STATES`` random states. ``of`` names the form of
    Lagrange's operator: ``natural basis`` (in Euler angles, converted to the body frame), ``body frame`` (of velocities
    in that frame), or ``corrected`` (the latter with the terms of Eq. (47), c_ki^m p_m v^k, added); any other word
    gives NaN.
    """
    compared = _make_operators(registry.make_problem(record.problem, record.parameters).system)
    random, worst = np.random.default_rng(0), 0.0
    for _ in range(STATES):
        newton, *others = (np.array(x).ravel() for x in compared(*random.uniform(0.3, 1.3, (3, 3))))
        lagrange = dict(zip(("natural basis", "body frame", "corrected"), others, strict=True)).get(of)
        if lagrange is None:
            return NAN
        worst = max(worst, float(np.linalg.norm(newton - lagrange) / np.linalg.norm(newton)))
    return worst


def _make_operators(system: MultibodySystem) -> Any:
    """Return a CasADi function that gives four operators [N m], each (3,) in the body frame, for the first body.

    They are that of Newton and Euler, and Lagrange's in the natural basis, in the body frame, and corrected. The
    arguments are the 3-1-3 angles [rad] and their first and second time derivatives.
    """
    angle, rate, second = (ca.SX.sym(name, 3) for name in ("angle", "rate", "second"))
    arm = system.joint_s_i[0]
    J = ca.DM(system.inertia[0] + system.mass[0] * (arm @ arm * np.eye(3) - np.outer(arm, arm)))

    theta, psi = angle[1], angle[2]
    B = ca.vertcat(
        ca.horzcat(ca.sin(theta) * ca.sin(psi), ca.cos(psi), 0),
        ca.horzcat(ca.sin(theta) * ca.cos(psi), -ca.sin(psi), 0),
        ca.horzcat(ca.cos(theta), 0, 1),
    )  # maps rates of 3-1-3 angles to Omega in the body frame
    Omega = B @ rate
    Omega_dot = B @ second + ca.jacobian(Omega, angle) @ rate
    T = 0.5 * Omega.T @ J @ Omega
    p = ca.jacobian(T, rate).T
    natural = ca.jacobian(p, angle) @ rate + ca.jacobian(p, rate) @ second - ca.jacobian(T, angle).T
    newton = J @ Omega_dot + ca.cross(Omega, J @ Omega)
    body = J @ Omega_dot  # T of the velocities in the body frame does not depend on the angles
    hamel = ca.vertcat(
        *(
            sum(
                (
                    int(k != i) * _structure_constant(i, k, m) * Omega[k] * (J @ Omega)[m]
                    for k in range(3)
                    for m in range(3)
                ),
                0,
            )
            for i in range(3)
        )
    )
    return ca.Function("operators", [angle, rate, second], [newton, ca.solve(B.T, natural), body, body + hamel])


def _structure_constant(i: int, k: int, m: int) -> int:
    """Return the structure constant of the body frame's axes, [e_i, e_k] = sign e_m: 1, -1 or 0."""
    return (i - k) * (k - m) * (m - i) // 2


@measure(needs_series=False, until="known", natural="one")
def condition(record: RunRecord, series: Series | None, of: str) -> float:
    """Return the condition number of the unscaled Newton matrix of a first step, in SI units.

    The length of the step is the run's dt or its limit. ``of`` names the equations: ``ODE-GC``, (74) and (75) for
    velocities and nu, or ``index 3``, the implicit Euler formula for poses, velocities and multipliers, leading terms
    only. NaN for any other word, or if the run has neither a dt nor a step limit.
    """
    h = record.dt_s if record.dt_s == record.dt_s else record.max_step_s
    make = {"ODE-GC": make_newton_matrix, "index 3": make_index3_matrix}.get(of)
    return NAN if make is None or h != h else _compute_condition(make, record.problem, record.problem_parameters, h)


@measure(needs_series=False, until="known", of_problem=True)
def eq_32(record: RunRecord, series: Series | None, of: str) -> float:
    """Return the least M_bar = c . M c or C_bar = -c . (df/dv) c of Eq. (32) over all constraint rows, at the start.

    ``of`` is ``inertia`` for M_bar or ``damping`` for C_bar; any other word gives NaN. For a row a of the constraint
    Jacobian, c is a / (a . a), Eq. (31). Derivatives of the loads f are central differences.
    """
    problem = registry.make_problem(record.problem, record.parameters)
    system, s = problem.system, problem.initial
    A = constraint_jacobian(system, s).toarray()
    c = A / np.sum(A * A, axis=1, keepdims=True)
    if of == "inertia":
        return float(np.min(np.einsum("ai,ij,aj->a", c, _make_mass_matrix(system), c)))
    if of != "damping":
        return NAN
    v, still = _stack_velocities(s), np.zeros(6 * system.nb)
    loads = [_compute_loads(system, _move_pose(s, still, v + sign * LITTLE * row)) for row in c for sign in (1.0, -1.0)]
    slopes = (np.array(loads[::2]) - np.array(loads[1::2])) / (2.0 * LITTLE)
    return float(np.min(-np.sum(slopes * c, axis=1))) + 0.0  # turns -0 into 0


@cache
def _compute_condition(make: object, problem: str, parameters: str, h: float) -> float:
    """Return the condition number of the matrix that ``make`` returns for a problem's start and a step ``h`` [s].

    ``parameters`` are those of the problem as in the record's column, JSON text.
    """
    made = registry.make_problem(problem, parse_settings(parameters))
    return float(np.linalg.cond(make(made.system, made.initial, h)))  # type: ignore[operator]


def make_newton_matrix(system: MultibodySystem, s: State, dt: float) -> Float[np.ndarray, "n n"]:
    """Return the Newton matrix d(residual)/d(v, nu) of the first ODE-GC step, of length ``dt`` [s], with mu0 = 0.

    It is evaluated at the velocities of the start ``s`` and the nu of its loads, by central differences; rotations are
    in body frames.
    """
    v, n = _stack_velocities(s), 6 * system.nb
    A = constraint_jacobian(system, s).toarray()
    nu = -dt * np.linalg.lstsq(A.T, _compute_loads(system, s), rcond=None)[0]
    x = np.concatenate((v, nu))
    moved = [
        _evaluate_residual(system, s, dt, x + sign * LITTLE * e, n) for e in np.eye(len(x)) for sign in (1.0, -1.0)
    ]
    return (np.array(moved[::2]) - np.array(moved[1::2])).T / (2.0 * LITTLE)


def _evaluate_residual(system: MultibodySystem, s: State, dt: float, x: np.ndarray, n: int) -> np.ndarray:
    """Return the residual of a step of ODE-GC from the state ``s``, at the unknowns ``x``: ``n`` velocities, then nu.

    It is (74) with nu0 = 0 and without f_bar [N s, N m s], then phi_dot of (75) [m/s], both at the end of the step of
    ``dt`` [s]. Rotations are in body frames.
    """
    v0, v1, nu = _stack_velocities(s), x[:n], x[n:]
    end = _move_pose(s, 0.5 * dt * (v0 + v1), v1)
    wrench = _compute_wrench(system, end, nu)
    ahead, behind = (_compute_wrench(system, _move_pose(end, sign * LITTLE * v1, v1), nu) for sign in (1.0, -1.0))
    rate = (ahead - behind) / (2.0 * LITTLE)
    before = _rotate_rows(s, _make_mass_matrix(system) @ v0 + 0.5 * dt * _compute_loads(system, s))
    after = _rotate_rows(end, _make_mass_matrix(system) @ v1 - 0.5 * dt * _compute_loads(system, end))
    change = after - before - wrench + 0.5 * dt * rate
    return np.concatenate((_rotate_rows(end, change, back=True), constraint_jacobian(system, end) @ v1))


def make_index3_matrix(system: MultibodySystem, s: State, h: float) -> Float[np.ndarray, "n n"]:
    """Return the Newton matrix of an implicit Euler step of length ``h`` [s] for the index-3 equations, leading terms.

    It is [[I/h, -I, 0], [0, M/h, -A^T], [A, 0, 0]] of q' = u, M u' = f + A^T lam, phi(q) = 0.
    """
    A, M, one = constraint_jacobian(system, s).toarray(), _make_mass_matrix(system), np.eye(6 * system.nb)
    nr, n = A.shape
    return np.block(
        [
            [one / h, -one, np.zeros((n, nr))],
            [np.zeros((n, n)), M / h, -A.T],
            [A, np.zeros((nr, n)), np.zeros((nr, nr))],
        ]
    )


def _make_mass_matrix(system: MultibodySystem) -> np.ndarray:
    """Return the mass matrix of all bodies: masses in space, inertias about C in body frames."""
    blocks = zip(system.mass, system.inertia, strict=True)
    return np.asarray(sl.block_diag(*(x for m, J in blocks for x in (m * np.eye(3), J))))


def _stack_velocities(s: State) -> np.ndarray:
    """Return (v, Omega) of all bodies in one vector, six numbers per body."""
    return np.concatenate((s.v, s.Omega), axis=1).ravel()


def _move_pose(s: State, way: np.ndarray, v: np.ndarray) -> State:
    """Return the state with its pose moved by ``way`` and with the velocities ``v``, vectors with six numbers per body.

    ``way`` holds translations [m] in space and rotation vectors [rad] in the body frame, ``v`` (v, Omega).
    """
    each, own = way.reshape(-1, 6), v.reshape(-1, 6)
    return State(s.r + each[:, :3], s.R @ exp(each[:, 3:]), own[:, :3], own[:, 3:], s.t)


def _compute_loads(system: MultibodySystem, s: State) -> np.ndarray:
    """Return the applied loads [N, N m] in one vector: forces in space, moments in body frames."""
    return np.asarray(applied_loads(system, States.one(s))[0]).ravel()


def _compute_wrench(system: MultibodySystem, s: State, nu: np.ndarray) -> np.ndarray:
    """Return D nu in the space frame: the forces and moments of the constraint rows with multipliers ``nu``."""
    return _rotate_rows(s, constraint_jacobian(system, s).T @ nu)


def _rotate_rows(s: State, wrench: np.ndarray, *, back: bool = False) -> np.ndarray:
    """Return a vector of forces and moments, six numbers per body, with the moments rotated from body frames to space.

    With ``back`` they are rotated from space to body frames. Forces are in space in both cases.
    """
    each = wrench.reshape(-1, 6)
    turned = np.einsum("bji,bj->bi" if back else "bij,bj->bi", s.R, each[:, 3:])
    return np.concatenate((each[:, :3], turned), axis=1).ravel()
