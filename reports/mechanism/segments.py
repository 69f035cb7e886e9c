"""Reduce bodies to line segments, from stored poses and joints alone, for drawings and animations of any problem."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from ...harness.results.series import Series
from .theatre.poses import Poses, make_rotations, select_finite

SEEN = 0.2  # an axis whose projection is shorter than this points at the reader and is not drawn
SAME = 1e-9  # fraction of the mechanism's size: joint points closer than this are one
LONE = 0.25  # [m] half length of the rod for a body whose joints give no length
CROSS = 0.18  # fraction of a body's length: the bar at its free end that makes its spin visible
FLAT = 0.02  # fraction of the mechanism's size: a motion thinner than this is planar and seen from the front
TILT = np.deg2rad(20.0), np.deg2rad(35.0)  # elevation and turn of the view of a spatial motion


@dataclass(frozen=True)
class DrawnMechanism:
    """A mechanism as line segments fixed in its bodies, and the poses over time that carry them."""

    t: Float[np.ndarray, " nf"]  # [s]
    r: Float[np.ndarray, "nf nb 3"]  # centres of mass [m, space frame]
    R: Float[np.ndarray, "nf nb 3 3"]  # body to space
    body: Int[np.ndarray, " ns"]  # body of each segment
    a: Float[np.ndarray, "ns 3"]  # its two ends [m, body frame]
    b: Float[np.ndarray, "ns 3"]
    joint_body: Int[np.ndarray, " nj"]  # first body of each joint
    joint_at: Float[np.ndarray, "nj 3"]  # the joint's point on it [m, body frame]
    ground: Float[np.ndarray, "ng 3"]  # joint points on the ground [m, space frame]
    gravity: Float[np.ndarray, " 3"]  # [m/s^2, space frame]

    def segments(self, k: int) -> Float[np.ndarray, "ns 2 3"]:
        """Return both ends of every segment at frame ``k`` [m, space frame]."""
        return np.stack((self._place(k, self.body, self.a), self._place(k, self.body, self.b)), axis=1)

    def joints(self, k: int) -> Float[np.ndarray, "nj 3"]:
        """Return the joint points at frame ``k`` [m, space frame]."""
        return self._place(k, self.joint_body, self.joint_at)

    @property
    def size(self) -> float:
        """The largest extent of the centres of mass over all frames, at least the size of one body [m]."""
        reach = np.linalg.norm(np.concatenate((self.a, self.b)), axis=1).max(initial=LONE)
        return float(max(np.ptp(self.r.reshape(-1, 3), axis=0).max(initial=0.0), 2.0 * reach))

    def _place(self, k: int, body: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Return points ``at``, fixed in the bodies ``body``, at frame ``k`` [m, space frame]."""
        return self.r[k, body] + np.einsum("nij,nj->ni", self.R[k, body], at)


def read_mechanism(series: Series | None) -> DrawnMechanism | None:
    """Return the mechanism of a series up to its first pose that is not finite; None without poses and joints."""
    needed = ("frame_t", "frame_r", "frame_q", "joint_i", "joint_j", "joint_s_i", "joint_s_j")
    if series is None or any(name not in series for name in needed):
        return None
    poses = select_finite(Poses(series["frame_t"], series["frame_r"].astype(float), series["frame_q"].astype(float)))
    if not len(poses):
        return None
    nf, nb = poses.r.shape[:2]
    R = make_rotations(poses.q).as_matrix().reshape(nf, nb, 3, 3)
    i, j = series["joint_i"].astype(int), series["joint_j"].astype(int)
    gravity = series["gravity"] if "gravity" in series else np.zeros(3)
    ground = series["joint_s_j"][j < 0]
    return DrawnMechanism(poses.t, poses.r, R, *_make_segments(series, nb), i, series["joint_s_i"], ground, gravity)


def find_joint_points(series: Series, bodies: int, scale: float) -> list[Float[np.ndarray, "n 3"]]:
    """Return the distinct joint points of each body [m, body frame]; ``scale`` [m] is the size of the mechanism."""
    if "joint_i" not in series:
        return [np.zeros((0, 3))] * bodies
    owner, at = (np.concatenate([series[f"{k}_{side}"] for side in ("i", "j")]) for k in ("joint", "joint_s"))
    return [_drop_repeated(at[owner == body].astype(float), SAME * scale) for body in range(bodies)]


def _make_segments(series: Series, nb: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the body of each segment and its two ends [m, body frame], derived from the joint points.

    Two joint points away from the centre of mass C give one segment, more of them a star from C, and one a rod through
    C with a cross bar at its free end. A body without such points gets three rods along its axes.
    """
    s_i, s_j = series["joint_s_i"], series["joint_s_j"][series["joint_j"] >= 0]
    found = []
    scale = float(np.abs(np.concatenate((s_i, s_j))).max(initial=0.0)) or LONE
    for body, points in enumerate(find_joint_points(series, nb, scale)):
        ends = points[np.linalg.norm(points, axis=1) > SAME * scale]
        if len(ends) == 2:
            found += [(body, *ends)]
        elif len(ends) > 2:
            found += [(body, np.zeros(3), p) for p in ends]
        elif len(ends) == 1:
            found += [(body, ends[0], -ends[0]), (body, *_make_cross_bar(ends[0]))]
        else:
            found += [(body, -rod, rod) for rod in (scale if len(points) < len(s_i) else LONE) * np.eye(3)]
    return np.array([f[0] for f in found]), np.array([f[1] for f in found]), np.array([f[2] for f in found])


def _make_cross_bar(end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the ends of a bar normal to a rod at its free end, near the body axis that is most nearly normal to it."""
    free, axis = -end, np.eye(3)[int(np.argmin(np.abs(end)))]
    across = axis - free * (axis @ free) / (free @ free)
    half = CROSS * 2.0 * np.linalg.norm(end) * across / np.linalg.norm(across)
    return free - half, free + half


def _drop_repeated(points: np.ndarray, tolerance: float) -> np.ndarray:
    """Return the points without those within ``tolerance`` [m] of an earlier one."""
    kept: list[np.ndarray] = []
    for p in points:
        if all(np.linalg.norm(p - k) > tolerance for k in kept):
            kept.append(p)
    return np.array(kept).reshape(-1, 3)


def choose_view(mechanism: DrawnMechanism) -> Float[np.ndarray, "2 3"]:
    """Return the directions of space drawn to the right and up, unit vectors as the rows of a matrix.

    Up is against gravity (Z without it), right is the level direction of the largest motion. A planar motion is seen
    from the front, a spatial one turned and from above by ``TILT``.
    """
    g = mechanism.gravity
    up = -g / np.linalg.norm(g) if np.any(g) else np.array([0.0, 0.0, 1.0])
    seen = np.unique(np.linspace(0, len(mechanism.t) - 1, min(len(mechanism.t), 200)).astype(int))
    points = np.concatenate([mechanism.r[seen].reshape(-1, 3), *(mechanism.joints(k) for k in seen)])
    if np.ptp(points, axis=0).max() <= FLAT * mechanism.size:  # it turns about one point: its segments show the plane
        points = np.concatenate([mechanism.segments(k).reshape(-1, 3) for k in seen])
    level = points - np.outer(points @ up, up)  # projected onto the plane normal to ``up``
    level -= level.mean(axis=0)
    _, sizes, axes = np.linalg.svd(level, full_matrices=False)
    right = axes[0] - up * (axes[0] @ up)
    right /= np.linalg.norm(right)
    right *= 1.0 if right[int(np.argmax(np.abs(right)))] > 0.0 else -1.0
    depth = np.ptp(level @ np.cross(right, up))
    if depth <= FLAT * mechanism.size or sizes[0] == 0.0:
        return np.stack((right, up))
    elevation, turn = TILT
    front = np.cross(right, up)
    towards = np.cos(turn) * front + np.sin(turn) * right
    across = np.cos(turn) * right - np.sin(turn) * front
    return np.stack((across, np.cos(elevation) * up - np.sin(elevation) * towards))


@dataclass(frozen=True)
class Picture:
    """A mechanism at its start, projected onto the drawing plane: x right, y up [m]."""

    lines: Float[np.ndarray, "ns 2 2"]
    joints: Float[np.ndarray, "nj 2"]
    ground: Float[np.ndarray, "ng 2"]
    arrows: tuple[tuple[str, Float[np.ndarray, " 2"]], ...]  # unit vectors: axes of space, gravity
    names: tuple[tuple[str, Float[np.ndarray, " 2"]], ...]  # names of the first and the last body, written at C


def draw_picture(series: Series | None) -> Picture | None:
    """Return the drawing of a mechanism at its start: bodies, joints, supports, gravity, axes; None without poses.

    An axis that points at the reader is left out, and only the first and the last body are named.
    """
    mechanism = read_mechanism(series)
    if mechanism is None or series is None:
        return None
    view = choose_view(mechanism)
    axes = ((name, view @ e) for name, e in zip("XYZ", np.eye(3), strict=True))
    arrows = [(name, projected) for name, projected in axes if np.linalg.norm(projected) > SEEN]
    g = mechanism.gravity
    if np.any(g):
        arrows.append(("g", view @ (g / np.linalg.norm(g))))
    ends = sorted({0, len(series.body_names) - 1} & set(range(len(series.body_names))))
    names = tuple((series.body_names[k], view @ mechanism.r[0, k]) for k in ends)
    lines, joints, ground = (
        project_points(p, view) for p in (mechanism.segments(0), mechanism.joints(0), mechanism.ground)
    )
    return Picture(lines, joints, ground, tuple(arrows), names)


def project_points(points: Float[np.ndarray, "*n 3"], view: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "*n 2"]:
    """Return the coordinates of points along the two directions of ``view``, right and up [m]."""
    return points @ view.T
