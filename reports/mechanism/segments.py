"""Bodies as line segments, from stored poses and joints alone: what drawings and animations of any problem share."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from ...harness.results.series import Series
from .theatre.poses import Poses, finite, rotations

SEEN = 0.2  # of an axis's length: shorter it points at the reader and is not drawn
SAME = 1e-9  # of the mechanism's size: joint points closer than this are one
LONE = 0.25  # [m] half a rod of a body that shows no length at all
CROSS = 0.18  # of a body's length: the bar at its free end, by which one sees it spin
FLAT = 0.02  # of the mechanism's size: motion this thin is seen from the front
TILT = np.deg2rad(20.0), np.deg2rad(35.0)  # elevation and turn of the view of a spatial motion


@dataclass(frozen=True)
class Mechanism:
    """Segments fixed in bodies, and the poses that carry them."""

    t: Float[np.ndarray, " nf"]
    r: Float[np.ndarray, "nf nb 3"]
    R: Float[np.ndarray, "nf nb 3 3"]
    body: Int[np.ndarray, " ns"]
    a: Float[np.ndarray, "ns 3"]
    b: Float[np.ndarray, "ns 3"]
    joint_body: Int[np.ndarray, " nj"]
    joint_at: Float[np.ndarray, "nj 3"]
    ground: Float[np.ndarray, "ng 3"]  # points of the ground that bodies hang on, in space
    gravity: Float[np.ndarray, " 3"]

    def segments(self, k: int) -> Float[np.ndarray, "ns 2 3"]:
        """Both ends of every segment in space, frame ``k``."""
        return np.stack((self._place(k, self.body, self.a), self._place(k, self.body, self.b)), axis=1)

    def joints(self, k: int) -> Float[np.ndarray, "nj 3"]:
        """Points of the joints in space, frame ``k``."""
        return self._place(k, self.joint_body, self.joint_at)

    @property
    def size(self) -> float:
        """[m] largest extent over all frames, at least one body."""
        reach = np.linalg.norm(np.concatenate((self.a, self.b)), axis=1).max(initial=LONE)
        return float(max(np.ptp(self.r.reshape(-1, 3), axis=0).max(initial=0.0), 2.0 * reach))

    def _place(self, k: int, body: np.ndarray, at: np.ndarray) -> np.ndarray:
        return self.r[k, body] + np.einsum("nij,nj->ni", self.R[k, body], at)


def mechanism_of(series: Series | None) -> Mechanism | None:
    """From a series file, up to the first pose that is no number; None where there is none."""
    needed = ("frame_t", "frame_r", "frame_q", "joint_i", "joint_j", "joint_s_i", "joint_s_j")
    if series is None or any(name not in series for name in needed):
        return None
    poses = finite(Poses(series["frame_t"], series["frame_r"].astype(float), series["frame_q"].astype(float)))
    if not len(poses):
        return None
    nf, nb = poses.r.shape[:2]
    R = rotations(poses.q).as_matrix().reshape(nf, nb, 3, 3)
    i, j = series["joint_i"].astype(int), series["joint_j"].astype(int)
    gravity = series["gravity"] if "gravity" in series else np.zeros(3)
    ground = series["joint_s_j"][j < 0]
    return Mechanism(poses.t, poses.r, R, *_segments(series, nb), i, series["joint_s_i"], ground, gravity)


def joint_points(series: Series, bodies: int, scale: float) -> list[Float[np.ndarray, "n 3"]]:
    """The distinct joint points of each body, body frame; ``scale`` [m] is that of the mechanism."""
    if "joint_i" not in series:
        return [np.zeros((0, 3))] * bodies
    owner, at = (np.concatenate([series[f"{k}_{side}"] for side in ("i", "j")]) for k in ("joint", "joint_s"))
    return [_distinct(at[owner == body].astype(float), SAME * scale) for body in range(bodies)]


def _segments(series: Series, nb: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    s_i, s_j = series["joint_s_i"], series["joint_s_j"][series["joint_j"] >= 0]
    found = []
    scale = float(np.abs(np.concatenate((s_i, s_j))).max(initial=0.0)) or LONE
    for body, points in enumerate(joint_points(series, nb, scale)):
        ends = points[np.linalg.norm(points, axis=1) > SAME * scale]
        if len(ends) == 2:
            found += [(body, *ends)]
        elif len(ends) > 2:
            found += [(body, np.zeros(3), p) for p in ends]
        elif len(ends) == 1:
            found += [(body, ends[0], -ends[0]), (body, *_cross(ends[0]))]
        else:
            found += [(body, -rod, rod) for rod in (scale if len(points) < len(s_i) else LONE) * np.eye(3)]
    return np.array([f[0] for f in found]), np.array([f[1] for f in found]), np.array([f[2] for f in found])


def _cross(end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A bar through the free end, across the body: along the body axis that lies most across it."""
    free, axis = -end, np.eye(3)[int(np.argmin(np.abs(end)))]
    across = axis - free * (axis @ free) / (free @ free)
    half = CROSS * 2.0 * np.linalg.norm(end) * across / np.linalg.norm(across)
    return free - half, free + half


def _distinct(points: np.ndarray, tolerance: float) -> np.ndarray:
    kept: list[np.ndarray] = []
    for p in points:
        if all(np.linalg.norm(p - k) > tolerance for k in kept):
            kept.append(p)
    return np.array(kept).reshape(-1, 3)


def view_of(mechanism: Mechanism) -> Float[np.ndarray, "2 3"]:
    """Directions of space that are right and up: against gravity is up, a planar motion is seen from the front."""
    g = mechanism.gravity
    up = -g / np.linalg.norm(g) if np.any(g) else np.array([0.0, 0.0, 1.0])
    seen = np.unique(np.linspace(0, len(mechanism.t) - 1, min(len(mechanism.t), 200)).astype(int))
    points = np.concatenate([mechanism.r[seen].reshape(-1, 3), *(mechanism.joints(k) for k in seen)])
    if np.ptp(points, axis=0).max() <= FLAT * mechanism.size:  # it turns about one point: then by its segments
        points = np.concatenate([mechanism.segments(k).reshape(-1, 3) for k in seen])
    level = points - np.outer(points @ up, up)
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
    """A mechanism at its start on paper: x right, y up [m]."""

    lines: Float[np.ndarray, "ns 2 2"]
    joints: Float[np.ndarray, "nj 2"]
    ground: Float[np.ndarray, "ng 2"]
    arrows: tuple[tuple[str, Float[np.ndarray, " 2"]], ...]  # unit vectors: axes of space, gravity
    names: tuple[tuple[str, Float[np.ndarray, " 2"]], ...]  # of the first and the last body, at C


def picture_of(series: Series | None) -> Picture | None:
    """The bodies with their joints and supports, gravity and the axes; None where no poses are stored."""
    mechanism = mechanism_of(series)
    if mechanism is None or series is None:
        return None
    view = view_of(mechanism)
    arrows = [(name, way) for name, e in zip("XYZ", np.eye(3), strict=True) if np.linalg.norm(way := view @ e) > SEEN]
    g = mechanism.gravity
    if np.any(g):
        arrows.append(("g", view @ (g / np.linalg.norm(g))))
    ends = sorted({0, len(series.body_names) - 1} & set(range(len(series.body_names))))
    names = tuple((series.body_names[k], view @ mechanism.r[0, k]) for k in ends)
    lines, joints, ground = (flat(p, view) for p in (mechanism.segments(0), mechanism.joints(0), mechanism.ground))
    return Picture(lines, joints, ground, tuple(arrows), names)


def flat(points: Float[np.ndarray, "*n 3"], view: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "*n 2"]:
    """Points on paper."""
    return points @ view.T
