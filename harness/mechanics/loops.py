"""Detect loops of joints: bodies that joints connect in more than one way."""

from .system import GROUND, MultibodySystem


def has_loops(system: MultibodySystem) -> bool:
    """Return whether some joint connects two bodies that other joints already connect."""
    above = list(range(system.nb + 1))  # union-find: each body's parent; the ground is the last entry
    for i, j in zip(system.joint_i, system.joint_j, strict=True):
        a, b = (int(body) if body != GROUND else system.nb for body in (i, j))
        while above[a] != a:
            a = above[a]
        while above[b] != b:
            b = above[b]
        if a == b:
            return True
        above[a] = b
    return False
