"""Pictures of the joints for docs/joints-and-forces.md: arrows along and about the axes that a joint leaves free.

They are read off the rows: body i stands on the ground at the origin, the axis of the joint is z, ``across`` is x, and
a motion is free where its column of A is zero. ``make joints`` writes them to docs/images/joints/.
"""

import sys
from pathlib import Path

import numpy as np

from mbsbench import Joint, JointKind, RigidBody, State, assemble, constraint_jacobian

SIZE = 120  # [px]
VIEW = np.array([[0.80, -0.80, 0.0], [0.42, 0.42, -0.95]]) * 0.36 * SIZE  # of x, y, z; the picture's y is downwards
HEAD = 8.0  # [px]


def free_motions(kind: JointKind) -> np.ndarray:
    """Which of the six motions of body i are free: along x, y, z, about x, y, z."""
    x, z, o = np.eye(3)[0], np.eye(3)[2], np.zeros(3)
    both = {"kind": kind, "across_i": x, "across_j": x}
    joint = {
        JointKind.SPHERICAL: Joint(0, o),
        JointKind.DISTANCE: Joint(0, o, s_j=-z, kind=kind, length=1.0),
        JointKind.ON_LINE: Joint(0, o, axis_j=z, kind=kind), JointKind.ON_PLANE: Joint(0, o, axis_j=z, kind=kind),
        JointKind.UNIVERSAL: Joint(0, o, axis_i=x, axis_j=z, kind=kind),
        JointKind.NORMAL: Joint(0, o, axis_i=x, axis_j=z, kind=kind),
    }.get(kind, Joint(0, o, axis_i=z, axis_j=z, **both))  # fmt: skip
    system = assemble([RigidBody(1.0, np.eye(3))], [joint])
    start = State(np.zeros((1, 3)), np.eye(3)[None], np.zeros((1, 3)), np.zeros((1, 3)))
    return np.all(np.abs(constraint_jacobian(system, start).toarray()) < 1e-12, axis=0)


def picture(kind: JointKind) -> str:
    """As SVG."""
    free, e = free_motions(kind), np.eye(3)
    parts = [_path(np.stack((-e[k], e[k])), "#999", 1) for k in range(3)]
    for k in range(3):
        if free[k]:
            parts += _arrow(np.stack((-0.9 * e[k], 0.9 * e[k])), "#1f77b4")
        if free[3 + k]:
            turn = np.radians(np.linspace(20.0, 320.0, 31))[:, None]
            ring = 0.55 * e[k] + 0.3 * (np.cos(turn) * e[(k + 1) % 3] + np.sin(turn) * e[(k + 2) % 3])
            parts += _arrow(ring, "#d62728")
    size = f'width="{SIZE}" height="{SIZE}" viewBox="0 0 {SIZE} {SIZE}"'
    inside = "\n".join((f"<title>{kind}</title>", *parts))
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>\n{inside}\n</svg>\n'


def _arrow(points: np.ndarray, colour: str) -> list[str]:
    """A line with a head at either end."""
    heads = []
    for tip, before in ((points[0], points[1]), (points[-1], points[-2])):
        along = (tip - before) @ VIEW.T
        along *= HEAD / np.linalg.norm(along)
        across, at = 0.45 * np.array([-along[1], along[0]]), SIZE / 2 + tip @ VIEW.T
        corners = " ".join(f"{x:.1f},{y:.1f}" for x, y in (at + along, at + across, at - across))
        heads.append(f'<polygon points="{corners}" fill="{colour}"/>')
    return [_path(points, colour, 2), *heads]


def _path(points: np.ndarray, colour: str, width: int) -> str:
    way = "L".join(f"{x:.1f} {y:.1f}" for x, y in SIZE / 2 + points @ VIEW.T)
    return f'<path d="M{way}" fill="none" stroke="{colour}" stroke-width="{width}"/>'


def name(kind: JointKind) -> str:
    """Of the file."""
    return f"{kind.replace(' ', '-')}.svg"


if __name__ == "__main__":
    for one in JointKind:
        (Path(sys.argv[1]) / name(one)).write_text(picture(one))
