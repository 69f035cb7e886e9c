"""Measures of the equations at a problem's start: the condition of Newton's matrix at a step, and Eq. (32)."""

import json
from functools import cache

import numpy as np
import scipy.linalg as sl
from jaxtyping import Float

from ...catalogue import registry
from ...mechanics.jacobian import constraint_jacobian
from ...mechanics.motion import applied_loads
from ...mechanics.so3 import exp
from ...mechanics.state import State, States
from ...mechanics.system import MultibodySystem
from ...results.records import RunRecord
from ...results.series import Series
from .measures import NAN, measure

LITTLE = 1e-6  # of a difference quotient [m, rad, N s]: rounding and the second order both leave 1e-9 of it


@measure("of", series=False, until="known", natural="one")
def condition(record: RunRecord, series: Series | None, of: str) -> float:
    """Condition number of the unscaled Newton matrix at the run's step or step limit, in SI units.

    ``ODE-GC``: of (74), (75) for velocities and nu at the start. ``index 3``: of one step of the implicit Euler formula
    for poses, velocities and multipliers, its leading terms.
    """
    h = record.dt_s if record.dt_s == record.dt_s else record.max_step_s
    make = {"ODE-GC": newton_matrix, "index 3": index3_matrix}.get(of)
    return NAN if make is None or h != h else _condition(make, record.problem, record.problem_parameters, h)


@measure("of", series=False, until="known", of_problem=True)
def eq_32(record: RunRecord, series: Series | None, of: str) -> float:
    """The least of any row at the start: its ``inertia`` M_bar = c . M c, or its ``damping`` C_bar = -c . (df/dv) c.

    c is a/(a . a), Eq. (31).
    """
    problem = registry.make_problem(record.problem, json.loads(record.problem_parameters))
    system, s = problem.system, problem.initial
    A = constraint_jacobian(system, s).toarray()
    c = A / np.sum(A * A, axis=1, keepdims=True)
    if of == "inertia":
        return float(np.min(np.einsum("ai,ij,aj->a", c, _mass(system), c)))
    if of != "damping":
        return NAN
    v = _velocities(s)
    loads = [_loads(system, _with_velocities(s, v + sign * LITTLE * row)) for row in c for sign in (1.0, -1.0)]
    slopes = (np.array(loads[::2]) - np.array(loads[1::2])) / (2.0 * LITTLE)
    return float(np.min(-np.sum(slopes * c, axis=1))) + 0.0  # no -0


@cache
def _condition(make: object, problem: str, parameters: str, h: float) -> float:
    made = registry.make_problem(problem, json.loads(parameters))
    return float(np.linalg.cond(make(made.system, made.initial, h)))  # type: ignore[operator]


def newton_matrix(system: MultibodySystem, s: State, dt: float) -> Float[np.ndarray, "n n"]:
    """d(residual)/d(v, nu) of the first step, mu0 = 0, by differences; rotational rows turned back to the bodies."""
    v, n = _velocities(s), 6 * system.nb
    A = constraint_jacobian(system, s).toarray()
    nu = -dt * np.linalg.lstsq(A.T, _loads(system, s), rcond=None)[0]
    x = np.concatenate((v, nu))
    moved = [_residual(system, s, dt, x + sign * LITTLE * e, n) for e in np.eye(len(x)) for sign in (1.0, -1.0)]
    return (np.array(moved[::2]) - np.array(moved[1::2])).T / (2.0 * LITTLE)


def _residual(system: MultibodySystem, s: State, dt: float, x: np.ndarray, n: int) -> np.ndarray:
    """(74) with nu0 = 0 and f_bar left out, and phi_dot of (75), both at the end of a step."""
    v0, v1, nu = _velocities(s), x[:n], x[n:]
    end = _moved(s, 0.5 * dt * (v0 + v1), v1)
    wrench = _wrench(system, end, nu)
    ahead, behind = (_wrench(system, _moved(end, sign * LITTLE * v1, v1), nu) for sign in (1.0, -1.0))
    rate = (ahead - behind) / (2.0 * LITTLE)
    before = _turned(s, _mass(system) @ v0 + 0.5 * dt * _loads(system, s))
    after = _turned(end, _mass(system) @ v1 - 0.5 * dt * _loads(system, end))
    change = after - before - wrench + 0.5 * dt * rate
    return np.concatenate((_turned(end, change, back=True), constraint_jacobian(system, end) @ v1))


def index3_matrix(system: MultibodySystem, s: State, h: float) -> Float[np.ndarray, "n n"]:
    """[[I/h, -I, 0], [0, M/h, -A^T], [A, 0, 0]]: q' = u, M u' = f + A^T lam, phi(q) = 0."""
    A, M, one = constraint_jacobian(system, s).toarray(), _mass(system), np.eye(6 * system.nb)
    nr, n = A.shape
    return np.block([
        [one / h, -one, np.zeros((n, nr))], [np.zeros((n, n)), M / h, -A.T],
        [A, np.zeros((nr, n)), np.zeros((nr, nr))],
    ])  # fmt: skip


def _mass(system: MultibodySystem) -> np.ndarray:
    blocks = zip(system.mass, system.inertia, strict=True)
    return np.asarray(sl.block_diag(*(x for m, J in blocks for x in (m * np.eye(3), J))))


def _velocities(s: State) -> np.ndarray:
    return np.concatenate((s.v, s.Omega), axis=1).ravel()


def _with_velocities(s: State, v: np.ndarray) -> State:
    each = v.reshape(-1, 6)
    return State(s.r, s.R, each[:, :3], each[:, 3:], s.t)


def _moved(s: State, way: np.ndarray, v: np.ndarray) -> State:
    """The pose moved along ``way`` (translations in space, rotations in the body), with the velocities ``v``."""
    each, own = way.reshape(-1, 6), v.reshape(-1, 6)
    return State(s.r + each[:, :3], s.R @ exp(each[:, 3:]), own[:, :3], own[:, 3:], s.t)


def _loads(system: MultibodySystem, s: State) -> np.ndarray:
    return np.asarray(applied_loads(system, States.one(s))[0]).ravel()


def _wrench(system: MultibodySystem, s: State, nu: np.ndarray) -> np.ndarray:
    """D nu in space."""
    return _turned(s, constraint_jacobian(system, s).T @ nu)


def _turned(s: State, wrench: np.ndarray, *, back: bool = False) -> np.ndarray:
    """Rotational rows from the bodies to space, or back."""
    each = wrench.reshape(-1, 6)
    turned = np.einsum("bji,bj->bi" if back else "bij,bj->bi", s.R, each[:, 3:])
    return np.concatenate((each[:, :3], turned), axis=1).ravel()
