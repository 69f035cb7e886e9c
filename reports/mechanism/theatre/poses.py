"""Select the stored poses to draw, measure the error of drawing them, and compress poses and strips for a page."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

LEVELS = 32767
DIGITS = 9  # bits of mantissa that a strip keeps: 1/1024 of the value at most, below a pixel
FIRST = 48  # poses tried at first
NEAR = 0.01  # [body sizes] distance of drawn from stored poses that adds no pose
TURNED = 0.03  # [rad]
ALIKE = 0.5  # [rad, body sizes] below it a run's error is taken as smooth between two stored poses
AT_ONCE = 0.25  # fraction of the worst distance: halving a chord divides its distance by four


@dataclass(frozen=True)
class Box:
    """A box whose grid of int16 holds positions to half a step; points outside are moved to its wall."""

    low: Float[np.ndarray, " 3"]  # [m, space frame], as ``high``
    high: Float[np.ndarray, " 3"]

    @property
    def quantum(self) -> Float[np.ndarray, " 3"]:
        """The step of the int16 grid [m]; positions are off by at most half of it."""
        return np.maximum(self.high - self.low, 1e-12) / (2 * LEVELS)

    def widen(self, by: float) -> "Box":
        """Return the box with its walls moved out by ``by`` times its largest side."""
        out = by * float(np.max(self.high - self.low))
        return Box(self.low - out, self.high + out)


def bound_points(points: Float[np.ndarray, "*n 3"]) -> Box:
    """Return the smallest box around all finite points; a unit cube around the origin if there is none."""
    flat = points.reshape(-1, 3)
    flat = flat[np.all(np.isfinite(flat), axis=1)]
    if len(flat) == 0:
        return Box(np.full(3, -0.5), np.full(3, 0.5))
    return Box(flat.min(axis=0).astype(float), flat.max(axis=0).astype(float))


def quantise_positions(r: Float[np.ndarray, "nf nb 3"], box: Box) -> Int[np.ndarray, "nf nb 3"]:
    """Return positions as whole steps of the box's grid (int16), 0 in the middle of the box."""
    middle = 0.5 * (box.low + box.high)
    steps = np.rint((r.astype(float) - middle) / box.quantum)
    return np.clip(steps, -LEVELS, LEVELS).astype(np.int16)


def quantise_quaternions(q: Float[np.ndarray, "nf nb 4"]) -> Int[np.ndarray, "nf nb 4"]:
    """Return unit quaternions in whole steps of 1/32767 (int16), each with the sign nearer to the one before."""
    q = q.astype(float)
    turns = np.sign(np.sum(q[1:] * q[:-1], axis=-1))
    turns[turns == 0.0] = 1.0
    q[1:] *= np.cumprod(turns, axis=0)[..., None]
    return np.rint(np.clip(q, -1.0, 1.0) * LEVELS).astype(np.int16)


def flatten_columns(a: Int[np.ndarray, "nf n"]) -> Int[np.ndarray, " m"]:
    """Return all columns one after another, shifted by ``LEVELS`` so that no value is negative.

    A page stores the differences of neighbouring values, which compress well.
    """
    return a.T.astype(np.int64).ravel() + LEVELS


def round_mantissa(a: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """Round values to ``DIGITS`` bits of mantissa, which compress well."""
    fraction, power = np.frexp(a)
    return np.ldexp(np.rint(np.ldexp(fraction, DIGITS)), power - DIGITS)


@dataclass(frozen=True)
class Poses:
    """The poses of one run over time; quaternions are (x, y, z, w)."""

    t: Float[np.ndarray, " nf"]  # [s]
    r: Float[np.ndarray, "nf nb 3"]  # centres of mass [m, space frame]
    q: Float[np.ndarray, "nf nb 4"]

    def select_rows(self, k: Int[np.ndarray, " n"]) -> "Poses":
        """Return the poses of the rows ``k``."""
        return Poses(self.t[k], self.r[k], self.q[k])

    def __len__(self) -> int:
        return len(self.t)


def select_finite(poses: Poses) -> Poses:
    """Return the poses before the first one that is not finite or has a zero quaternion."""
    good = np.isfinite(poses.t) & np.isfinite(poses.r).all(axis=(1, 2)) & np.isfinite(poses.q).all(axis=(1, 2))
    good &= poses.q.any(axis=-1).all(axis=-1)
    return poses.select_rows(np.flatnonzero(np.logical_and.accumulate(good)))


def thin_poses(poses: Poses, at_most: int, size: float) -> Int[np.ndarray, " n"]:
    """Return the rows of at most ``at_most`` poses to draw, including first and last.

    They are spaced evenly in the sum of relative time and of the relative path of the body that moves furthest. A turn
    of 1 rad counts as a path of ``size`` [m].
    """
    n = len(poses)
    if n <= max(at_most, 2):
        return np.arange(n)
    path = np.max(np.linalg.norm(np.diff(poses.r, axis=0), axis=-1) + size * measure_turns(poses.q), axis=1)
    time = np.diff(poses.t)
    measure = time / max(float(np.sum(time)), 1e-300) + path / max(float(np.sum(path)), 1e-300)
    passed = np.concatenate(([0.0], np.cumsum(measure)))
    rows = np.searchsorted(passed, np.linspace(0.0, passed[-1], max(at_most, 2)))
    rows[-1] = n - 1
    return np.unique(np.minimum(rows, n - 1))


@dataclass(frozen=True)
class ChosenPoses:
    """The rows of the poses that draw a motion, and how far what they draw is off the stored poses at most."""

    rows: Int[np.ndarray, " n"]
    distance: float  # [m]
    angle: float  # [rad]


def choose_poses(poses: Poses, at_most: int, size: float) -> ChosenPoses:
    """Choose few rows that draw all stored poses to within ``NEAR`` times ``size`` [m] and ``TURNED`` [rad].

    Starting from a few rows, the worst drawn pose of each gap is added, unless it deviates by less than ``AT_ONCE``
    times the worst of all. This ends when all poses are near, or there are ``at_most`` rows.
    """
    rows = thin_poses(poses, min(FIRST, at_most), size)
    ends = _find_neighbours(poses, rows)
    distance, angle = measure_deviations(poses, rows)
    while len(rows) < at_most:
        excess = np.maximum(distance / (NEAR * size), angle / TURNED)  # above 1: not near enough
        worst = np.argsort(-excess, kind="stable")
        _, first = np.unique(np.searchsorted(rows, worst, side="right"), return_index=True)  # the worst of each gap
        missing = worst[np.sort(first)]
        missing = missing[excess[missing] > max(1.0, AT_ONCE * excess[worst[0]])]
        if not len(missing):
            break
        rows = np.union1d(rows, missing[: at_most - len(rows)])
        before, ends = ends, _find_neighbours(poses, rows)
        moved = np.flatnonzero(np.any(ends != before, axis=0))  # all others are drawn by the same two poses as before
        distance[moved], angle[moved] = measure_deviations(poses, rows, moved)
    return ChosenPoses(rows, float(np.max(distance)), float(np.max(angle)))


def _find_neighbours(poses: Poses, kept: Int[np.ndarray, " n"]) -> Int[np.ndarray, "2 nf"]:
    """Return the rows of the two kept poses between which each pose is interpolated."""
    k, j = _find_gap(poses.t[kept], poses.t)
    return np.stack((kept[k], kept[j]))


def _find_gap(known: Float[np.ndarray, " n"], t: Float[np.ndarray, " m"]) -> tuple[np.ndarray, np.ndarray]:
    """Return the indices of the two ``known`` times between which each time ``t`` lies.

    Outside the known times these are the first two or the last two; a single known time is both.
    """
    k = np.clip(np.searchsorted(known, t, side="right") - 1, 0, max(len(known) - 2, 0))
    return k, np.minimum(k + 1, len(known) - 1)


def measure_turns(q: Float[np.ndarray, "nf nb 4"]) -> Float[np.ndarray, "m nb"]:
    """Return the angle from each orientation to the next [rad]."""
    q = normalize(q)
    return measure_angles(q[:-1], q[1:])


def normalize(q: Float[np.ndarray, "nf nb 4"]) -> Float[np.ndarray, "nf nb 4"]:
    """Return the quaternions scaled to length 1."""
    q = q.astype(float)
    return q / np.sqrt(np.einsum("...i,...i", q, q))[..., None]


def measure_angles(a: Float[np.ndarray, "nf nb 4"], b: Float[np.ndarray, "nf nb 4"]) -> Float[np.ndarray, "nf nb"]:
    """Return the smaller angle between unit quaternions ``a`` and ``b`` [rad], exact near zero."""
    return 4.0 * _halve_angle(a, b)[0]


def _halve_angle(
    a: Float[np.ndarray, "nf nb 4"], b: Float[np.ndarray, "nf nb 4"]
) -> tuple[Float[np.ndarray, "nf nb"], Float[np.ndarray, "nf nb"]]:
    """Return half the angle between unit quaternions as vectors [rad], a quarter of the angle of rotation, and a sign.

    Of b and -b, which are the same rotation, the one nearer to a is taken; the sign is 1 for b, -1 for -b.
    """
    apart, together = a - b, a + b
    d, s = (np.sqrt(np.einsum("...i,...i", x, x)) for x in (apart, together))
    return np.arctan2(np.minimum(d, s), np.maximum(d, s)), np.where(d > s, -1.0, 1.0)


def measure_rates(poses: Poses, body: int) -> Float[np.ndarray, "m 3"]:
    """Return the mean angular velocity of a body between stored poses [rad/s, body frame], by the smaller rotation."""
    R = Rotation.from_quat(poses.q[:, body])
    return (R[:-1].inv() * R[1:]).as_rotvec() / np.maximum(np.diff(poses.t), 1e-300)[:, None]


def interpolate_poses(poses: Poses, t: Float[np.ndarray, " n"]) -> Poses:
    """Interpolate positions linearly and orientations along the great circle at times ``t`` [s], as the page does.

    Outside the times of the poses, the first or the last pose is returned.
    """
    k, j = _find_gap(poses.t, t)
    gap = poses.t[j] - poses.t[k]
    u = np.clip(np.divide(t - poses.t[k], gap, out=np.zeros(len(t)), where=gap > 0.0), 0.0, 1.0)[:, None, None]
    q = normalize(poses.q)
    half, sign = _halve_angle(q[k], q[j])
    arc = 2.0 * half[..., None]
    whole = np.sinc(arc / np.pi)  # sin(u arc) / sin(arc), exact at zero
    near, far = (x * np.sinc(x * arc / np.pi) / whole for x in (1.0 - u, u))
    return Poses(t, (1.0 - u) * poses.r[k] + u * poses.r[j], near * q[k] + far * sign[..., None] * q[j])


def make_rotations(q: Float[np.ndarray, "nf nb 4"]) -> Rotation:
    """Return all quaternions as one flat sequence of rotations."""
    return Rotation.from_quat(q.reshape(-1, 4))


def fill_gaps(poses: Poses, exact: Poses, size: float) -> tuple[Poses, int, tuple[tuple[float, float], ...]]:
    """Return the poses with others added where interpolation is inaccurate, the number added, and the unknown spans.

    An added pose is that of the exact motion plus the run's error, which is interpolated between the stored poses at
    both ends; ``size`` [m] is the size of a body. A gap in which the exact motion turns by more than pi, with an end
    far from it, cannot be filled and is an unknown span [s].
    """
    inside = (exact.t > poses.t[0]) & (exact.t < poses.t[-1]) & ~np.isin(exact.t, poses.t)
    between = exact.select_rows(np.flatnonzero(inside))  # the exact motion between the stored poses, and at them
    at_stored = interpolate_poses(exact, poses.t)
    conjugate, own = at_stored.q * [-1.0, -1.0, -1.0, 1.0], normalize(poses.q)
    error = Poses(poses.t, poses.r - at_stored.r, _multiply_quaternions(conjugate, own))
    angle = measure_angles(at_stored.q, own)
    far = np.maximum(np.linalg.norm(error.r, axis=-1) / size, angle).max(axis=1) > ALIKE
    far |= poses.t > exact.t[-1] * (1.0 + 1e-12)
    far = far[1:] | far[:-1]
    turned = np.interp(poses.t, exact.t, np.append(0.0, np.cumsum(np.max(measure_turns(exact.q), axis=1))))
    unknown = np.flatnonzero(far & (np.diff(turned) > np.pi))
    spans = tuple((float(poses.t[k]), float(poses.t[k + 1])) for k in unknown)
    if not len(between):
        return poses, 0, spans
    error_there = interpolate_poses(error, between.t)
    added = Poses(between.t, between.r + error_there.r, _multiply_quaternions(normalize(between.q), error_there.q))
    distance, angle = _compare_poses(interpolate_poses(poses, between.t), added)
    gap = np.searchsorted(poses.t, between.t, side="right") - 1
    is_inaccurate = np.zeros(len(far), dtype=bool)
    # fill all of a gap: after whole turns a pose may fit by chance
    is_inaccurate[gap[(distance > NEAR * size) | (angle > TURNED)]] = True
    added = added.select_rows(np.flatnonzero((is_inaccurate & ~far)[gap]))
    order = np.argsort(np.concatenate((poses.t, added.t)), kind="stable")
    both = (np.concatenate(pair) for pair in ((poses.t, added.t), (poses.r, added.r), (poses.q, added.q)))
    return Poses(*both).select_rows(order), len(added), spans


def _multiply_quaternions(
    a: Float[np.ndarray, "nf nb 4"], b: Float[np.ndarray, "nf nb 4"]
) -> Float[np.ndarray, "nf nb 4"]:
    """Return the quaternion products a b: the rotation ``b`` followed by the rotation ``a``."""
    x, w = a[..., :3], a[..., 3:]
    y, v = b[..., :3], b[..., 3:]
    return np.concatenate((w * y + v * x + np.cross(x, y), w * v - np.sum(x * y, axis=-1, keepdims=True)), axis=-1)


def measure_deviation(poses: Poses, kept: Int[np.ndarray, " n"]) -> tuple[float, float]:
    """Return the largest distance [m] and angle [rad], over bodies and time, between stored poses and the drawn motion.

    The drawn motion is interpolated between the rows ``kept``.
    """
    distance, angle = measure_deviations(poses, kept)
    return float(np.max(distance)), float(np.max(angle))


def measure_deviations(
    poses: Poses, kept: Int[np.ndarray, " n"], of: Int[np.ndarray, " m"] | None = None
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Return for each stored pose the worst body's distance [m] and angle [rad] from the drawn motion.

    The drawn motion is interpolated between the rows ``kept``. If ``of`` is given, only its rows are measured.
    """
    some = poses if of is None else poses.select_rows(of)
    return _compare_poses(interpolate_poses(poses.select_rows(kept), some.t), some)


def _compare_poses(a: Poses, b: Poses) -> tuple[Float[np.ndarray, " nf"], Float[np.ndarray, " nf"]]:
    """Return the worst body's distance [m] and angle [rad] between two sets of poses at the same times."""
    distance = np.max(np.linalg.norm(a.r - b.r, axis=-1), axis=-1)
    return distance, np.max(measure_angles(normalize(a.q), normalize(b.q)), axis=-1)
