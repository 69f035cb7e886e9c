"""Compute smallest corrections of the states at the ends of segments, by least squares of cost linear in their number.

Corrections z_k of node k are coordinates in an orthonormal basis of its tangent space, in the metric

    |z|^2 = (xi^T H xi + tau^2 eta^T H eta) / M,     H the inertia, M the mass of the matter, xi = d(pose), eta = du

the mean square over the matter of displacement and, times tau, of velocity [m^2]; each node has the weight w_k of the
time that it represents. Continuity of the flow requires A_k z_k - z_k+1 = -gap_k, that is B z = -gap with B B^T block
tridiagonal.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import cho_factor, cho_solve

from .equations import FlowEquations


@dataclass(frozen=True)
class Frames:
    """Bases of the tangent spaces at nodes, and the maps from small changes of y to coordinates in them."""

    basis: Float[np.ndarray, "n ny m"]
    coordinates: Float[np.ndarray, "n m ny"]

    @staticmethod
    def compute(E: FlowEquations, t: Float[np.ndarray, " n"], y: Float[np.ndarray, "n ny"], tau: float) -> "Frames":
        """Return bases, orthonormal in the module's metric, of the changes of the states ``y`` that keep loops closed.

        ``t`` [s] are the times, ``tau`` [s] is the weight of velocities.
        """
        T, H, slopes = E.evaluate_frame(t, y)
        nu = E.nu
        # root^T root = H / M; unit takes coordinates that are orthonormal in H / M to changes of pose
        root = np.swapaxes(np.linalg.cholesky(H / np.sum(E.system.mass)), 1, 2)
        unit = np.linalg.inv(root)
        rows = np.concatenate((slopes[:, :, :nu] @ unit, slopes[:, :, nu:] @ unit / tau), axis=2)
        free = np.linalg.qr(np.swapaxes(rows, 1, 2), mode="complete")[0][:, :, E.rows :]
        pose, rate = free[:, :nu], free[:, nu:]
        # inverse of T: its columns are orthogonal
        back = root @ np.swapaxes(T, 1, 2) / np.sum(T[0] ** 2, axis=0)[:, None]
        return Frames(
            np.concatenate((T @ (unit @ pose), unit @ rate / tau), axis=1),
            np.concatenate((np.swapaxes(pose, 1, 2) @ back, np.swapaxes(rate, 1, 2) @ (tau * root)), axis=2),
        )

    def measure(self, dy: Float[np.ndarray, "n ny"]) -> Float[np.ndarray, "n m"]:
        """Return the coordinates [m] of small changes ``dy`` of the states in the bases."""
        return np.einsum("kij,kj->ki", self.coordinates, dy)

    def move(self, z: Float[np.ndarray, "n m"]) -> Float[np.ndarray, "n ny"]:
        """Return the changes of the states that have coordinates ``z`` [m]: the inverse of ``measure``."""
        return np.einsum("kij,kj->ki", self.basis, z)


class Continuity:
    """The linear conditions B z = b that join segments, with the factor of B W^-1 B^T.

    ``A`` takes coordinates at the start of a segment to those at its end, ``w`` are the weights of the nodes.
    """

    def __init__(self, A: Float[np.ndarray, "n m m"], w: Float[np.ndarray, " nodes"]) -> None:
        """Factor B W^-1 B^T, which is block tridiagonal, by Cholesky's method."""
        self.A, self.w = A, w
        self._factors: list[tuple[np.ndarray, bool]] = []
        self._below: list[np.ndarray] = []
        for k in range(len(A)):
            S = A[k] @ A[k].T / w[k] + np.eye(A.shape[1]) / w[k + 1]
            if k:
                self._below.append(cho_solve(self._factors[-1], -A[k].T / w[k], check_finite=False))
                S += A[k] @ self._below[-1] / w[k]
            self._factors.append(cho_factor(S, lower=True, check_finite=False))

    def apply(self, z: Float[np.ndarray, "nodes m"]) -> Float[np.ndarray, "n m"]:
        """Return B z, the changes of the gaps [m] by corrections ``z`` [m]."""
        return np.einsum("kij,kj->ki", self.A, z[:-1]) - z[1:]

    def find_least_corrections(self, b: Float[np.ndarray, "n m"]) -> Float[np.ndarray, "nodes m"]:
        """Return the corrections z [m] of least sum of w_k |z_k|^2 with B z = b, by the factor of B W^-1 B^T."""
        x, n = b.copy(), len(b)
        for k in range(1, n):
            x[k] -= self._below[k - 1].T @ x[k - 1]
        for k in reversed(range(n)):
            x[k] = cho_solve(self._factors[k], x[k], check_finite=False)
            if k < n - 1:
                x[k] -= self._below[k] @ x[k + 1]
        z = np.zeros((n + 1, b.shape[1]))
        z[:-1] = np.einsum("kji,kj->ki", self.A, x)
        z[1:] -= x
        return z / self.w[:, None]

    def measure_size(self, z: Float[np.ndarray, "nodes m"]) -> float:
        """Return the norm of corrections [m], the root of their ``product`` with themselves."""
        return float(np.sqrt(self.product(z, z)))

    def product(self, y: Float[np.ndarray, "nodes m"], z: Float[np.ndarray, "nodes m"]) -> float:
        """Return the inner product of two sets of corrections [m^2], weighted by w."""
        return float(np.sum(self.w[:, None] * y * z))
