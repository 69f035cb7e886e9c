"""Solve the Newton-Euler equations with joints, for authors of solvers: M a = f + A^T reaction, A a = -A_dot v.

Solvers and references of this package integrate by their own equations; these check engines and serve plugins.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from . import so3
from .added_inertia import check_added_inertia
from .counting import count_calls
from .jacobian import constraint_jacobian
from .motion import applied_loads, evaluate_acceleration_bias
from .state import State, States
from .system import MultibodySystem

RANK = (
    1e-6  # share of the largest singular value of A M^-1/2, rows of length one: redundant below (Bricard: off phi = 0)
)


@dataclass(frozen=True)
class Rates:
    """Rates of a state, which ``advance`` follows; ``A^T reaction`` is the load of the joints on the bodies."""

    v: Float[np.ndarray, "nb 3"]  # [m/s] of C, space
    Omega: Float[np.ndarray, "nb 3"]  # [rad/s] body
    v_dot: Float[np.ndarray, "nb 3"]
    Omega_dot: Float[np.ndarray, "nb 3"]
    reaction: Float[np.ndarray, " nrows"]


@dataclass(frozen=True)
class Equations:
    """M, A, A_dot v and f at a state; velocities are (r_dot [space], Omega [body]) of each body."""

    M: Float[np.ndarray, "nb 6 6"]  # with added inertia that changes no motion
    A: Float[np.ndarray, "nrows n"]  # n = 6 nb
    A_dot_v: Float[np.ndarray, " nrows"]  # with the rate of phi_t, where drives give rows one
    f: Float[np.ndarray, "nb 6"]  # forces [N, space], torques about C less Omega x J Omega [N m, body]


@count_calls(factorises=False)
def equations(system: MultibodySystem, s: State) -> Equations:
    """Evaluate M, A, A_dot v and f at ``s``, the equations that ``accelerations`` solves.

    A_dot v comes from sixth-order differences.
    """
    M = np.zeros((system.nb, 6, 6))
    M[:, range(3), range(3)] = system.mass[:, None]
    M[:, 3:, 3:] = system.regular_inertia
    return Equations(
        M,
        constraint_jacobian(system, s).toarray(),
        evaluate_acceleration_bias(system, States.one(s))[0],
        _evaluate_forces(system, s),
    )


@count_calls(factorises=True)
def accelerations(system: MultibodySystem, s: State, phi_ddot: Float[np.ndarray, " nrows"] | float = 0.0) -> Rates:
    """Return the rates of a state, from index 1: M a = f + A^T reaction with A a + A_dot v = ``phi_ddot``.

    Redundant rows get reactions of least norm. With L L^T = M and B = A L^-T, x = L^T a is L^-1 f, as without joints,
    plus the least correction with which B x = phi_ddot - A_dot v, by singular values of B with rows scaled to one.
    Raise ValueError where a body is accelerated about an axis without inertia.
    """
    e = equations(system, s)
    inverse = np.linalg.inv(np.linalg.cholesky(e.M))
    B = np.einsum("kbj,bij->kbi", e.A.reshape(len(e.A), system.nb, 6), inverse).reshape(e.A.shape)
    length = np.linalg.norm(B, axis=1)  # rows have units and bodies of their own
    length[length == 0.0] = 1.0
    U, size, V = np.linalg.svd(B / length[:, None], full_matrices=False)
    keep = size > RANK * np.max(size, initial=0.0)
    U, size, V = U[:, keep], size[keep], V[keep]
    x = np.einsum("bij,bj->bi", inverse, e.f).ravel()
    missing = (U.T @ ((phi_ddot - e.A_dot_v - B @ x) / length)) / size
    x, reaction = x + V.T @ missing, (U @ (missing / size)) / length
    a = np.einsum("bji,bj->bi", inverse, x.reshape(-1, 6))
    check_added_inertia(system.added_inertia, system.gyration, e.f, a[:, 3:])
    return Rates(s.v, s.Omega, a[:, :3], a[:, 3:], reaction)


def advance(s: State, rates: Rates, dt: float) -> State:
    """Advance ``s`` by ``dt`` [s] at these rates: r + dt v, R exp(dt Omega), v + dt v_dot, Omega + dt Omega_dot."""
    return State(
        s.r + dt * rates.v,
        s.R @ so3.exp(dt * rates.Omega),
        s.v + dt * rates.v_dot,
        s.Omega + dt * rates.Omega_dot,
        s.t + dt,
    )


def _evaluate_forces(system: MultibodySystem, s: State) -> np.ndarray:
    """Return (nb, 6): the applied forces [N, space], and torques about C less Omega x J Omega [N m, body]."""
    f: np.ndarray = applied_loads(system, States.one(s))[0]
    f[:, 3:] -= so3.cross(s.Omega, np.einsum("bij,bj->bi", system.inertia, s.Omega))
    return f
