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
    """Return the joints; those in loops get frames that fit exactly, unless they are open by more than ``OPEN``.

    Axes of revolute, prismatic and cylindrical joints in loops that are nearly parallel or normal become exactly so.
    """
    in_loops = _find_loop_joints(connections)
    out = [_close_connection(c) if k in in_loops else c for k, c in enumerate(connections)]
    with_axis = [k for k in sorted(in_loops) if out[k].kind in ONE_AXIS]
    axes = np.array([out[k].in_child.R @ out[k].axis for k in with_axis]).reshape(-1, 3)  # in space
    for k, aligned in zip(with_axis, _align_axes(axes), strict=True):
        c = out[k]
        child, parent = (_align_frame(frame, frame.R @ c.axis, aligned) for frame in (c.in_child, c.in_parent))
        out[k] = replace(c, in_child=child, in_parent=parent)
    return out


def _close_connection(c: Connection) -> Connection:
    """Return the joint with its two frames moved halfway to each other, where they differ by rounding.

    A joint that is closed, or open by more than ``OPEN``, is returned unchanged. A distance joint gets the measured
    length instead; of a universal joint only the child's frame is turned.
    """
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
    angle = {  # [rad] by which the directions that this kind of joint constrains are off; by default that of the axes
        JointKind.SPHERICAL: 0.0,
        JointKind.UNIVERSAL: 0.0,
        JointKind.FIXED: float(np.linalg.norm(turn)),
        JointKind.PRISMATIC: float(np.linalg.norm(turn)),
    }.get(c.kind, float(np.linalg.norm(between)))
    if c.kind is JointKind.UNIVERSAL and c.second is not None:
        angle = abs(float(axes[1] @ (child.R @ c.second)))
    opposite = axes[0] @ axes[1] < 0.0 < angle
    if np.linalg.norm(gap) > OPEN * scale or angle > OPEN or opposite:
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


def _align_frame(frame: Frame, direction: np.ndarray, target: np.ndarray) -> Frame:
    """Return the frame turned so that ``direction``, a unit vector in space, points along ``target``.

    It turns as little as possible, and not at all below ``EXACT``.
    """
    target = target / np.linalg.norm(target)
    axis = np.cross(direction, target)
    if np.linalg.norm(axis) <= EXACT:
        return frame
    return Frame(frame.p, Rotation.from_rotvec(axis).as_matrix() @ frame.R)  # the angle is small and equals its sine


def _align_axes(axes: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Return unit vectors, made exactly parallel or normal to each other where they are so to within ``ALIKE``.

    Vectors that are parallel are replaced by their mean, with their own signs.
    """
    out, means = axes.copy(), list[np.ndarray]()
    left = list(range(len(axes)))
    while left:
        first = axes[left[0]]
        group = [k for k in left if np.linalg.norm(np.cross(axes[k], first)) < ALIKE]
        signs = np.sign(axes[group] @ first)
        mean = np.sum(signs[:, None] * axes[group], axis=0)
        mean /= np.linalg.norm(mean)
        for other in means:
            if abs(mean @ other) < ALIKE:
                mean = mean - other * (mean @ other)
        mean /= np.linalg.norm(mean)
        means.append(mean)
        out[group] = signs[:, None] * mean
        left = [k for k in left if k not in group]
    return out


def _find_loop_joints(connections: Sequence[Connection]) -> set[int]:
    """Return the indices of the joints in loops: those without which their two bodies are still connected."""
    out = set()
    for k, c in enumerate(connections):
        reached, waiting = {c.child}, [c.child]
        while waiting:
            body = waiting.pop()
            for other in (o for n, o in enumerate(connections) if n != k and body in (o.child, o.parent)):
                for end in {other.child, other.parent} - reached:
                    reached.add(end)
                    waiting.append(end)
        if c.parent in reached:
            out.add(k)
    return out
