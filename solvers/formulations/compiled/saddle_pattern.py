"""Symbolic analysis of the saddle [[J_vv, -D'], [A, eps]] in blocks: one node per body (6) or joint (1 to 5 rows).

One analysis serves a whole run. The order is greedy minimum degree on the block graph, with one rule that makes
pivoting across blocks unnecessary: a joint is eliminated after all of its bodies, so that its pivot is a principal
block of the Schur complement A M^-1 D' (+ eps), positive definite for independent rows.
"""

from typing import Any

import numpy as np

from .bundles import make_bundle, make_record
from .greedy_order import find_elimination_order

NUMBERS = {  # arrays of the factors and of a solution, by elimination position
    "low": "nlow 6 6",
    "pivot_inverse": "N 6 6",
    "panel": "npanel",  # blocks of L, panels of U
    "pivot": "n",  # |pivots|
    "dense": "6 n",
    "strip": "n",  # the row being eliminated
    "x": "n",  # right-hand side and solution
}


def analyse_saddle(bodies: np.ndarray, row: np.ndarray, pairs: np.ndarray, apart: np.ndarray) -> tuple[Any, Any]:
    """Return the bundle of the saddle's blocks, and that of its LU factors: elimination order, fill and storage.

    ``bodies`` (nj, 2) are those of each joint, -1 for the ground, ``row`` (nj + 1,) its first constraint row. ``pairs``
    (npairs, 2) are pairs of bodies, first each with itself; ``apart`` are the indices of the other pairs that have a
    block. The saddle has, stored by rows, ``bodies``: load of one body by velocities of another, for each pair;
    ``column``: load of end e by the multipliers of a joint; ``row``: rows of a joint by the velocities of end e; and
    ``joint``: the diagonal block of a joint.
    """
    nb, nj, nrows = int(np.sum(pairs[:, 0] == pairs[:, 1])), len(bodies), int(row[-1])
    sizes = (36 * len(pairs), 6 * nrows, 6 * nrows, 6 * nrows, 6 * nrows, 36 * nj)
    first = np.concatenate(([0], np.cumsum(sizes)))
    blocks = np.zeros(first[-1])
    parts = [blocks[first[n] : first[n + 1]] for n in range(6)]
    saddle = make_bundle(
        "Saddle",
        {},
        {},
        bodies=parts[0].reshape(-1, 6, 6),
        column=blocks[first[1] : first[3]].reshape(2, -1),
        row=blocks[first[3] : first[5]].reshape(2, -1),
        joint=parts[5].reshape(-1, 36),
    )
    # nodes are bodies, then joints; the index in ``blocks`` of each block (node, node)
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
    found_order, later = find_elimination_order(
        neighbours, lambda left, a: (int(sum(size[b] for b in left[a])),), ahead
    )
    order = np.array(found_order, dtype=np.int64)
    place = np.empty(nb + nj, dtype=np.int64)
    place[order] = np.arange(nb + nj)
    ordered = sorted(keys, key=lambda k: (place[k[0]], place[k[1]]))
    at = np.concatenate(([0], np.cumsum(size[order]))).astype(np.int64)
    column = place[[b for _, b in ordered]]
    found: dict[str, Any] = {
        # first scalar of each; of the original blocks of row p the first scalars of their columns, widths and places
        "blocks": blocks,
        "body_at": at[place][:nb],
        "joint_at": at[place][nb:],
        "pair_start": np.searchsorted(place[[a for a, _ in ordered]], np.arange(nb + nj + 1)).astype(np.int64),
        "pair_column": at[column],
        "pair_width": size[order][column],
        "pair_place": np.array([keys[k] for k in ordered], dtype=np.int64),
    }
    return saddle, _make_factors(order, [later[a] for a in found_order], place, size[order], at, found)


def _make_factors(
    order: np.ndarray,
    later_neighbours: list[set[int]],
    place: np.ndarray,
    size: np.ndarray,
    at: np.ndarray,
    found: dict[str, Any],
) -> Any:
    """Return the bundle of LU factors, storage and index tables, from the elimination ``order`` of the nodes.

    ``place`` is the position of each node in the order. By position, ``later_neighbours`` are the nodes that a node
    meets and that are eliminated after it, ``size`` is its number of scalars, ``at`` the index of the first. ``found``
    are further fields of the bundle.
    """
    N, n = len(order), int(at[-1])
    low: list[list[int]] = [[] for _ in range(N)]
    up: list[np.ndarray] = []
    for p in range(N):
        later = sorted(int(place[b]) for b in later_neighbours[p])
        for q in later:
            low[q].append(p)
        up.append(np.concatenate([np.arange(at[q], at[q + 1]) for q in later] or [np.zeros(0, dtype=np.int64)]))
    width = np.array([len(u) for u in up], dtype=np.int64)
    sizes = {"N": N, "n": n, "nlow": sum(map(len, low)), "npanel": int(np.sum(width * size))}
    return make_bundle(
        "LU",
        NUMBERS,
        sizes,
        state=make_record(singular=0),
        **found,
        size=size,
        start=at,  # scalars of node p, its first one
        # nodes before p that p's row meets, ascending; scalar columns behind p in its row, ascending; its panel of U
        low_start=np.concatenate(([0], np.cumsum([len(q) for q in low]))).astype(np.int64),
        low_node=np.array([q for qs in low for q in qs], dtype=np.int64),
        up_start=np.concatenate(([0], np.cumsum(width))).astype(np.int64),
        up=np.concatenate(up).astype(np.int64) if up else np.zeros(0, dtype=np.int64),
        panel_start=np.concatenate(([0], np.cumsum(width * size))).astype(np.int64),
        swapped=np.zeros(6, dtype=np.int64),  # rows swapped in a pivot block
    )
