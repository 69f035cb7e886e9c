"""Symbolic analysis of the saddle [[J_vv, -D'], [A, eps]] in blocks: one node a body (6) or joint (1 to 5 rows).

One analysis serves a whole run. Order: greedy minimum degree on the block graph, with one rule that makes pivoting
across blocks unnecessary: a joint is eliminated after all of its bodies, so its pivot is a principal block of the
Schur complement A M^-1 D' (+ eps), positive definite for independent rows.
"""

from typing import Any, NamedTuple

import numpy as np

from .greedy_order import eliminate

STATE = np.dtype([("singular", "i8")])


class Saddle(NamedTuple):
    """The blocks of the saddle, each by rows, one after the other in ``LU.blocks``."""

    bodies: Any  # (npairs, 6, 6) load of one body by velocities of another: pairs of the kernel
    column: Any  # (2, 6 nrows) load of end e by the multipliers of a joint
    row: Any  # (2, 6 nrows) rows of a joint by the velocities of end e
    joint: Any  # (nj, 36) of a joint by itself: a diagonal


class LU(NamedTuple):
    """Blocks of the saddle, and its factors by elimination position p: structure, numbers and work space."""

    state: Any  # record: singular
    blocks: Any  # all of ``Saddle``
    size: Any  # (N,) scalars of node p
    start: Any  # (N + 1,) first scalar of node p
    body_at: Any  # (nb,) first scalar of each body
    joint_at: Any  # (nj,)
    pair_start: Any  # (N + 1,) original blocks of row p ...
    pair_column: Any  # (npairs,) ... the first scalar of their columns ...
    pair_width: Any
    pair_place: Any  # ... and where they are in ``blocks``
    low_start: Any  # (N + 1,) nodes before p that p's row meets ...
    low_node: Any  # ... ascending
    up_start: Any  # (N + 1,) scalar columns behind p in its row ...
    up: Any  # ... ascending
    panel_start: Any  # (N + 1,) offset of the (size, width) panel of U
    low: Any  # (nlow, 6, 6) blocks of L
    pivot_inverse: Any  # (N, 6, 6)
    pivot: Any  # (n,) |pivots|
    panel: Any  # panels of U
    dense: Any  # (6, n) a row in the making
    strip: Any  # (n,)
    swapped: Any  # (6,) rows swapped in a pivot block
    x: Any  # (n,) right-hand side and solution, in elimination order


def analyse(bodies: np.ndarray, row: np.ndarray, pairs: np.ndarray, apart: np.ndarray) -> tuple[Saddle, LU]:
    """Blocks, elimination order and fill, with room for the numbers.

    ``bodies`` (nj, 2) of joints, -1 is the ground, and their first rows (nj + 1,); ``pairs`` (npairs, 2) of bodies,
    first each with itself, of which those ``apart`` (indices) have a block, too.
    """
    nb, nj, nrows = int(np.sum(pairs[:, 0] == pairs[:, 1])), len(bodies), int(row[-1])
    sizes = (36 * len(pairs), 6 * nrows, 6 * nrows, 6 * nrows, 6 * nrows, 36 * nj)
    first = np.concatenate(([0], np.cumsum(sizes)))
    blocks = np.zeros(first[-1])
    parts = [blocks[first[n] : first[n + 1]] for n in range(6)]
    saddle = Saddle(
        parts[0].reshape(-1, 6, 6), blocks[first[1] : first[3]].reshape(2, -1),
        blocks[first[3] : first[5]].reshape(2, -1), parts[5].reshape(-1, 36),
    )  # fmt: skip
    keys: dict[tuple[int, int], int] = {(b, b): 36 * b for b in range(nb)}
    for j, ends in enumerate(bodies):
        for e, b in enumerate(ends):
            if b >= 0:
                keys[int(b), nb + j] = int(first[1 + e] + 6 * row[j])
                keys[nb + j, int(b)] = int(first[3 + e] + 6 * row[j])
        keys[nb + j, nb + j] = int(first[5] + 36 * j)
    for n in apart:
        keys[int(pairs[n, 0]), int(pairs[n, 1])] = 36 * int(n)
    neighbours: list[set[int]] = [set() for _ in range(nb + nj)]
    for a, b in keys:
        if a != b:
            neighbours[a].add(b)
            neighbours[b].add(a)
    size = np.concatenate((np.full(nb, 6), np.diff(row))).astype(np.int64)
    ahead: list[tuple[int, ...]] = [()] * nb + [tuple(map(int, ends[ends >= 0])) for ends in bodies]
    found_order, later = eliminate(neighbours, lambda left, a: (int(sum(size[b] for b in left[a])),), ahead)
    order = np.array(found_order, dtype=np.int64)
    place = np.empty(nb + nj, dtype=np.int64)
    place[order] = np.arange(nb + nj)
    ordered = sorted(keys, key=lambda k: (place[k[0]], place[k[1]]))
    at = np.concatenate(([0], np.cumsum(size[order]))).astype(np.int64)
    column = place[[b for _, b in ordered]]
    found = {
        "blocks": blocks, "body_at": at[place][:nb], "joint_at": at[place][nb:],
        "pair_start": np.searchsorted(place[[a for a, _ in ordered]], np.arange(nb + nj + 1)).astype(np.int64),
        "pair_column": at[column], "pair_width": size[order][column],
        "pair_place": np.array([keys[k] for k in ordered], dtype=np.int64),
    }  # fmt: skip
    return saddle, _structure(order, [later[a] for a in found_order], place, size[order], at, found)


def _structure(
    order: np.ndarray, behind: list[set[int]], place: np.ndarray, size: np.ndarray, at: np.ndarray,
    found: dict[str, np.ndarray],
) -> LU:  # fmt: skip
    N, n = len(order), int(at[-1])
    low: list[list[int]] = [[] for _ in range(N)]
    up: list[np.ndarray] = []
    for p in range(N):
        later = sorted(int(place[b]) for b in behind[p])
        for q in later:
            low[q].append(p)
        up.append(np.concatenate([np.arange(at[q], at[q + 1]) for q in later] or [np.zeros(0, dtype=np.int64)]))
    width = np.array([len(u) for u in up], dtype=np.int64)
    return LU(
        state=np.zeros((), dtype=STATE), **found, size=size, start=at,
        low_start=np.concatenate(([0], np.cumsum([len(q) for q in low]))).astype(np.int64),
        low_node=np.array([q for qs in low for q in qs], dtype=np.int64),
        up_start=np.concatenate(([0], np.cumsum(width))).astype(np.int64),
        up=np.concatenate(up).astype(np.int64) if up else np.zeros(0, dtype=np.int64),
        panel_start=np.concatenate(([0], np.cumsum(width * size))).astype(np.int64),
        low=np.zeros((sum(map(len, low)), 6, 6)), pivot_inverse=np.zeros((N, 6, 6)), pivot=np.zeros(n),
        panel=np.zeros(int(np.sum(width * size))), dense=np.zeros((6, n)), strip=np.zeros(n),
        swapped=np.zeros(6, dtype=np.int64), x=np.zeros(n),
    )  # fmt: skip
