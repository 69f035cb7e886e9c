"""Write tables of docs/joints-and-forces.md, and pictures of joints: arrows along and about the axes that are free.

Both come from the declarations. Pictures are computed from the rows: body i stands on the ground at the origin, the
axis of the joint is z, ``across`` is x, and a motion is free where its column of A is zero. ``make joints`` writes all.
"""

import mbsbench  # noqa: F401  before NumPy: it pins the arithmetic

# isort: split
import sys
from pathlib import Path

import numpy as np

from mbsbench import Joint, RigidBody, State, assemble, constraint_jacobian
from mbsbench.harness.mechanics.declaring import Count, JointDeclaration
from mbsbench.harness.mechanics.forces import DECLARED as FORCES
from mbsbench.harness.mechanics.joints import DECLARED
from mbsbench.harness.mechanics.joints.frames import make_axis_frame

SIZE = 120  # [px]
VIEW = np.array([[0.80, -0.80, 0.0], [0.42, 0.42, -0.95]]) * 0.36 * SIZE  # of x, y, z; the picture's y is downwards
HEAD = 8.0  # [px]


def list_drawn_kinds() -> list[JointDeclaration]:
    """Return the joint kinds with a picture: those without moving rows, whose free motions are along or about axes."""
    return [one for one in DECLARED.values() if not one.count.moving]


def find_free_motions(kind: JointDeclaration) -> np.ndarray:
    """Return which of the six motions of body i a joint leaves free: along x, y, z, about x, y, z."""
    x, z, o = np.eye(3)[0], np.eye(3)[2], np.zeros(3)
    joint = Joint(
        0,
        o,
        s_j=-z if kind.length else o,
        kind=kind.name,
        length=1.0 if kind.length else 0.0,
        axis_i=(x if kind.frame is make_axis_frame else z) if "i" in kind.axes else None,
        axis_j=z if "j" in kind.axes else None,
        across_i=x if kind.across else None,
        across_j=x if kind.across else None,
    )
    system = assemble([RigidBody(1.0, np.eye(3))], [joint])
    start = State(np.zeros((1, 3)), np.eye(3)[None], np.zeros((1, 3)), np.zeros((1, 3)))
    return np.all(np.abs(constraint_jacobian(system, start).toarray()) < 1e-12, axis=0)


def draw_picture(kind: JointDeclaration) -> str:
    """Return the picture of a joint kind as SVG: the axes, and an arrow for each free motion."""
    free, e = find_free_motions(kind), np.eye(3)
    parts = [_path(np.stack((-e[k], e[k])), "#999", 1) for k in range(3)]
    for k in range(3):
        if free[k]:
            parts += _arrow(np.stack((-0.9 * e[k], 0.9 * e[k])), "#1f77b4")
        if free[3 + k]:
            turn = np.radians(np.linspace(20.0, 320.0, 31))[:, None]
            ring = 0.55 * e[k] + 0.3 * (np.cos(turn) * e[(k + 1) % 3] + np.sin(turn) * e[(k + 2) % 3])
            parts += _arrow(ring, "#d62728")
    size = f'width="{SIZE}" height="{SIZE}" viewBox="0 0 {SIZE} {SIZE}"'
    inside = "\n".join((f"<title>{kind.name}</title>", *parts))
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>\n{inside}\n</svg>\n'


def _arrow(points: np.ndarray, colour: str) -> list[str]:
    """Return the SVG elements of a line with a head at either end."""
    heads = []
    for tip, before in ((points[0], points[1]), (points[-1], points[-2])):
        along = (tip - before) @ VIEW.T
        along *= HEAD / np.linalg.norm(along)
        across, at = 0.45 * np.array([-along[1], along[0]]), SIZE / 2 + tip @ VIEW.T
        corners = " ".join(f"{x:.1f},{y:.1f}" for x, y in (at + along, at + across, at - across))
        heads.append(f'<polygon points="{corners}" fill="{colour}"/>')
    return [_path(points, colour, 2), *heads]


def _path(points: np.ndarray, colour: str, width: int) -> str:
    """Return the SVG element of a line through points in space."""
    way = "L".join(f"{x:.1f} {y:.1f}" for x, y in SIZE / 2 + points @ VIEW.T)
    return f'<path d="M{way}" fill="none" stroke="{colour}" stroke-width="{width}"/>'


def name_file(kind: JointDeclaration) -> str:
    """Return the name of the file with the picture of a joint kind."""
    return f"{kind.name.replace(' ', '-')}.svg"


def describe_given(kind: JointDeclaration) -> str:
    """Describe what a user specifies for a joint of this kind."""
    points = "" if kind.count == Count(axis=kind.count.axis) else "points"
    axes = {"": "", "i": f"`axis_i`, {kind.note}", "j": "`axis_j`", "ij": "the axis in both bodies"}[kind.axes]
    if kind.axes == "ij" and kind.frame is make_axis_frame:
        axes = "`axis_i`, `axis_j`, normal to each other"
    across = "`across_i`, `across_j`" if kind.across else ""
    length = f"`length`, {kind.length}" if kind.length else ""
    motion = f"{'' if kind.needs_motion else 'perhaps '}`motion` f [{kind.motion}]" if kind.motion else ""
    return kind.given or ", ".join(part for part in (points, axes, across, length, motion) if part)


def make_tables() -> dict[str, list[str]]:
    """Return the lines of each table, by the name in its first comment in the page."""
    joints = ["| | `kind` | rows | given | leaves free |", "|---|---|---|---|---|"]
    moving = ["| `kind` | rows | given | leaves free |", "|---|---|---|---|"]
    forces = ["| force | load on body i, the opposite on j | energy |", "|---|---|---|"]
    for kind in DECLARED.values():
        words = (
            f"`{kind.name}` | {kind.equation.replace('|', chr(92) + '|')} | {describe_given(kind)} | {kind.leaves} |"
        )
        if kind.count.moving:
            moving.append(f"| {words}")
        else:
            joints.append(f"| ![{kind.name}](images/joints/{name_file(kind)}) | {words}")
    forces += [f"| `{one.part}` | {one.equation} | {one.energy} |" for one in FORCES.values()]
    return {"joints": joints, "rows beside joints": moving, "forces": forces}


def fill_page(text: str) -> str:
    """Return the ``text`` of the page with its tables replaced by those made from the declarations."""
    for what, lines in make_tables().items():
        start = f"<!-- {what}: written by make joints -->\n"
        before, after = text.split(start)
        text = before + start + "\n" + "\n".join(lines) + "\n\n" + after[after.index("<!-- end -->") :]
    return text


if __name__ == "__main__":
    for one in list_drawn_kinds():
        (Path(sys.argv[1]) / name_file(one)).write_text(draw_picture(one))
    manual = Path(__file__).parent / "joints-and-forces.md"
    manual.write_text(fill_page(manual.read_text(encoding="utf-8")), encoding="utf-8")
