"""Accelerations and reactions of index 1 at many states at once, with code that no solver uses: what judges a run.

M a = f + A^T reaction, A a = -A_dot v, unique in a and in A^T reaction where rows are redundant, too.
"""

from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from . import so3
from .ends import times
from .lent import pushed, taken_back
from .motion import applied, drift, row_parts
from .state import States
from .system import MultibodySystem

CHUNK = 500  # instants whose A is held at once
INDEPENDENT = 1e-4  # least to largest part of a row that earlier rows leave: rounding is then below 1e-11


class Index1(NamedTuple):
    """NaN where a run is no longer finite, and where M is singular."""

    a: Float[np.ndarray, "nt nb 6"]  # (v_dot [space], Omega_dot [body])
    reaction: Float[np.ndarray, "nt nrows"]
    load: Float[np.ndarray, "nt nb 6"]  # A^T reaction: forces [N, space], moments about C [N m, body]


def index_1(system: MultibodySystem, s: States) -> Index1:
    """All of it at each time of ``s``."""
    n, nb, nrows = len(s), system.nb, system.nrows
    out = Index1(*(np.full(shape, np.nan) for shape in ((n, nb, 6), (n, nrows), (n, nb, 6))))
    L = np.zeros((nb, 6, 6))  # of L L^T = M, with what is lent
    L[:, range(3), range(3)] = np.sqrt(system.mass)[:, None]
    L[:, 3:, 3:] = np.linalg.cholesky(system.regular_inertia)
    inverse = np.linalg.inv(L)
    for k in range(0, n, CHUNK):
        part = s.at(slice(k, k + CHUNK))
        A = np.zeros((len(part), nrows, nb, 6))
        for body, rows, translation, rotation in row_parts(system, part):
            A[:, rows, body] += np.concatenate((translation, rotation), axis=-1)
        f = applied(system, part)
        f[:, :, 3:] -= so3.cross(part.Omega, times(system.inertia, part.Omega))
        B = np.matmul(A.transpose(0, 2, 1, 3), np.swapaxes(inverse, -1, -2)).transpose(0, 2, 1, 3)
        B = B.reshape(len(part), nrows, 6 * nb)
        A_dot_v = drift(system, part)
        good = np.all(np.isfinite(B), axis=(1, 2)) & np.all(np.isfinite(f), axis=(1, 2))
        good &= np.all(np.isfinite(A_dot_v), axis=1)
        try:
            found = _solved(system.taken_back, inverse, B[good], f[good], A_dot_v[good])
        except ArithmeticError:  # where a motion went wrong, lent inertia may be all there is
            continue
        at = k + np.flatnonzero(good)
        out.a[at], out.reaction[at] = found
        rows_found = A[good].reshape(len(at), nrows, 6 * nb)
        out.load[at] = np.matmul(found[1][:, None], rows_found).reshape(len(at), nb, 6)
    return out


def pseudo_inverse(B: Float[np.ndarray, "n k m"]) -> Float[np.ndarray, "n m k"]:
    """Of each; by QR where its rows are far from dependent, by singular values, ten times as slow, elsewhere."""
    back = np.zeros(np.swapaxes(B, -1, -2).shape)
    sure = np.zeros(len(B), dtype=bool)
    if 0 < B.shape[1] <= B.shape[2] and len(B):
        Q, R = np.linalg.qr(np.swapaxes(B, -1, -2))
        size = np.abs(np.diagonal(R, axis1=1, axis2=2))
        sure = np.min(size, axis=1) > INDEPENDENT * np.max(size, axis=1)
        back[sure] = Q[sure] @ np.swapaxes(np.linalg.inv(R[sure]), -1, -2)
    back[~sure] = np.linalg.pinv(B[~sure], rcond=1e-9)
    return back


def _solved(
    P: np.ndarray, inverse: np.ndarray, B: np.ndarray, f: np.ndarray, A_dot_v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """From L^-1 by bodies, B = A L^-T, f and A_dot v; the lent inertia P is taken back."""
    back = pseudo_inverse(B)

    def solve(load: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x = np.einsum("bij,tbj->tbi", inverse, f + load).reshape(len(f), -1)
        more = times(back, -A_dot_v - times(B, x))
        a = np.einsum("bji,tbj->tbi", inverse, (x + more).reshape(len(f), -1, 6))
        return a, times(np.swapaxes(back, -1, -2), more)

    return taken_back(solve, partial(pushed, P))
