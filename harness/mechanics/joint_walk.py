"""Find the order in which joints reach bodies from the ground: the spanning tree behind all joint coordinates."""

from collections.abc import Collection
from typing import NamedTuple

from .system import GROUND, MultibodySystem

FLOATS = -1  # stands for the joint to a body that no joint reaches


class Walk(NamedTuple):
    """A spanning tree: by body, in the order reached, its parent and the joint to it; children by parent."""

    reached: dict[int, tuple[int, int]]  # by body: (parent, joint); FLOATS for no joint
    children: dict[int, list[int]]


def walk_joints(system: MultibodySystem, followed: Collection[str], uncut: Collection[str] = ()) -> Walk:
    """Build a spanning tree of the bodies along joints of the kinds ``followed``, breadth first from the ground.

    Joints of the kinds ``uncut`` are followed as soon as one of their bodies is reached, so that none of them closes a
    loop that another can close. A group of bodies that no such joint connects to the ground floats on its first body.
    """
    walk = Walk({}, {body: [] for body in range(GROUND, system.nb)})
    neighbours: dict[int, list[tuple[int, int]]] = {body: [] for body in range(GROUND, system.nb)}
    kinds = [system.joint_kind(k) for k in range(system.nj)]
    for k, (i, j) in enumerate(zip(system.joint_i.tolist(), system.joint_j.tolist(), strict=True)):
        if kinds[k] in followed:
            neighbours[i].append((j, k))
            neighbours[j].append((i, k))

    def reach(parent: int, only: Collection[str], queue: list[int]) -> None:
        """Add the bodies that joints of the kinds ``only`` reach from ``parent`` to the tree and to ``queue``."""
        for body, k in neighbours[parent]:
            if body != GROUND and body not in walk.reached and kinds[k] in only:
                walk.reached[body] = (parent, k)
                walk.children[parent].append(body)
                queue.append(body)
                reach(body, uncut, queue)

    def spread(root: int) -> None:
        """Add all bodies that joints reach from ``root``, breadth first."""
        queue = [root]
        reach(root, uncut, queue)
        for parent in queue:  # the list grows during the loop
            reach(parent, followed, queue)

    spread(GROUND)
    for body in range(system.nb):
        if body not in walk.reached:
            walk.reached[body] = (GROUND, FLOATS)
            walk.children[GROUND].append(body)
            spread(body)
    return walk
