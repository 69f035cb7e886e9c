"""Formulate a planar chain of rods from a fixed point in two ways, for the chain and for a grid with a rod per row.

Rod k (0..n-1) has length l and mass M_k spread evenly; node k, its far end, carries a mass H_k; node -1 is the origin.
The last node is fixed or free. Gravity acts along -y of the plane (x, y).

``make_rates_by_angles``  absolute angles of the rods to x, and multipliers for the two that fix the last node:

    sum_j c_ij (cos(a_i - a_j) a_j_ddot + sin(a_i - a_j) a_j_dot^2) + (g/l) w_i cos a_i = (closure)_i
    c_ij = mass beyond rod max(i, j), with half of it (i != j) or a third (i = j); w_i likewise with half

``make_rates_by_nodes``   positions p of the nodes; a rod is |d|^2/2 = l^2/2 with d = p_k - p_(k-1), its kinetic energy

    M_k/6 (|p_(k-1)_dot|^2 + p_(k-1)_dot . p_k_dot + |p_k_dot|^2): constant mass matrix, a multiplier per rod, no angle
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

Rate = Callable[[Float[np.ndarray, " ny"]], Float[np.ndarray, " ny"]]
Rates = Callable[[Float[np.ndarray, "k ny"]], Float[np.ndarray, "k ny"]]  # of several states at once


@dataclass(frozen=True)
class Linkage:
    """Rods [kg, m], node masses [kg], gravity [m/s2]; ``end`` is the fixed position of the last node [m], or None."""

    rod_mass: Float[np.ndarray, " n"]  # M_k
    node_mass: Float[np.ndarray, " n"]  # H_k
    length: float
    gravity: float
    end: tuple[float, float] | None = None

    @property
    def n(self) -> int:
        """The number of rods."""
        return len(self.rod_mass)

    @property
    def free(self) -> int:
        """The number of nodes that move."""
        return self.n - (self.end is not None)

    def nodes(self, angle: Float[np.ndarray, "*nt n"]) -> Float[np.ndarray, "*nt n 2"]:
        """Return the positions of the nodes in the plane [m], from the rods' angles to x [rad]."""
        return self.length * np.cumsum(np.stack((np.cos(angle), np.sin(angle)), axis=-1), axis=-2)

    def convert_to_nodes(self, y: Float[np.ndarray, " coordinates"]) -> Float[np.ndarray, " state"]:
        """Convert a state ``y`` of ``make_rates_by_angles`` to that of ``make_rates_by_nodes``."""
        angle, rate = y[: self.n], y[self.n :]
        across = np.stack((-np.sin(angle), np.cos(angle)), axis=-1)
        v = self.length * np.cumsum(rate[:, None] * across, axis=0)
        return np.concatenate((self.nodes(angle)[: self.free].ravel(), v[: self.free].ravel()))


def make_rates_by_angles(link: Linkage) -> Rate:
    """Return the function from a state, angles [rad] and their rates of shape (2 n,), to its time derivative.

    The function writes into arrays of its own, so that calls must not overlap.
    """
    n, M, H = link.n, link.rod_mass, link.node_mass
    beyond = np.cumsum((M + H)[::-1])[::-1] - M  # mass of the nodes from k on and of the rods after k
    k = np.arange(n)
    c = (beyond + 0.5 * M)[np.maximum(k[:, None], k)]
    c[k, k] = beyond + M / 3.0
    pull = link.gravity / link.length * (beyond + 0.5 * M)
    held = 0 if link.end is None else 2

    matrix, right = np.zeros((n + held, n + held)), np.zeros(n + held)  # written anew by each call

    def rate(y: np.ndarray) -> np.ndarray:
        """Return the rates [rad/s] and accelerations [rad/s2] of the angles in the state ``y``."""
        cos, sin, square = np.cos(y[:n]), np.sin(y[:n]), y[n:] ** 2
        matrix[:n, :n] = c * (cos[:, None] * cos + sin[:, None] * sin)
        right[:n] = cos * (c @ (sin * square)) - sin * (c @ (cos * square)) - pull * cos
        if held:
            matrix[:n, n] = matrix[n, :n] = -sin
            matrix[:n, n + 1] = matrix[n + 1, :n] = cos
            right[n:] = cos @ square, sin @ square
        return np.concatenate((y[n:], np.linalg.solve(matrix, right)[:n]))

    return rate


def make_rates_by_nodes(link: Linkage, precision: type = np.float64) -> Rates:
    """Return the function from states of the moving nodes, of shape (k, 4 m), to their time derivatives.

    A state has the positions [m], then the velocities [m/s] of the m nodes. ``precision`` is the type of the numbers
    that the function computes with, such as longdouble.
    """
    n, m = link.n, link.free
    M: np.ndarray = link.rod_mass.astype(precision)
    H: np.ndarray = link.node_mass.astype(precision)
    after = np.append(M[1:], 0)
    mass = np.diag((M + after) / 3 + H) + np.diag(after[:-1] / 6, 1) + np.diag(after[:-1] / 6, -1)
    inverse = _solve_refined(mass[:m, :m], np.eye(m, dtype=precision))
    fall = -link.gravity * inverse @ ((M + after) / 2 + H)[:m]
    k = np.arange(m)
    # rows of the inverse mass matrix for the far and the near node of each rod, 0 for a node that is fixed
    both: np.ndarray = np.zeros((2, n, m, 1), dtype=precision)
    both[0, :m, :, 0], both[1, 1:, :, 0] = inverse, inverse[: n - 1]
    far, near = both

    def rate(y: np.ndarray) -> np.ndarray:
        """Return the velocities [m/s] and accelerations [m/s2] of the nodes in each of the states ``y`` (k, 4 m)."""
        x: np.ndarray = np.zeros((len(y), 2, n + 1, 2), dtype=precision)  # with the fixed ends
        x[:, :, 1 : m + 1] = y.reshape(len(y), 2, m, 2)
        if link.end is not None:
            x[:, 0, n] = link.end
        d, d_dot = np.moveaxis(x[:, :, 1:] - x[:, :, :-1], 1, 0)
        G: np.ndarray = np.zeros((len(y), n, m, 2), dtype=precision)
        G[:, k, k] = d[:, :m]
        G[:, k[: n - 1] + 1, k[: n - 1]] = -d[:, 1:]
        along = d[:, :, None]
        GM = (along * far + (0.0 - along * near)).reshape(len(y), n, -1)  # G M^-1: a rod has two nodes
        square = d_dot * d_dot
        S = GM @ np.swapaxes(G.reshape(GM.shape), 1, 2)
        lam = _solve_refined(S, (-(square[..., 0] + square[..., 1]) - G[..., 1] @ fall)[..., None])
        a = (np.swapaxes(GM, 1, 2) @ lam).reshape(len(y), m, 2)
        a[:, :, 1] += fall
        return np.concatenate((y[:, 2 * m :], a.reshape(len(y), -1)), axis=1)

    return rate


def _solve_refined(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return A^-1 b in the precision of A: by LAPACK in float64, refined twice if A is more precise."""
    if A.dtype == np.float64:
        return np.linalg.solve(A, b)
    rough = A.astype(float)
    x = np.zeros_like(b)
    for _ in range(3):
        x = x + np.linalg.solve(rough, (b - A @ x).astype(float))
    return x
