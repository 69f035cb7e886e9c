"""Pinned bodies by integrating quaternion and Omega in extended precision: the second route to every exact reference.

Many starts at once: arrays of cases, since the time goes into interpreting, not into arithmetic.
"""

from collections.abc import Sequence

import numpy as np

from mbsbench.harness.mechanics.state import State
from mbsbench.harness.reference.extrapolation import gbs
from mbsbench.problems.exact.pinned import PinnedBody

EXTENDED = np.longdouble


def integrated(
    bodies: Sequence[PinnedBody], starts: Sequence[State], t: np.ndarray, substeps: int
) -> tuple[np.ndarray, np.ndarray]:
    """R (ncases, nt, 3, 3) and Omega (ncases, nt, 3): J_O Omega_dot + Omega x J_O Omega = c x R^T m g, J_O diagonal."""
    J = np.array([np.diag(b.inertia_O) for b in bodies], dtype=EXTENDED).T
    c = np.array([b.mass * b.arm for b in bodies], dtype=EXTENDED).T
    g = np.array([b.gravity for b in bodies], dtype=EXTENDED).T
    R0 = np.array([s.R[0] for s in starts], dtype=EXTENDED)

    def rate(y: np.ndarray) -> np.ndarray:
        A, W = y[:9].reshape(3, 3, -1), y[9:]  # columns of R are A[:, k]
        down = np.einsum("ikn,in->kn", A, g)
        W_dot = (_cross(c, down) - _cross(W, J * W)) / J
        A_dot = np.stack(
            [A[:, 1] * W[2] - A[:, 2] * W[1], A[:, 2] * W[0] - A[:, 0] * W[2], A[:, 0] * W[1] - A[:, 1] * W[0]], axis=1
        )
        return np.concatenate((A_dot.reshape(9, -1), W_dot))

    W0 = np.array([s.Omega[0] for s in starts], dtype=EXTENDED)
    out = gbs(rate, np.concatenate((R0.reshape(-1, 9).T, W0.T)), t, substeps)
    R = np.moveaxis(out[:, :9].reshape(len(t), 3, 3, -1), -1, 0)
    return R.astype(float), np.moveaxis(out[:, 9:], -1, 0).astype(float)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.stack((a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]))
