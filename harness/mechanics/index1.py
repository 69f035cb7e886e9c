"""Compute accelerations and reactions of index 1 at many states at once, to judge runs; no solver uses this code.

M a = f + A^T reaction, A a = -A_dot v, unique in a and in A^T reaction where rows are redundant, too.
"""

import itertools
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy import sparse

from . import so3
from .bordered import factor_bordered
from .ends import apply_matrices
from .motion import applied_loads, choose_difference_step, evaluate_acceleration_bias, list_jacobian_parts
from .state import States
from .system import MultibodySystem

CHUNK = 500  # instants at once at most, and of which differences have one step
ENTRIES = 2**18  # the same in entries of dense A: more does not stay in a processor's cache, and new memory costs time
TOGETHER = 2e6  # the same in entries of sparse rows
DENSE = 3e6  # nrows^2 6 nb, at most, of dense algebra: beyond it sparse factors cost less
# share of the largest square of a row of B: rows that depend on each other to 3e-8 are refined within PASSES, where
# 1e-10 left a third of the grid's load at 3e-7; rounding lets 0.4 % of what contradicts redundant rows enter loads
REGULAR = 1e-14
PASSES = 30  # passes of refinement at most
SETTLED = 1e-13  # relative change of L^T a at which refinement ends
# least to largest part of a row that earlier rows leave: rounding is then below 1e-11. Half and twice of this, and of
# the one before, change no bit of 40 accelerations each of Bricard's and Bennett's linkages, a grid of 5 x 5 four-bar
# cells, two cells that pass singular poses, and a top.
INDEPENDENT = 1e-4


class Index1(NamedTuple):
    """Solutions of index 1 at each time; NaN where the state, its loads or its drift are not finite."""

    a: Float[np.ndarray, "nt nb 6"]  # (v_dot [space], Omega_dot [body])
    reaction: Float[np.ndarray, "nt nrows"]
    load: Float[np.ndarray, "nt nb 6"]  # A^T reaction: forces [N, space], moments about C [N m, body]


def solve_index_1(system: MultibodySystem, s: States) -> Index1:
    """Solve index 1 at each time of ``s``: accelerations, reactions of the rows, and their loads on the bodies."""
    return solve_index_1_of_each(system, [s])[0]


def solve_index_1_of_each(system: MultibodySystem, motions: Sequence[States]) -> list[Index1]:
    """Solve index 1 along several motions at once, with the same bits as along each alone.

    It saves time: where a motion has few instants, most of it is that of the calls.
    """
    s, nb, nrows = States.join(motions), system.nb, system.nrows
    n = len(s)
    out = Index1(*(np.full(shape, np.nan) for shape in ((n, nb, 6), (n, nrows), (n, nb, 6))))
    inverse, dense = _invert_mass_root(system), is_dense(system)
    steps = np.concatenate([_choose_difference_steps(system, m) for m in motions])
    for k in _split_into_chunks(system, n):
        part = s.at(k)
        f = applied_loads(system, part)
        f[:, :, 3:] -= so3.cross(part.Omega, apply_matrices(system.inertia, part.Omega))
        A_dot_v = evaluate_acceleration_bias(system, part, steps[k])
        (_fill_dense if dense else _fill_sparse)(system, part, inverse, f, A_dot_v, Index1(*(a[k] for a in out)))
    ends = np.cumsum([0, *map(len, motions)])
    return [Index1(*(a[i:j] for a in out)) for i, j in itertools.pairwise(ends)]


def _choose_difference_steps(system: MultibodySystem, s: States) -> Float[np.ndarray, " nt"]:
    """Return the step [s] of differences at each time of a motion: one for each ``CHUNK`` of its instants."""
    parts = [s.at(slice(k, k + CHUNK)) for k in range(0, len(s), CHUNK)]
    return np.concatenate([np.zeros(0), *(np.full(len(p), choose_difference_step(system, p)) for p in parts)])


def _split_into_chunks(system: MultibodySystem, n: int) -> list[slice]:
    """Return slices of ``n`` instants: of at most ``CHUNK`` instants and, if A is dense, ``ENTRIES`` entries of A."""
    size = int(np.clip(ENTRIES / max(1.0, 6.0 * system.nb * system.nrows), 1, CHUNK)) if is_dense(system) else CHUNK
    return [slice(k, min(k + size, n)) for k in range(0, n, size)]


def is_dense(system: MultibodySystem) -> bool:
    """Return whether a system is so small that dense factors cost less than sparse ones."""
    return 6.0 * system.nb * system.nrows**2 <= DENSE


def _invert_mass_root(system: MultibodySystem) -> Float[np.ndarray, "nb 6 6"]:
    """Return L^-1 with L L^T = M for each body; M includes added inertia."""
    L = np.zeros((system.nb, 6, 6))
    L[:, range(3), range(3)] = np.sqrt(system.mass)[:, None]
    L[:, 3:, 3:] = np.linalg.cholesky(system.regular_inertia)
    return np.linalg.inv(L)


def _evaluate_dense_jacobian(system: MultibodySystem, s: States) -> Float[np.ndarray, "nt nrows nb 6"]:
    """Return the dense A at each time, its columns by bodies: r_dot [space], then Omega [body]."""
    A = np.zeros((len(s), system.nrows, system.nb, 6))
    for body, rows, translation, rotation in list_jacobian_parts(system, s):
        A[:, rows, body] += np.concatenate((translation, rotation), axis=-1)
    return A


def _weigh_rows(system: MultibodySystem, inverse: np.ndarray, A: np.ndarray) -> Float[np.ndarray, "nt nrows m"]:
    """Return B = A L^-T (nt, nrows, 6 nb) from the dense A and ``inverse``, L^-1 of each body."""
    B = np.matmul(A.transpose(0, 2, 1, 3), np.swapaxes(inverse, -1, -2)).transpose(0, 2, 1, 3)
    return B.reshape(len(A), system.nrows, 6 * system.nb)


def _fill_dense(
    system: MultibodySystem, s: States, inverse: np.ndarray, f: np.ndarray, A_dot_v: np.ndarray, out: Index1
) -> None:
    """Fill ``out`` with solutions by dense matrices, at all instants at once; it stays NaN where input is not finite.

    ``inverse`` is L^-1 of each body (nb, 6, 6), ``f`` the applied loads less Omega x J Omega (nt, nb, 6), ``A_dot_v``
    the bias of phi_ddot (nt, nrows).
    """
    A = _evaluate_dense_jacobian(system, s)
    B = _weigh_rows(system, inverse, A)
    good = np.all(np.isfinite(B), axis=(1, 2)) & np.all(np.isfinite(f), axis=(1, 2))
    good &= np.all(np.isfinite(A_dot_v), axis=1)
    found = _solve_saddle(inverse, B[good], f[good], A_dot_v[good])
    out.a[good], out.reaction[good] = found
    rows_found = A[good].reshape(len(found[0]), system.nrows, 6 * system.nb)
    out.load[good] = np.matmul(found[1][:, None], rows_found).reshape(found[0].shape)


def _fill_sparse(
    system: MultibodySystem, s: States, inverse: np.ndarray, f: np.ndarray, A_dot_v: np.ndarray, out: Index1
) -> None:
    """Fill ``out`` with solutions by sparse factors, instant by instant; it stays NaN where input is not finite.

    The arguments are those of ``_fill_dense``; the cost grows with the fill of the factors.
    """
    spread = sparse.block_diag(np.swapaxes(inverse, -1, -2), format="csr")
    for k, (A, B, square) in enumerate(_list_sparse_rows(system, s, spread)):
        if not all(np.all(np.isfinite(x)) for x in (A.data, f[k], A_dot_v[k])):
            continue
        a, reaction = _solve_sparse(inverse, B, square, f[k], A_dot_v[k])
        out.a[k], out.reaction[k], out.load[k] = a, reaction, (A.T @ reaction).reshape(-1, 6)


def _list_sparse_rows(
    system: MultibodySystem, s: States, weight: sparse.csr_array
) -> Iterator[tuple[sparse.csr_array, sparse.csr_array, np.ndarray]]:
    """Yield A, B = A ``weight`` and the sums of squares of B's rows at each time; ``weight`` is (6 nb, 6 nb)."""
    parts = list(list_jacobian_parts(system, s))
    row = np.concatenate([np.repeat(rows, 6) for _, rows, _, _ in parts])
    column = np.concatenate([np.ravel(6 * body[:, None] + np.arange(6)) for body, _, _, _ in parts])
    values = np.concatenate([np.concatenate(p[2:], axis=-1).reshape(len(s), -1) for p in parts], axis=1)
    nrows, many = system.nrows, max(1, int(TOGETHER / max(1, len(row))))
    # the rows of many instants are stacked in one sparse matrix, since each product of matrices costs its call
    for some in (values[k : k + many] for k in range(0, len(s), many)):
        n = len(some)
        every = (row + nrows * np.arange(n)[:, None]).ravel(), np.tile(column, n)
        A = sparse.csr_array((some.ravel(), every), shape=(n * nrows, 6 * system.nb))
        B = (A @ weight).tocsr()
        square = np.asarray(B.multiply(B).sum(axis=1))
        yield from ((A[k : k + nrows], B[k : k + nrows], square[k : k + nrows]) for k in range(0, n * nrows, nrows))


def find_least_changes(
    system: MultibodySystem, s: States, wanted: Float[np.ndarray, "nt nrows"], dependent: float
) -> Float[np.ndarray, "nt nb 6"]:
    """Return the least changes x of the poses (r [m, space], turn [rad, body]) with A x = ``wanted`` at each time.

    They minimise sum m (|x_r|^2 + gyration^2 |x_turn|^2). Rows are scaled to one, so that metres and radians count
    alike. Singular values s below d = ``dependent`` times the largest are left out; with sparse rows, a fraction
    d^2 / (s^2 + d^2) of each is.
    """
    weight = 1.0 / np.sqrt(system.mass)[:, None] * np.repeat([np.ones(system.nb), 1.0 / system.gyration], 3, 0).T
    y = np.zeros((len(s), 6 * system.nb))
    if is_dense(system):
        for part in _split_into_chunks(system, len(s)):
            B = (_evaluate_dense_jacobian(system, s.at(part)) * weight).reshape(-1, system.nrows, 6 * system.nb)
            size = np.linalg.norm(B, axis=2)
            size[size == 0.0] = 1.0
            least = factor_rows(B / size[..., None], dependent, multipliers=False)
            y[part] = least(wanted[part] / size)[0]
    else:
        for k, (_, B, square) in enumerate(_list_sparse_rows(system, s, sparse.diags_array(weight.ravel()).tocsr())):
            size = np.sqrt(square)
            size[size == 0.0] = 1.0
            S = (sparse.diags_array(1.0 / size) @ B).tocsr()
            scaled, least = _factor_sparse(S, S.multiply(S).sum(axis=1), dependent**2, passes=1)
            y[k], _ = least(wanted[k] / size / scaled)
    return y.reshape(len(s), system.nb, 6) * weight


def _solve_sparse(
    inverse: np.ndarray, B: sparse.csr_array, square: np.ndarray, f: np.ndarray, A_dot_v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return accelerations (nb, 6) and reactions (nrows,) at one instant; arguments as of ``_solve_saddle``.

    ``square`` are the sums of squares of B's rows.
    """
    size, least = _factor_sparse(B, square)
    x = np.einsum("bij,bj->bi", inverse, f).ravel()
    more, mu = least((-A_dot_v - B @ x) / size)
    return np.einsum("bji,bj->bi", inverse, (x + more).reshape(-1, 6)), mu / size


def _factor_sparse(
    B: sparse.csr_array, square: np.ndarray, regular: float = REGULAR, passes: int = PASSES
) -> tuple[float, Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]]:
    """Factor B = A L^-T; return its size, the largest norm of a row, and a function of c that returns x and mu.

    x is the least solution of B x = size c, and x = B^T mu / size. ``square`` are the sums of squares of B's rows. The
    method is iterated regularisation in at most ``passes``: with S = B / size, mu += (S S^T + e)^-1 (c - S S^T mu), e =
    ``regular``. Redundant rows need no choice: the part of mu that they leave open does not enter S^T mu. What is
    factored is [[1, S^T], [S, -e]], which avoids squaring the condition of S.
    """
    n = B.shape[1]
    size = float(np.sqrt(np.max(square, initial=0.0))) or 1.0
    S: sparse.csr_array = (B / size).tocsr()
    St, solve = factor_bordered(S, regular)

    def least(c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the least x with B x = size c, and mu with x = B^T mu / size."""
        x, mu = np.zeros(n), np.zeros(len(c))
        for _ in range(passes):
            step = solve(np.append(-(x - St @ mu), c - S @ x))
            x, mu = x + step[:n], mu - step[n:]
            if not np.linalg.norm(step[:n]) > SETTLED * np.linalg.norm(x):
                break
        return np.asarray(St @ mu), mu

    return size, least


def factor_rows(
    B: Float[np.ndarray, "n k m"], dependent: float = 1e-9, *, multipliers: bool = True
) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Factor B; return a function of c (n, k) that returns the least x (n, m) with B x = c, and mu with B^T mu = x.

    QR serves where rows are far from dependent, singular values, ten times as slow, elsewhere: those below
    ``dependent`` times the largest are left out. Without ``multipliers``, mu may be left zero.
    """
    sure = np.zeros(len(B), dtype=bool)
    if 0 < B.shape[1] <= B.shape[2] and len(B):
        Q, R = np.linalg.qr(np.swapaxes(B, -1, -2))
        size = np.abs(np.diagonal(R, axis1=1, axis2=2))
        sure = np.min(size, axis=1) > INDEPENDENT * np.max(size, axis=1)
        if np.all(sure):  # as most often: megabytes need not be copied
            return partial(_apply_factors, Q, R, multipliers)
        Q, R = Q[sure], R[sure]
    back = np.linalg.pinv(B[~sure], rcond=dependent)

    def apply(c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the least x with B x = c, and mu with B^T mu = x."""
        x, mu = np.zeros((len(B), B.shape[2])), np.zeros((len(B), B.shape[1]))
        if np.any(sure):
            x[sure], mu[sure] = _apply_factors(Q, R, True, c[sure])
        x[~sure] = apply_matrices(back, c[~sure])
        mu[~sure] = apply_matrices(np.swapaxes(back, -1, -2), x[~sure])
        return x, mu

    return apply


def _apply_factors(Q: np.ndarray, R: np.ndarray, multipliers: bool, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the least x with (Q R)^T x = c, and mu with Q R mu = x: zeros without ``multipliers``."""
    y = np.linalg.solve(np.swapaxes(R, -1, -2), np.ascontiguousarray(c)[:, :, None])
    mu = np.linalg.solve(R, y)[:, :, 0] if multipliers else np.zeros_like(c)
    return (Q @ y)[:, :, 0], mu


def _solve_saddle(
    inverse: np.ndarray, B: np.ndarray, f: np.ndarray, A_dot_v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return accelerations (nt, nb, 6) and reactions (nt, nrows) from L^-1 of each body, B = A L^-T, f and A_dot v."""
    x = np.einsum("bij,tbj->tbi", inverse, f).reshape(B.shape[::2])
    more, reaction = factor_rows(B)(-A_dot_v - apply_matrices(B, x))
    return np.einsum("bji,tbj->tbi", inverse, (x + more).reshape(f.shape)), reaction
