"""The energy that a symplectic method of fixed step keeps, along its trajectory (Moan, Niesen 2014, arXiv:1304.0673).

With the discrete Lagrangian of leapfrog and RATTLE, free motion and half a kick at both ends,

    S_n+1 = S_n + h T((q_n+1 - q_n) / h) - h/2 (V_n + V_n+1),    H_n = p_n . q'_n - S'_n

where ' is the derivative along the modified motion, which passes through all q_n and S_n: central differences,
extrapolated to the order that makes H_n swing least. Of any other method H_n swings as its energy does, or says
how far it is from one with this Lagrangian (McLachlan, Offen 2022, arXiv:2201.03911).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ..mechanics.motion import energy, kinetic_energy, potential_energy
from ..mechanics.state import States
from ..types import Problem, Trajectory

EVEN = 1e-9  # of the step: its changes
TURNED = 1e-9  # of the largest angular momentum: its part across the angular velocity
LARGEST_ORDER = 16


@dataclass(frozen=True)
class ModifiedEnergy:
    """The modified energy at rows, far enough from the ends to be differenced, beside the energy there."""

    t: Float[np.ndarray, " n"]
    values: Float[np.ndarray, " n"]
    energy: Float[np.ndarray, " n"]
    order: int  # of the differences
    scale: float  # [J] the largest kinetic energy

    @property
    def swing(self) -> float:
        """[J]"""
        return float(np.ptp(self.values))


def find_modified_energy(problem: Problem, trajectory: Trajectory) -> ModifiedEnergy:
    """By the differences that make it swing least; ValueError where it is not defined."""
    found = (of_order(problem, trajectory, order) for order in range(2, LARGEST_ORDER + 1, 2))
    return min(found, key=lambda m: m.swing)


def of_order(problem: Problem, trajectory: Trajectory, order: int) -> ModifiedEnergy:
    """By central differences of even ``order``."""
    t, s, system = trajectory.t, trajectory.states, problem.system
    h = float(t[-1] / (len(t) - 1)) if len(t) > 1 else 0.0
    n = LARGEST_ORDER // 2
    if len(t) <= 4 * n or np.max(np.abs(np.diff(t) - h)) > EVEN * h:
        raise ValueError(f"it needs a fixed step, and more than {4 * n} of them")
    if not system.is_conservative:
        raise ValueError("it needs a conservative system")
    inner = slice(n, len(t) - n)
    S = np.concatenate(([0.0], np.cumsum(_actions(problem, s, h))))
    R_dot = np.swapaxes(s.R[inner], 2, 3) @ differentiate(s.R, h, order, n)
    rate = np.stack((R_dot[..., 2, 1], R_dot[..., 0, 2], R_dot[..., 1, 0]), axis=-1)
    p = system.mass[:, None] * s.v[inner]
    spin = np.einsum("bij,tbj->tbi", system.inertia, s.Omega[inner])
    H = np.sum(p * differentiate(s.r, h, order, n) + spin * rate, axis=(1, 2)) - differentiate(S, h, order, n)
    size = float(np.max(kinetic_energy(system, s)))
    return ModifiedEnergy(t[inner], H, energy(system, s.at(inner)), order, size)


def _actions(problem: Problem, s: States, h: float) -> Float[np.ndarray, " steps"]:
    """S_n+1 - S_n"""
    system = problem.system
    turned = Rotation.from_matrix((np.swapaxes(s.R[:-1], 2, 3) @ s.R[1:]).reshape(-1, 3, 3)).as_rotvec()
    turned = turned.reshape(len(s) - 1, system.nb, 3)
    L = np.einsum("bij,tbj->tbi", system.inertia, turned)
    size = np.max(np.linalg.norm(L, axis=2) * np.linalg.norm(turned, axis=2))
    if np.max(np.linalg.norm(np.cross(L, turned), axis=2)) > TURNED * size:
        raise ValueError("it needs bodies that turn about principal axes: the free motion of others is no rotation")
    moved = np.diff(s.r, axis=0)
    T = 0.5 * np.sum(system.mass[:, None] * moved**2 + L * turned, axis=(1, 2)) / h**2
    V = potential_energy(system, s)
    return h * T - 0.5 * h * (V[:-1] + V[1:])


def differentiate(a: Float[np.ndarray, "nt ..."], h: float, order: int, n: int) -> Float[np.ndarray, "inner ..."]:
    """Central differences of even ``order`` at all rows but n at either end."""
    half = order // 2
    k = np.arange(1, half + 1)
    weights = np.linalg.solve(
        k[None, :] ** (2.0 * np.arange(half)[:, None]), np.eye(half)[0]
    )  # of (a_k - a_-k) / 2 k h
    rows = len(a) - 2 * n
    out = np.zeros((rows, *a.shape[1:]))
    for j, w in zip(k, weights, strict=True):
        out += w / (2.0 * j * h) * (a[n + j : n + j + rows] - a[n - j : n - j + rows])
    return out
