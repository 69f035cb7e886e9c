"""The pattern of S = A M^-1 A^T by joints and of its block Cholesky factor, analysed once for a system.

Two joints share a block of S when they are joined to the same moving body. The elimination of a joint links its
neighbours to each other (fill). The next joint is the one that adds the fewest links, which on the grid takes a fifth
fewer products than the one with the fewest neighbours.
"""

from typing import NamedTuple

import numpy as np

from .greedy_order import find_elimination_order

WIDTH = 5  # rows of the largest joint: blocks are WIDTH x WIDTH, a spherical joint leaves two rows of them empty


class Blocks(NamedTuple):
    """Block columns of the factor in elimination order; blocks are stored by columns, each diagonal block first."""

    joint: np.ndarray  # (nj,) joint of each column
    size: np.ndarray  # (nj,) number of its rows
    row: np.ndarray  # (nj,) its first row of phi
    start: np.ndarray  # (nj + 1,) first block of each column
    other: np.ndarray  # (nblocks,) column of the block's other joint; the column itself on the diagonal
    shared: np.ndarray  # (nshared, 3): block, end of the block's other joint, end of the column's: at one body
    shared_start: np.ndarray  # (nblocks + 1,)
    update: np.ndarray  # (nupdates, 3): block -= left right^T, column by column
    update_start: np.ndarray  # (nj + 1,)


def analyse_joint_blocks(bodies: np.ndarray, row: np.ndarray) -> Blocks:
    """Return the elimination order of joints, the fill and the block products of the factor of S.

    ``bodies`` (nj, 2) are the two bodies of each joint, -1 for the ground; ``row`` (nj + 1,) its first constraint row.
    """
    nj = len(bodies)
    joints_at: dict[int, list[tuple[int, int]]] = {}  # (joint, end) at each moving body
    for j, ends in enumerate(bodies):
        for e, body in enumerate(ends):
            if body >= 0:
                joints_at.setdefault(int(body), []).append((j, e))
    neighbours: list[set[int]] = [set() for _ in range(nj)]  # joints that share a moving body
    for users in joints_at.values():
        for j, _ in users:
            neighbours[j] |= {k for k, _ in users if k != j}
    order, below = find_elimination_order(neighbours, _rank_joint)
    place = {j: c for c, j in enumerate(order)}
    start: list[int] = [0]
    other: list[int] = []
    index: dict[tuple[int, int], int] = {}  # block of each pair of columns (other, own)
    for c, j in enumerate(order):
        for o in (c, *sorted(place[k] for k in below[j])):
            index[o, c] = len(other)
            other.append(o)
        start.append(len(other))
    shared: list[tuple[int, int, int]] = []
    for users in joints_at.values():
        for j, e in users:
            for k, f in users:
                if place[j] >= place[k]:
                    shared.append((index[place[j], place[k]], e, f))
    shared.sort()
    update, update_start = [], [0]
    for c in range(nj):
        column = other[start[c] + 1 : start[c + 1]]
        for a, left in enumerate(column):
            for right in column[: a + 1]:
                update.append((index[left, right], index[left, c], index[right, c]))
        update_start.append(len(update))
    size = np.diff(row)[order] if nj else np.zeros(0, dtype=np.int64)
    counts = np.bincount([s[0] for s in shared], minlength=len(other)) if shared else np.zeros(len(other), dtype=int)
    return Blocks(
        joint=np.array(order, dtype=np.int64),
        size=np.asarray(size, dtype=np.int64),
        row=np.asarray(row[order] if nj else [], dtype=np.int64),
        start=np.array(start, dtype=np.int64),
        other=np.array(other, dtype=np.int64),
        shared=np.array(shared, dtype=np.int64).reshape(-1, 3),
        shared_start=np.concatenate(([0], np.cumsum(counts))).astype(np.int64),
        update=np.array(update, dtype=np.int64).reshape(-1, 3),
        update_start=np.array(update_start, dtype=np.int64),
    )


def _rank_joint(left: dict[int, set[int]], j: int) -> tuple[int, int]:
    """Return the cost of eliminating joint ``j``: the number of links it adds, then the number of its neighbours.

    ``left`` are the neighbours of each joint that is not eliminated yet.
    """
    own = left[j]
    return sum(len(own) - 1 - len(own & left[k]) for k in own) // 2, len(own)
