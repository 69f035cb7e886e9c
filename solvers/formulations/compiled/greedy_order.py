"""Greedy order of elimination on a graph: the cheapest node comes next, and its neighbours are linked to each other."""

import heapq
from collections.abc import Callable, Collection, Sequence

Left = dict[int, set[int]]  # neighbours still there, by node


def find_elimination_order(
    neighbours: Sequence[set[int]], cost: Callable[[Left, int], tuple[int, ...]], first: Sequence[Collection[int]] = ()
) -> tuple[list[int], Left]:
    """Return an order of elimination of a graph's nodes, and for each node its neighbours eliminated later.

    ``neighbours`` are those of each node at first; the node of least ``cost(neighbours left, node)`` is next. A node
    comes after those that ``first`` lists for it; without ``first`` none has to wait. A cost may depend on a node's
    neighbours and theirs: only the costs around the node eliminated last are computed again.
    """
    left = {k: set(n) for k, n in enumerate(neighbours)}
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
        own = left.pop(j)
        del rank[j]
        order.append(j)
        later[j] = own
        for k in own:
            left[k] |= own
            left[k] -= {j, k}
            if k in waits:
                waits[k].discard(j)
        for k in own.union(*(left[k] for k in own)):
            if not waits.get(k) and (now := (*cost(left, k), k)) != rank.get(k):
                rank[k] = now
                heapq.heappush(queue, now)
    return order, later
