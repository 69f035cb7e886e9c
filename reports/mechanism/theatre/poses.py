"""Which of the stored poses are drawn, how far off they are, and poses and strips made small for a page."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

LEVELS = 32767
DIGITS = 9  # bits of mantissa that a strip keeps: 1/1024 of the value at most, below a pixel
FIRST = 48  # poses tried at first
NEAR = 0.01  # [of a body] drawn poses may be so far off stored ones where there is room for more
TURNED = 0.03  # [rad]
ALIKE = 0.5  # [rad, of a body] a run this near to the exact motion errs evenly between two stored poses
AT_ONCE = 0.25  # of the worst distance: so much further off a chord half as long is not


@dataclass(frozen=True)
class Box:
    """Where positions are exact to half a step; what leaves it stays at its wall."""

    low: Float[np.ndarray, " 3"]
    high: Float[np.ndarray, " 3"]

    @property
    def quantum(self) -> Float[np.ndarray, " 3"]:
        """A step of the int16 grid [m]; positions are off by half of it at most."""
        return np.maximum(self.high - self.low, 1e-12) / (2 * LEVELS)

    def widen(self, by: float) -> "Box":
        """With walls ``by`` times its largest side further out."""
        out = by * float(np.max(self.high - self.low))
        return Box(self.low - out, self.high + out)


def box_of(points: Float[np.ndarray, "*n 3"]) -> Box:
    """The smallest box of all finite points; of side 1 around the origin if there is none."""
    flat = points.reshape(-1, 3)
    flat = flat[np.all(np.isfinite(flat), axis=1)]
    if len(flat) == 0:
        return Box(np.full(3, -0.5), np.full(3, 0.5))
    return Box(flat.min(axis=0).astype(float), flat.max(axis=0).astype(float))


def positions(r: Float[np.ndarray, "nf nb 3"], box: Box) -> Int[np.ndarray, "nf nb 3"]:
    """To the grid of the box, its middle at 0."""
    middle = 0.5 * (box.low + box.high)
    steps = np.rint((r.astype(float) - middle) / box.quantum)
    return np.clip(steps, -LEVELS, LEVELS).astype(np.int16)


def quaternions(q: Float[np.ndarray, "nf nb 4"]) -> Int[np.ndarray, "nf nb 4"]:
    """Unit quaternions to the grid, each of the sign that lies nearer to the one before."""
    q = q.astype(float)
    turns = np.sign(np.sum(q[1:] * q[:-1], axis=-1))
    turns[turns == 0.0] = 1.0
    q[1:] *= np.cumprod(turns, axis=0)[..., None]
    return np.rint(np.clip(q, -1.0, 1.0) * LEVELS).astype(np.int16)


def columns(a: Int[np.ndarray, "nf n"]) -> Int[np.ndarray, " m"]:
    """One column after the other from 0 up: its differences over time, which is what a bundle stores, compress well."""
    return a.T.astype(np.int64).ravel() + LEVELS


def round_mantissa(a: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """With ``DIGITS`` bits of mantissa, which compress well."""
    fraction, power = np.frexp(a)
    return np.ldexp(np.rint(np.ldexp(fraction, DIGITS)), power - DIGITS)


@dataclass(frozen=True)
class Poses:
    """Poses of one run over time; quaternions (x, y, z, w)."""

    t: Float[np.ndarray, " nf"]
    r: Float[np.ndarray, "nf nb 3"]
    q: Float[np.ndarray, "nf nb 4"]

    def at(self, k: Int[np.ndarray, " n"]) -> "Poses":
        return Poses(self.t[k], self.r[k], self.q[k])

    def __len__(self) -> int:
        return len(self.t)


def finite(poses: Poses) -> Poses:
    """Up to the first pose that is no number, or whose quaternion is zero."""
    good = np.isfinite(poses.t) & np.isfinite(poses.r).all(axis=(1, 2)) & np.isfinite(poses.q).all(axis=(1, 2))
    good &= poses.q.any(axis=-1).all(axis=-1)
    return poses.at(np.flatnonzero(np.logical_and.accumulate(good)))


def thin_poses(poses: Poses, at_most: int, size: float) -> Int[np.ndarray, " n"]:
    """Rows to draw, first and last among them: half even in time, half along the way of the body that goes furthest.

    ``size`` [m] makes a turn a way: a turn of 1 rad counts as a way of ``size``.
    """
    n = len(poses)
    if n <= max(at_most, 2):
        return np.arange(n)
    way = np.max(np.linalg.norm(np.diff(poses.r, axis=0), axis=-1) + size * turns(poses.q), axis=1)
    time = np.diff(poses.t)
    measure = time / max(float(np.sum(time)), 1e-300) + way / max(float(np.sum(way)), 1e-300)
    along = np.concatenate(([0.0], np.cumsum(measure)))
    rows = np.searchsorted(along, np.linspace(0.0, along[-1], max(at_most, 2)))
    rows[-1] = n - 1
    return np.unique(np.minimum(rows, n - 1))


def enough(poses: Poses, at_most: int, size: float) -> Int[np.ndarray, " n"]:
    """As few rows as give all stored poses to ``NEAR`` of ``size`` [m] and ``TURNED``, dense where the motion is fast.

    To a few rows are added those that are drawn worst, until all are near or there are ``at_most``.
    """
    rows = thin_poses(poses, min(FIRST, at_most), size)
    while len(rows) < at_most:
        distance, angle = each_off(poses, rows)
        away = np.maximum(distance / (NEAR * size), angle / TURNED)
        worst = np.argsort(-away, kind="stable")
        _, first = np.unique(np.searchsorted(rows, worst, side="right"), return_index=True)  # one in each gap
        wanted = worst[np.sort(first)]
        wanted = wanted[away[wanted] > max(1.0, AT_ONCE * away[worst[0]])]
        if not len(wanted):
            break
        rows = np.union1d(rows, wanted[: at_most - len(rows)])
    return rows


def turns(q: Float[np.ndarray, "nf nb 4"]) -> Float[np.ndarray, "m nb"]:
    """Angle [rad] from each orientation to the next."""
    q = normalize(q)
    return angles(q[:-1], q[1:])


def normalize(q: Float[np.ndarray, "nf nb 4"]) -> Float[np.ndarray, "nf nb 4"]:
    """The quaternions of length 1."""
    q = q.astype(float)
    return q / np.sqrt(np.einsum("...i,...i", q, q))[..., None]


def angles(a: Float[np.ndarray, "nf nb 4"], b: Float[np.ndarray, "nf nb 4"]) -> Float[np.ndarray, "nf nb"]:
    """Angle [rad] from ``a`` to ``b``, unit quaternions, the shorter way round; exact near zero."""
    return 4.0 * _half(a, b)[0]


def _half(
    a: Float[np.ndarray, "nf nb 4"], b: Float[np.ndarray, "nf nb 4"]
) -> tuple[Float[np.ndarray, "nf nb"], Float[np.ndarray, "nf nb"]]:
    """Half the angle between unit quaternions as points, of b and -b the nearer, and the sign of that."""
    apart, together = a - b, a + b
    d, s = (np.sqrt(np.einsum("...i,...i", x, x)) for x in (apart, together))
    return np.arctan2(np.minimum(d, s), np.maximum(d, s)), np.where(d > s, -1.0, 1.0)


def rates(poses: Poses, body: int) -> Float[np.ndarray, "m 3"]:
    """Mean angular velocity [rad/s] of a body between stored poses, body frame, on the shorter way round."""
    R = Rotation.from_quat(poses.q[:, body])
    return (R[:-1].inv() * R[1:]).as_rotvec() / np.maximum(np.diff(poses.t), 1e-300)[:, None]


def interpolate_poses(poses: Poses, t: Float[np.ndarray, " n"]) -> Poses:
    """Positions on the chord, orientations on the great circle: what the page draws between two poses."""
    k = np.clip(np.searchsorted(poses.t, t, side="right") - 1, 0, max(len(poses) - 2, 0))
    j = np.minimum(k + 1, len(poses) - 1)
    gap = poses.t[j] - poses.t[k]
    u = np.clip(np.divide(t - poses.t[k], gap, out=np.zeros(len(t)), where=gap > 0.0), 0.0, 1.0)[:, None, None]
    q = normalize(poses.q)
    half, sign = _half(q[k], q[j])
    arc = 2.0 * half[..., None]
    whole = np.sinc(arc / np.pi)  # sin(u arc) / sin(arc), exact at zero
    near, far = (x * np.sinc(x * arc / np.pi) / whole for x in (1.0 - u, u))
    return Poses(t, (1.0 - u) * poses.r[k] + u * poses.r[j], near * q[k] + far * sign[..., None] * q[j])


def rotations(q: Float[np.ndarray, "nf nb 4"]) -> Rotation:
    """All of them, one after the other."""
    return Rotation.from_quat(q.reshape(-1, 4))


def fill(poses: Poses, exact: Poses, size: float) -> tuple[Poses, int, tuple[tuple[float, float], ...]]:
    """Poses between stored ones where what is drawn between them is off: the exact motion with the run's own error.

    The error is that of the stored poses at both ends, interpolated; ``size`` [m] is that of a body. A gap in which
    the exact motion turns by more than pi, with an end that is not near it, cannot be filled: it is unknown.
    Returns also how many poses were added, and the spans [s] in which none is known.
    """
    inside = (exact.t > poses.t[0]) & (exact.t < poses.t[-1]) & ~np.isin(exact.t, poses.t)
    here, there = exact.at(np.flatnonzero(inside)), interpolate_poses(exact, poses.t)
    back, own = there.q * [-1.0, -1.0, -1.0, 1.0], normalize(poses.q)
    error = Poses(poses.t, poses.r - there.r, _product(back, own))
    angle = angles(there.q, own)
    far = np.maximum(np.linalg.norm(error.r, axis=-1) / size, angle).max(axis=1) > ALIKE
    far |= poses.t > exact.t[-1] * (1.0 + 1e-12)
    far = far[1:] | far[:-1]
    turned = np.interp(poses.t, exact.t, np.append(0.0, np.cumsum(np.max(turns(exact.q), axis=1))))
    unknown = np.flatnonzero(far & (np.diff(turned) > np.pi))
    spans = tuple((float(poses.t[k]), float(poses.t[k + 1])) for k in unknown)
    if not len(here):
        return poses, 0, spans
    added = interpolate_poses(error, here.t)
    made = Poses(here.t, here.r + added.r, _product(normalize(here.q), added.q))
    distance, angle = _apart(interpolate_poses(poses, here.t), made)
    gap = np.searchsorted(poses.t, here.t, side="right") - 1
    off_in = np.zeros(len(far), dtype=bool)
    off_in[gap[(distance > NEAR * size) | (angle > TURNED)]] = True  # all of a gap: after whole turns one may fit
    made = made.at(np.flatnonzero((off_in & ~far)[gap]))
    order = np.argsort(np.concatenate((poses.t, made.t)), kind="stable")
    both = (np.concatenate(pair) for pair in ((poses.t, made.t), (poses.r, made.r), (poses.q, made.q)))
    return Poses(*both).at(order), len(made), spans


def _product(a: Float[np.ndarray, "nf nb 4"], b: Float[np.ndarray, "nf nb 4"]) -> Float[np.ndarray, "nf nb 4"]:
    """The rotations ``a`` after ``b``, as quaternions."""
    x, w = a[..., :3], a[..., 3:]
    y, v = b[..., :3], b[..., 3:]
    return np.concatenate((w * y + v * x + np.cross(x, y), w * v - np.sum(x * y, axis=-1, keepdims=True)), axis=-1)


def off(poses: Poses, kept: Int[np.ndarray, " n"]) -> tuple[float, float]:
    """The worst body's distance [m] and angle [rad] between the stored poses and what is drawn in their place."""
    distance, angle = each_off(poses, kept)
    return float(np.max(distance)), float(np.max(angle))


def each_off(poses: Poses, kept: Int[np.ndarray, " n"]) -> tuple[Float[np.ndarray, " nf"], Float[np.ndarray, " nf"]]:
    """The same of each stored pose."""
    return _apart(interpolate_poses(poses.at(kept), poses.t), poses)


def _apart(a: Poses, b: Poses) -> tuple[Float[np.ndarray, " nf"], Float[np.ndarray, " nf"]]:
    """The worst body's distance [m] and angle [rad] between poses of the same times."""
    distance = np.max(np.linalg.norm(a.r - b.r, axis=-1), axis=-1)
    return distance, np.max(angles(normalize(a.q), normalize(b.q)), axis=-1)
