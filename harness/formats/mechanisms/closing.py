"""Close joints of loops that rounding leaves open at the start by moving their frames, never the bodies.

In files in float32, or printed to few digits, the two frames of a joint differ by rounding. Moving the bodies instead
has no solution where a loop has redundant rows, because these then contradict each other by as much. For the same
reason, axes of loops that are parallel or normal to each other within rounding are made exactly so; otherwise a planar
loop could not move.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ...mechanics.joints import JointKind
from .links import Connection, Frame
from .rates import OPEN

EXACT = 1e-13  # relative to the size, and for directions: below it nothing is moved
ALIKE = OPEN  # directions in a loop that differ by less from parallel or normal are intended to be so
ONE_AXIS = (JointKind.REVOLUTE, JointKind.PRISMATIC, JointKind.CYLINDRICAL)
# kinds whose two points coincide
PINNED = (JointKind.REVOLUTE, JointKind.SPHERICAL, JointKind.UNIVERSAL, JointKind.FIXED)


def close_joints(connections: Sequence[Connection]) -> list[Connection]:
    """Return the joints, with frames in loops moved to fit exactly unless they are open by more than ``OPEN``."""
    in_loops = _find_looped(connections)
    out = [_close_connection(c) if k in in_loops else c for k, c in enumerate(connections)]
    looped = [k for k in sorted(in_loops) if out[k].kind in ONE_AXIS]
    ways = np.array([out[k].in_child.R @ out[k].axis for k in looped]).reshape(-1, 3)
    for k, way in zip(looped, _align(ways), strict=True):
        c = out[k]
        child, parent = (_align_frame(frame, frame.R @ c.axis, way) for frame in (c.in_child, c.in_parent))
        out[k] = replace(c, in_child=child, in_parent=parent)
    return out


def _close_connection(c: Connection) -> Connection:
    """Return a joint with its two frames, open by rounding, moved to each other; unchanged if closed or wide open."""
    child, parent = c.in_child, c.in_parent
    gap = child.p - parent.p
    scale = max(1.0, float(np.max(np.abs(child.p))), float(np.max(np.abs(parent.p))))
    if c.kind is JointKind.DISTANCE:
        off = abs(float(np.linalg.norm(gap)) - c.length)
        return replace(c, length=float(np.linalg.norm(gap))) if EXACT * scale < off <= OPEN * scale else c
    axes = [f.R @ c.axis for f in (child, parent)]
    if c.kind not in PINNED:  # it slides along the axis
        gap = gap - axes[1] * (axes[1] @ gap)
    turn = Rotation.from_matrix(parent.R @ child.R.T).as_rotvec()
    between = np.cross(axes[0], axes[1])
    angle = {
        JointKind.SPHERICAL: 0.0,
        JointKind.UNIVERSAL: 0.0,
        JointKind.FIXED: float(np.linalg.norm(turn)),
        JointKind.PRISMATIC: float(np.linalg.norm(turn)),
    }.get(c.kind, float(np.linalg.norm(between)))
    if c.kind is JointKind.UNIVERSAL and c.second is not None:
        angle = abs(float(axes[1] @ (child.R @ c.second)))
    if np.linalg.norm(gap) > OPEN * scale or angle > OPEN or axes[0] @ axes[1] < 0.0 < angle:
        return c
    if np.linalg.norm(gap) > EXACT * scale:
        child, parent = Frame(child.p - 0.5 * gap, child.R), Frame(parent.p + 0.5 * gap, parent.R)
    if angle <= EXACT:
        return replace(c, in_child=child, in_parent=parent)
    if c.kind in (JointKind.FIXED, JointKind.PRISMATIC):
        R = Rotation.from_rotvec(0.5 * turn).as_matrix() @ child.R
        return replace(c, in_child=Frame(child.p, R), in_parent=Frame(parent.p, R))
    if c.kind is JointKind.UNIVERSAL and c.second is not None:
        b = child.R @ c.second
        return replace(c, in_parent=parent, in_child=_align_frame(child, b, b - axes[1] * (axes[1] @ b)))
    middle = axes[0] + axes[1]
    return replace(c, in_child=_align_frame(child, axes[0], middle), in_parent=_align_frame(parent, axes[1], middle))


def _align_frame(frame: Frame, way: np.ndarray, to: np.ndarray) -> Frame:
    """Return the frame turned as little as possible so that ``way``, a unit vector in space, points along ``to``."""
    to = to / np.linalg.norm(to)
    axis = np.cross(way, to)
    if np.linalg.norm(axis) <= EXACT:
        return frame
    return Frame(frame.p, Rotation.from_rotvec(axis).as_matrix() @ frame.R)  # the angle is small and equals its sine


def _align(ways: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Return unit vectors, made exactly parallel or normal to each other where they are so to within ``ALIKE``."""
    out, means = ways.copy(), list[np.ndarray]()
    left = list(range(len(ways)))
    while left:
        first = ways[left[0]]
        group = [k for k in left if np.linalg.norm(np.cross(ways[k], first)) < ALIKE]
        signs = np.sign(ways[group] @ first)
        mean = np.sum(signs[:, None] * ways[group], axis=0)
        mean /= np.linalg.norm(mean)
        for other in means:
            if abs(mean @ other) < ALIKE:
                mean = mean - other * (mean @ other)
        mean /= np.linalg.norm(mean)
        means.append(mean)
        out[group] = signs[:, None] * mean
        left = [k for k in left if k not in group]
    return out


def _find_looped(connections: Sequence[Connection]) -> set[int]:
    """Return the indices of the joints in loops: without such a joint its two bodies are still connected."""
    out = set()
    for k, c in enumerate(connections):
        reached, fresh = {c.child}, [c.child]
        while fresh:
            body = fresh.pop()
            for other in (o for n, o in enumerate(connections) if n != k and body in (o.child, o.parent)):
                for end in {other.child, other.parent} - reached:
                    reached.add(end)
                    fresh.append(end)
        if c.parent in reached:
            out.add(k)
    return out
