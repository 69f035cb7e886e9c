"""The energy that a symplectic method of fixed step keeps, along its trajectory (Moan, Niesen 2014, arXiv:1304.0673).

With the discrete Lagrangian of leapfrog and RATTLE, free motion and half a kick at both ends,

    S_n+1 = S_n + h T((q_n+1 - q_n) / h) - h/2 (V_n + V_n+1),    H_n = p_n . q'_n - S'_n

where ' is the derivative along the modified motion, which passes through all q_n and S_n: central differences,
extrapolated to the order that makes H_n swing least. Where forces change within a few steps (the whip of the chain at
1e-3 s) the swing is that of the differences, and falls by 2^order with the step. Of any other method H_n swings as its
energy does, or says how far it is from one with this Lagrangian (McLachlan, Offen 2022, arXiv:2201.03911): symplectic
methods with another one (``gauss_joint``, ``rattle_joint``) are not shown.
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
EQUAL = 1e-9  # relative: principal inertias
SWEEPS, ROUNDING = 12, 1e-14  # of Newton steps, [rad]
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
    twice = np.sum(L * turned, axis=2)  # h^2 times twice the energy: about principal axes a free body turns evenly
    size = np.max(np.linalg.norm(L, axis=2) * np.linalg.norm(turned, axis=2))
    nutating = np.max(np.linalg.norm(np.cross(L, turned), axis=2), axis=0) > TURNED * size
    for b in np.flatnonzero(nutating):
        twice[:, b] = _nutate(system.inertia[b], turned[:, b])
    moved = np.diff(s.r, axis=0)
    T = 0.5 * (np.sum(system.mass[:, None] * moved**2, axis=(1, 2)) + np.sum(twice, axis=1)) / h**2
    V = potential_energy(system, s)
    return h * T - 0.5 * h * (V[:-1] + V[1:])


def _nutate(inertia: Float[np.ndarray, "3 3"], turned: Float[np.ndarray, "steps 3"]) -> Float[np.ndarray, " steps"]:
    """h^2 times twice the energy of the free top that turns by exp(``turned``) = exp(w) exp(c w_a e), w = h L / I_t.

    e is the axis of symmetry, c = I_t / I_a - 1; w_a = e . w by Newton steps.
    """
    sizes, axes = np.linalg.eigh(inertia)
    a = 0 if sizes[2] - sizes[1] < sizes[1] - sizes[0] else 2
    other = sizes[2 - a]
    if abs(other - sizes[1]) > EQUAL * other or not sizes[a] > 0.0:
        raise ValueError("it needs bodies that turn about principal axes, or with two equal principal inertias")
    e, c, Q = axes[:, a], other / sizes[a] - 1.0, Rotation.from_rotvec(turned)
    w_a = turned @ e / (1.0 + c)
    for _ in range(SWEEPS):
        w = (Q * Rotation.from_rotvec(-c * w_a[:, None] * e)).as_rotvec()
        gap = w @ e - w_a
        w_a = w_a + gap / (1.0 + c)
    if not np.max(np.abs(gap)) < ROUNDING:
        raise ValueError("it needs bodies that turn less in a step")
    out: np.ndarray = other * (np.sum(w * w, axis=1) + c * w_a**2)
    return out


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
