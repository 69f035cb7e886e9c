"""Symbolic analysis of the saddle [[J_vv, -D'], [A, eps]] in blocks: one node a body (6) or joint (1 to 5 rows).

One analysis serves a whole run. Order: greedy minimum degree on the block graph, with one rule that makes pivoting
across blocks unnecessary: a joint is eliminated after all of its bodies, so its pivot is a principal block of the
Schur complement A M^-1 D' (+ eps), positive definite for independent rows.
"""

import heapq
from typing import NamedTuple

import numpy as np

from .arrays import Model


class Saddle(NamedTuple):
    """The blocks of the saddle, and which block the assembly writes for whom; -1 where there is none."""

    blocks: np.ndarray  # (npairs, 6, 6)
    body: np.ndarray  # (nb,) diagonal
    joint: np.ndarray  # (nj,) diagonal
    column: np.ndarray  # (nj, 2): row body, column joint
    row: np.ndarray  # (nj, 2): row joint, column body
    couple: np.ndarray  # (nj, 2): row body of end e, column body of the other end
    spring: np.ndarray  # (ns, 2)
    softness: np.ndarray  # (nrows,) (Xi M_bar)^-1
    T: np.ndarray  # (nb, 3, 3)


class LU(NamedTuple):
    """Factors of the saddle by elimination position p: structure, numbers and work space."""

    size: np.ndarray  # (N,) scalars of node p
    start: np.ndarray  # (N + 1,) first scalar of node p
    body_at: np.ndarray  # (nb,) first scalar of each body
    joint_at: np.ndarray  # (nj,)
    pair_start: np.ndarray  # (N + 1,) original blocks of row p ...
    pair_column: np.ndarray  # (npairs,) ... and the first scalar of their columns
    pair_width: np.ndarray
    low_start: np.ndarray  # (N + 1,) nodes before p that p's row meets ...
    low_node: np.ndarray  # ... ascending
    up_start: np.ndarray  # (N + 1,) scalar columns behind p in its row ...
    up: np.ndarray  # ... ascending
    panel_start: np.ndarray  # (N + 1,) offset of the (size, width) panel of U
    low: np.ndarray  # (nlow, 6, 6) blocks of L
    pivot_inverse: np.ndarray  # (N, 6, 6)
    pivot: np.ndarray  # (n,) |pivots|
    panel: np.ndarray  # panels of U
    dense: np.ndarray  # (6, n) a row in the making
    strip: np.ndarray  # (n,)
    swapped: np.ndarray  # (6,) rows swapped in a pivot block


def analyse(model: Model, couple: bool) -> tuple[Saddle, LU]:
    """Blocks, elimination order and fill, with room for the numbers.

    ``couple`` keeps the body-to-body blocks that joints cause.
    """
    nb, nj, nrows = len(model.mass), len(model.body), int(model.row[-1])
    keys: dict[tuple[int, int], None] = {}

    def pair(a: int, b: int) -> tuple[int, int]:
        keys.setdefault((a, b))
        return (a, b)

    body = [pair(b, b) for b in range(nb)]
    column, row, diagonal, coupled, spring = [], [], [], [], []
    for j, ends in enumerate(model.body):
        column.append([pair(b, nb + j) if b >= 0 else None for b in ends])
        row.append([pair(nb + j, b) if b >= 0 else None for b in ends])
        diagonal.append(pair(nb + j, nb + j))
        both = couple and min(ends) >= 0
        coupled.append([pair(ends[e], ends[1 - e]) if both else None for e in range(2)])
    for ends in model.spring_body:
        both = min(ends) >= 0
        spring.append([pair(ends[e], ends[1 - e]) if both else None for e in range(2)])
    neighbours: list[set[int]] = [set() for _ in range(nb + nj)]
    for a, b in keys:
        if a != b:
            neighbours[a].add(b)
            neighbours[b].add(a)
    size = np.concatenate((np.full(nb, 6), np.diff(model.row))).astype(np.int64)
    order, behind = _minimum_degree(neighbours, size, nb, model.body)
    place = np.empty(nb + nj, dtype=np.int64)
    place[order] = np.arange(nb + nj)
    number, pair_start, column_place = _sorted_pairs(list(keys), place)
    lu = _structure(order, behind, place, size, nb, pair_start, column_place)

    def numbers(entries: list) -> np.ndarray:
        return np.array([[-1 if k is None else number[k] for k in two] for two in entries], dtype=np.int64).reshape(
            -1, 2
        )

    saddle = Saddle(
        blocks=np.zeros((len(keys), 6, 6)),
        body=np.array([number[k] for k in body], dtype=np.int64),
        joint=np.array([number[k] for k in diagonal], dtype=np.int64),
        column=numbers(column),
        row=numbers(row),
        couple=numbers(coupled),
        spring=numbers(spring),
        softness=np.zeros(nrows),
        T=np.zeros((nb, 3, 3)),
    )
    return saddle, lu


def _minimum_degree(
    neighbours: list[set[int]], size: np.ndarray, nb: int, ends: np.ndarray
) -> tuple[np.ndarray, list[set[int]]]:
    """Order and, per node, the nodes behind it that its row meets (fill included)."""
    alive = [set(s) for s in neighbours]
    waiting = [0] * nb + [int(np.sum(e >= 0)) for e in ends]
    joints_of: list[list[int]] = [[] for _ in range(nb)]
    for j, two in enumerate(ends):
        for b in two:
            if b >= 0:
                joints_of[b].append(nb + j)

    def degree(a: int) -> int:
        return int(sum(size[b] for b in alive[a]))

    heap = [(degree(a), a) for a in range(len(alive)) if waiting[a] == 0]
    heapq.heapify(heap)
    done = [False] * len(alive)
    order, behind = [], []
    while heap:
        d, a = heapq.heappop(heap)
        if done[a] or d != degree(a):
            continue
        done[a] = True
        order.append(a)
        behind.append(alive[a])
        for b in alive[a]:
            alive[b].discard(a)
            alive[b] |= alive[a] - {b}
        if a < nb:
            for j in joints_of[a]:
                waiting[j] -= 1
        for b in alive[a] | (set(joints_of[a]) if a < nb else set()):
            if waiting[b] == 0 and not done[b]:
                heapq.heappush(heap, (degree(b), b))
    return np.array(order, dtype=np.int64), behind


def _sorted_pairs(
    keys: list[tuple[int, int]], place: np.ndarray
) -> tuple[dict[tuple[int, int], int], np.ndarray, np.ndarray]:
    ordered = sorted(keys, key=lambda k: (place[k[0]], place[k[1]]))
    count = np.zeros(len(place) + 1, dtype=np.int64)
    for a, _ in ordered:
        count[place[a] + 1] += 1
    return (
        {k: q for q, k in enumerate(ordered)},
        np.cumsum(count),
        np.array([place[b] for _, b in ordered], dtype=np.int64),
    )


def _structure(
    order: np.ndarray, behind: list[set[int]], place: np.ndarray, size: np.ndarray, nb: int,
    pair_start: np.ndarray, column_place: np.ndarray,
) -> LU:  # fmt: skip
    N = len(order)
    at = np.concatenate(([0], np.cumsum(size[order])))
    low: list[list[int]] = [[] for _ in range(N)]
    up: list[np.ndarray] = []
    for p in range(N):
        later = sorted(int(place[b]) for b in behind[p])
        for q in later:
            low[q].append(p)
        up.append(np.concatenate([np.arange(at[q], at[q + 1]) for q in later] or [np.zeros(0, dtype=np.int64)]))
    width = np.array([len(u) for u in up], dtype=np.int64)
    node_at = at[place]
    return LU(
        size=size[order],
        start=at.astype(np.int64),
        body_at=node_at[:nb].astype(np.int64),
        joint_at=node_at[nb:].astype(np.int64),
        pair_start=pair_start,
        pair_column=at[column_place].astype(np.int64),
        pair_width=size[order][column_place].astype(np.int64),
        low_start=np.concatenate(([0], np.cumsum([len(q) for q in low]))).astype(np.int64),
        low_node=np.array([q for qs in low for q in qs], dtype=np.int64),
        up_start=np.concatenate(([0], np.cumsum(width))).astype(np.int64),
        up=np.concatenate(up).astype(np.int64) if up else np.zeros(0, dtype=np.int64),
        panel_start=np.concatenate(([0], np.cumsum(width * size[order]))).astype(np.int64),
        low=np.zeros((sum(map(len, low)), 6, 6)),
        pivot_inverse=np.zeros((N, 6, 6)),
        pivot=np.zeros(at[-1]),
        panel=np.zeros(int(np.sum(width * size[order]))),
        dense=np.zeros((6, at[-1])),
        strip=np.zeros(at[-1]),
        swapped=np.zeros(6, dtype=np.int64),
    )
