"""Accelerations and reactions of index 1 at many states at once, with code that no solver uses: what judges a run.

M a = f + A^T reaction, A a = -A_dot v, unique in a and in A^T reaction where rows are redundant, too.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy import sparse
from scipy.sparse.linalg import splu

from . import so3
from .ends import times
from .motion import applied_loads, drift, row_parts
from .state import States
from .system import MultibodySystem

CHUNK = 500  # instants whose A is held at once
DENSE = 3e6  # nrows^2 6 nb, at most, of dense algebra: beyond it sparse factors cost less
REGULAR = 1e-10  # of the largest square of a row of B: above rounding, and refined away
PASSES = 30  # of refinement at most
SETTLED = 1e-13  # of L^T a: the last pass
INDEPENDENT = 1e-4  # least to largest part of a row that earlier rows leave: rounding is then below 1e-11


class Index1(NamedTuple):
    """NaN where a run is no longer finite, and where M is singular."""

    a: Float[np.ndarray, "nt nb 6"]  # (v_dot [space], Omega_dot [body])
    reaction: Float[np.ndarray, "nt nrows"]
    load: Float[np.ndarray, "nt nb 6"]  # A^T reaction: forces [N, space], moments about C [N m, body]


def index_1(system: MultibodySystem, s: States) -> Index1:
    """Accelerations, reactions and their loads on the bodies by index 1, at each time of ``s``."""
    n, nb, nrows = len(s), system.nb, system.nrows
    out = Index1(*(np.full(shape, np.nan) for shape in ((n, nb, 6), (n, nrows), (n, nb, 6))))
    L = np.zeros((nb, 6, 6))  # of L L^T = M, with added inertia
    L[:, range(3), range(3)] = np.sqrt(system.mass)[:, None]
    L[:, 3:, 3:] = np.linalg.cholesky(system.regular_inertia)
    inverse = np.linalg.inv(L)
    few = 6.0 * nb * nrows**2 <= DENSE
    for k in range(0, n, CHUNK):
        part = s.at(slice(k, k + CHUNK))
        f = applied_loads(system, part)
        f[:, :, 3:] -= so3.cross(part.Omega, times(system.inertia, part.Omega))
        A_dot_v = drift(system, part)
        (_dense if few else _sparse)(system, part, inverse, f, A_dot_v, Index1(*(a[k : k + CHUNK] for a in out)))
    return out


def _dense(
    system: MultibodySystem, s: States, inverse: np.ndarray, f: np.ndarray, A_dot_v: np.ndarray, out: Index1
) -> None:
    A = np.zeros((len(s), system.nrows, system.nb, 6))
    for body, rows, translation, rotation in row_parts(system, s):
        A[:, rows, body] += np.concatenate((translation, rotation), axis=-1)
    B = np.matmul(A.transpose(0, 2, 1, 3), np.swapaxes(inverse, -1, -2)).transpose(0, 2, 1, 3)
    B = B.reshape(len(s), system.nrows, 6 * system.nb)
    good = np.all(np.isfinite(B), axis=(1, 2)) & np.all(np.isfinite(f), axis=(1, 2))
    good &= np.all(np.isfinite(A_dot_v), axis=1)
    found = _solve_saddle(inverse, B[good], f[good], A_dot_v[good])
    out.a[good], out.reaction[good] = found
    rows_found = A[good].reshape(len(found[0]), system.nrows, 6 * system.nb)
    out.load[good] = np.matmul(found[1][:, None], rows_found).reshape(found[0].shape)


def _sparse(
    system: MultibodySystem, s: States, inverse: np.ndarray, f: np.ndarray, A_dot_v: np.ndarray, out: Index1
) -> None:
    """The same, one instant after the other; costs grow with what sparse factors hold."""
    parts = list(row_parts(system, s))
    row = np.concatenate([np.repeat(rows, 6) for _, rows, _, _ in parts])
    column = np.concatenate([np.ravel(6 * body[:, None] + np.arange(6)) for body, _, _, _ in parts])
    values = np.concatenate([np.concatenate(p[2:], axis=-1).reshape(len(s), -1) for p in parts], axis=1)
    spread = sparse.block_diag(np.swapaxes(inverse, -1, -2), format="csr")
    for k in range(len(s)):
        if not all(np.all(np.isfinite(x[k])) for x in (values, f, A_dot_v)):
            continue
        A = sparse.csr_array((values[k], (row, column)), shape=(system.nrows, 6 * system.nb))
        a, reaction = _solved_sparsely(inverse, (A @ spread).tocsr(), f[k], A_dot_v[k])
        out.a[k], out.reaction[k], out.load[k] = a, reaction, (A.T @ reaction).reshape(-1, 6)


def _solved_sparsely(
    inverse: np.ndarray, B: sparse.csr_array, f: np.ndarray, A_dot_v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The least x with B x = c as B^T mu, by iterated regularisation: mu += (B B^T + e)^-1 (c - B B^T mu).

    Redundant rows need no choice: what they leave open of mu is no part of B^T mu. The factor is that of
    [[1, B^T], [B, -e]], which no square of B spoils.
    """
    n = B.shape[1]
    size = float(np.sqrt(np.max(B.multiply(B).sum(axis=1), initial=0.0))) or 1.0
    S = B / size
    St = S.T.tocsr()
    KKT = sparse.block_array([[sparse.eye_array(n), St], [S, -REGULAR * sparse.eye_array(S.shape[0])]], format="csc")
    factor = splu(KKT)

    def least(c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x, mu = np.zeros(n), np.zeros(len(c))
        for _ in range(PASSES):
            step = factor.solve(np.append(-(x - St @ mu), c - S @ x))
            x, mu = x + step[:n], mu - step[n:]
            if not np.linalg.norm(step[:n]) > SETTLED * np.linalg.norm(x):
                break
        return np.asarray(St @ mu), mu

    x = np.einsum("bij,bj->bi", inverse, f).ravel()
    more, mu = least((-A_dot_v - B @ x) / size)
    return np.einsum("bji,bj->bi", inverse, (x + more).reshape(-1, 6)), mu / size


def factor_rows(B: Float[np.ndarray, "n k m"]) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """A function that takes c (n, k) to the least x (n, m) with B x = c, and to mu (n, k) with B^T mu = x.

    By QR where rows are far from dependent, by singular values, ten times as slow, elsewhere.
    """
    sure = np.zeros(len(B), dtype=bool)
    if 0 < B.shape[1] <= B.shape[2] and len(B):
        Q, R = np.linalg.qr(np.swapaxes(B, -1, -2))
        size = np.abs(np.diagonal(R, axis1=1, axis2=2))
        sure = np.min(size, axis=1) > INDEPENDENT * np.max(size, axis=1)
        Q, R = Q[sure], R[sure]
    back = np.linalg.pinv(B[~sure], rcond=1e-9)

    def apply(c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x, mu = np.zeros((len(B), B.shape[2])), np.zeros((len(B), B.shape[1]))
        if np.any(sure):
            y = np.linalg.solve(np.swapaxes(R, -1, -2), c[sure][:, :, None])
            x[sure], mu[sure] = (Q @ y)[:, :, 0], np.linalg.solve(R, y)[:, :, 0]
        x[~sure] = times(back, c[~sure])
        mu[~sure] = times(np.swapaxes(back, -1, -2), x[~sure])
        return x, mu

    return apply


def _solve_saddle(
    inverse: np.ndarray, B: np.ndarray, f: np.ndarray, A_dot_v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """From L^-1 by bodies, B = A L^-T, f and A_dot v."""
    x = np.einsum("bij,tbj->tbi", inverse, f).reshape(B.shape[::2])
    more, reaction = factor_rows(B)(-A_dot_v - times(B, x))
    return np.einsum("bji,tbj->tbi", inverse, (x + more).reshape(f.shape)), reaction
