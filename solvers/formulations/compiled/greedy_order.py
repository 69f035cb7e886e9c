"""Greedy order of elimination on a graph: the cheapest node comes next, and its neighbours are linked to each other."""

import heapq
from collections.abc import Callable, Collection, Sequence

Left = dict[int, set[int]]  # neighbours still there, by node


def eliminate(
    near: Sequence[set[int]], cost: Callable[[Left, int], tuple[int, ...]], first: Sequence[Collection[int]] = ()
) -> tuple[list[int], Left]:
    """Return an order of elimination of a graph's nodes, and for each node its neighbours eliminated later.

    ``near`` are the neighbours of each node; the node of least ``cost`` is next. A node comes after those that
    ``first`` lists for it. Costs may depend on a node's neighbours and theirs: only those around the last node are
    recomputed.
    """
    left = {k: set(n) for k, n in enumerate(near)}
    waits = {k: set(nodes) for k, nodes in enumerate(first) if nodes}
    rank = {k: (*cost(left, k), k) for k in left if k not in waits}
    queue = sorted(rank.values())
    order: list[int] = []
    later: Left = {}
    while left:
        found = heapq.heappop(queue)
        j = found[-1]
        if rank.get(j) != found:
            continue
        mine = left.pop(j)
        del rank[j]
        order.append(j)
        later[j] = mine
        for k in mine:
            left[k] |= mine
            left[k] -= {j, k}
            if k in waits:
                waits[k].discard(j)
        for k in mine.union(*(left[k] for k in mine)):
            if not waits.get(k) and (now := (*cost(left, k), k)) != rank.get(k):
                rank[k] = now
                heapq.heappush(queue, now)
    return order, later
