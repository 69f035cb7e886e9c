"""Compute the energy that a symplectic fixed-step method conserves, from a trajectory (Moan, Niesen 2014).

Source: arXiv:1304.0673.

With the discrete Lagrangian of leapfrog and RATTLE, free motion and half a kick at both ends,

    S_n+1 = S_n + h T((q_n+1 - q_n) / h) - h/2 (V_n + V_n+1),    H_n = p_n . q'_n - S'_n

where ' is the derivative along the modified motion, which passes through all q_n and S_n: central differences,
extrapolated to the order for which H_n varies least. Where forces change within a few steps (the whip of the chain at
1e-3 s) the variation is that of the differences, and falls by 2^order with the step. For any other method H_n varies as
its energy does, or shows how far it is from one with this Lagrangian (McLachlan, Offen 2022, arXiv:2201.03911):
symplectic methods with another one (``gauss_joint``, ``rattle_joint``) are not recognised.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ...mechanics.motion import energy, kinetic_energy, potential_energy
from ...mechanics.state import States
from ...mechanics.types import Problem, Trajectory

EVEN = 1e-9  # allowed change of the step, relative to the step
TURNED = 1e-9  # allowed part of the angular momentum across the angular velocity, relative to the largest one
EQUAL = 1e-9  # relative difference of principal inertias that count as equal
SWEEPS, ROUNDING = 12, 1e-14  # number of Newton steps, and their size at convergence [rad]
LARGEST_ORDER = 16


@dataclass(frozen=True)
class ModifiedEnergy:
    """The modified energy, and the energy, at the rows far enough from both ends for central differences."""

    t: Float[np.ndarray, " n"]
    values: Float[np.ndarray, " n"]  # [J] modified energy
    energy: Float[np.ndarray, " n"]  # [J] T + V
    order: int  # of the differences
    scale: float  # [J] the largest kinetic energy

    @property
    def energy_range(self) -> float:
        """Range of the modified energy [J]."""
        return float(np.ptp(self.values))


def find_modified_energy(problem: Problem, trajectory: Trajectory) -> ModifiedEnergy:
    """Return the modified energy by the order of differences for which it varies least.

    Raise ValueError where ``compute_modified_energy`` does.
    """
    found = (compute_modified_energy(problem, trajectory, order) for order in range(2, LARGEST_ORDER + 1, 2))
    return min(found, key=lambda m: m.energy_range)


def compute_modified_energy(problem: Problem, trajectory: Trajectory, order: int) -> ModifiedEnergy:
    """Return the modified energy by central differences of even ``order``; raise ValueError where it is undefined.

    It is undefined for variable steps, too few steps, systems that are not conservative, and asymmetric bodies or long
    steps where bodies nutate.
    """
    t, s, system = trajectory.t, trajectory.states, problem.system
    h = float(t[-1] / (len(t) - 1)) if len(t) > 1 else 0.0
    n = LARGEST_ORDER // 2
    if len(t) <= 4 * n or np.max(np.abs(np.diff(t) - h)) > EVEN * h:
        raise ValueError(f"it needs a fixed step, and more than {4 * n} of them")
    if not system.is_conservative:
        raise ValueError("it needs a conservative system")
    inner = slice(n, len(t) - n)
    S = np.concatenate(([0.0], np.cumsum(_compute_actions(problem, s, h))))
    R_dot = np.swapaxes(s.R[inner], 2, 3) @ differentiate(s.R, h, order, n)
    rate = np.stack((R_dot[..., 2, 1], R_dot[..., 0, 2], R_dot[..., 1, 0]), axis=-1)
    p = system.mass[:, None] * s.v[inner]
    spin = np.einsum("bij,tbj->tbi", system.inertia, s.Omega[inner])
    H = np.sum(p * differentiate(s.r, h, order, n) + spin * rate, axis=(1, 2)) - differentiate(S, h, order, n)
    size = float(np.max(kinetic_energy(system, s)))
    return ModifiedEnergy(t[inner], H, energy(system, s.at(inner)), order, size)


def _compute_actions(problem: Problem, s: States, h: float) -> Float[np.ndarray, " steps"]:
    """Return the discrete action of each step of h [s], S_n+1 - S_n [J s].

    Raise ValueError for bodies that nutate and are not symmetric, or turn too far in a step.
    """
    system = problem.system
    turned = Rotation.from_matrix((np.swapaxes(s.R[:-1], 2, 3) @ s.R[1:]).reshape(-1, 3, 3)).as_rotvec()
    turned = turned.reshape(len(s) - 1, system.nb, 3)
    L = np.einsum("bij,tbj->tbi", system.inertia, turned)
    # h^2 times twice the energy: about a principal axis a free body turns at a constant rate
    twice = np.sum(L * turned, axis=2)
    size = np.max(np.linalg.norm(L, axis=2) * np.linalg.norm(turned, axis=2))
    nutating = np.max(np.linalg.norm(np.cross(L, turned), axis=2), axis=0) > TURNED * size
    for b in np.flatnonzero(nutating):
        twice[:, b] = _compute_nutation_energy(system.inertia[b], turned[:, b])
    moved = np.diff(s.r, axis=0)
    T = 0.5 * (np.sum(system.mass[:, None] * moved**2, axis=(1, 2)) + np.sum(twice, axis=1)) / h**2
    V = potential_energy(system, s)
    return h * T - 0.5 * h * (V[:-1] + V[1:])


def _compute_nutation_energy(
    inertia: Float[np.ndarray, "3 3"], turned: Float[np.ndarray, "steps 3"]
) -> Float[np.ndarray, " steps"]:
    """Return h^2 times twice the energy of a symmetric free top that turns by exp(``turned``) in each step h.

    With exp(``turned``) = exp(w) exp(c w_a e), w = h L / I_t: e is the axis of symmetry, c = I_t / I_a - 1; w_a = e . w
    by Newton steps. Raise ValueError for a body that is not symmetric or turns too far in a step.
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
    """Return the rate of ``a``, recorded with step h [s], by central differences of this order.

    It is given at all rows but ``n`` at either end.
    """
    half = order // 2
    k = np.arange(1, half + 1)
    weights = np.linalg.solve(
        k[None, :] ** (2.0 * np.arange(half)[:, None]), np.eye(half)[0]
    )  # weights of (a_k - a_-k) / 2 k h
    rows = len(a) - 2 * n
    out = np.zeros((rows, *a.shape[1:]))
    for j, w in zip(k, weights, strict=True):
        out += w / (2.0 * j * h) * (a[n + j : n + j + rows] - a[n - j : n - j + rows])
    return out
