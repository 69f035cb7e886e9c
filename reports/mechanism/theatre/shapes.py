"""What a theatre shows of a series: shapes of bodies, strips of errors over time, moments to jump to.

Shapes follow from joint points, and from how the bodies turn. A body with two joints or more is rods between them. One
that hangs on a single joint reaches as far beyond its centre as the joint is before it; if it mostly turns about that
line, it is a top. One held at its centre, or by nothing, is three crossed rods along its axes. Thickness is for the eye
alone.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from ....harness.results.series import Series
from ...model.results import Run
from ..segments import SAME, joint_points
from .poses import Poses, rates

SPINS = 2.0  # a top turns about its axis at least so much faster than across
AXES = np.eye(3)
EVENTS = 200  # of a run; the first ones; the page says that there are more
SPANS = 720  # a strip is about 500 pixels wide; as many as an envelope has
STRIPS: Sequence[Mapping[str, Any]] = (  # ``signed``: it has a sign, ``both``: its smallest values matter too
    {"name": "energy_error", "symbol": "E − E₀", "unit": "J", "signed": True, "both": True},
    {"name": "position_error", "symbol": "|r − r exact|", "unit": "m", "signed": False, "both": False},
    {"name": "phi_norm", "symbol": "|φ|", "unit": "m", "signed": False, "both": False},
    {"name": "phi_dot_norm", "symbol": "|φ̇|", "unit": "m/s", "signed": False, "both": False},
    {"name": "dt", "symbol": "step", "unit": "s", "signed": False, "both": True},
)


@dataclass(frozen=True)
class Shape:
    """A ``rod`` or ``disc`` from a to b, a ``cone`` with its tip at a, a ``ball`` at a; body frame [m]."""

    kind: str
    body: int
    a: tuple[float, ...]
    b: tuple[float, ...]
    radius: float
    tint: float = 1.0  # below 1: darker than the body, to show how it turns


def ground_points(series: Series) -> Float[np.ndarray, "n 3"]:
    """Where joints hold on to the ground, in space."""
    if "joint_i" not in series:
        return np.zeros((0, 3))
    found = [series[f"joint_s_{k}"][series[f"joint_{k}"] < 0] for k in ("i", "j")]
    return np.unique(np.concatenate(found).astype(float).reshape(-1, 3), axis=0)


def shapes_of(series: Series, poses: Poses, scale: float) -> list[Shape]:
    """Shapes of all bodies."""
    bodies = poses.r.shape[1]
    out: list[Shape] = []
    for body, points in enumerate(joint_points(series, bodies, scale)):
        far = [p for p in points if np.linalg.norm(p) > SAME * scale]
        if len(points) >= 2:
            out += _bars(body, points)
        elif far and _is_top(poses, body, far[0]):
            out += _top(body, far[0])
        elif far:
            out.append(_rod(body, far[0], -far[0], 0.045))
        else:
            out += _cross(body, 0.5 * scale)
    return out


def ends(shapes: list[Shape], body: int) -> Float[np.ndarray, "n 3"]:
    """Ends of a body's rods, body frame: what a trail can follow and a camera must hold."""
    return np.array([p for s in shapes if s.body == body and s.kind == "rod" for p in (s.a, s.b)]).reshape(-1, 3)


def _bars(body: int, points: Float[np.ndarray, "n 3"]) -> list[Shape]:
    distance = np.linalg.norm(points[:, None] - points[None], axis=-1)
    i, j = (int(k) for k in np.unravel_index(np.argmax(distance), distance.shape))
    out = [_rod(body, points[i], points[j], 0.03)]
    u = points[j] - points[i]
    for k in set(range(len(points))) - {i, j}:
        foot = points[i] + u * (np.dot(points[k] - points[i], u) / np.dot(u, u))  # joints beside the line get an arm
        if np.linalg.norm(foot - points[k]) > 1e-3 * np.linalg.norm(u):
            out.append(_rod(body, points[k], foot, 0.03))
    return out + [_shape("ball", body, p, p, 0.045 * float(np.linalg.norm(u)), 0.75) for p in points]


def _is_top(poses: Poses, body: int, point: np.ndarray) -> bool:
    if len(poses) < 3:
        return False
    omega, axis = rates(poses, body), point / np.linalg.norm(point)
    about = omega @ axis
    across = np.linalg.norm(omega - about[:, None] * axis, axis=1)
    return bool(np.median(np.abs(about)) > SPINS * np.median(across))


def _top(body: int, tip: np.ndarray) -> list[Shape]:
    """A cone on its tip with a disc at its centre; a darker spoke shows the spin."""
    length = 2.0 * float(np.linalg.norm(tip))
    u = -2.0 * tip / length
    side = np.cross(u, AXES[int(np.argmin(np.abs(u)))])
    side /= np.linalg.norm(side)
    wide, high = 0.42 * length, 0.06 * length * u
    return [
        _rod(body, tip, -tip, 0.025),
        _shape("cone", body, tip, -0.3 * high, 0.9 * wide, 0.7),
        _shape("disc", body, -high, high, wide),
        _shape("rod", body, high * 1.2, high * 1.2 + 0.94 * wide * side, 0.03 * length, 0.4),
    ]


def _cross(body: int, half: float) -> list[Shape]:
    """Rods along the body's axes, with a ball where each is positive: large, middle, small for x, y, z."""
    out: list[Shape] = []
    for tip, ball in zip(half * AXES, (0.11, 0.08, 0.055), strict=True):
        out += [_rod(body, -tip, tip, 0.022), _shape("ball", body, tip, tip, ball * half, 0.75)]
    return out


def _rod(body: int, a: np.ndarray, b: np.ndarray, thick: float) -> Shape:
    return _shape("rod", body, a, b, thick * float(np.linalg.norm(b - a)))


def _shape(kind: str, body: int, a: np.ndarray, b: np.ndarray, radius: float, tint: float = 1.0) -> Shape:
    first, second = (tuple(round(float(x), 7) for x in p) for p in (a, b))
    return Shape(kind, body, first, second, radius, tint)


def marks_of(series: Series, run: Run, player: int) -> list[dict[str, Any]]:
    """Moments of the run at ``player`` in the cast, in order of time: its ``stop``, ``event``s and ``whip``."""
    t, out = series["t"], []
    for event in series.events[:EVENTS]:
        at = event.get("t")
        if isinstance(at, int | float) and math.isfinite(at):
            rest = [f"{k.replace('_', ' ')} {v:.3g}" if isinstance(v, float) else f"{k.replace('_', ' ')} {v}"
                    for k, v in event.items() if k not in ("t", "kind")]  # fmt: skip
            out.append((float(at), "event", ", ".join([str(event.get("kind", "event")), *rest])[:200]))
    if "energy_error" in series:
        at, error = series.points("energy_error")
        k = int(np.argmax(np.abs(np.where(np.isfinite(error), error, 0.0)))) if len(error) else 0
        if len(error) and abs(error[k]) > 0.0:
            out.append((float(at[k]), "whip", f"largest energy error, {error[k]:.3g} J"))
    if run.has_stopped:
        out.append((float(t[-1]), "stop", f"{run.status.replace('_', ' ')}: {'; '.join(run.reasons)}"[:400]))
    return [{"t": at, "kind": kind, "player": player, "words": words}
            for at, kind, words in sorted(out, key=lambda m: m[0])]  # fmt: skip


def strip(
    t: Float[np.ndarray, " nt"], a: Float[np.ndarray, " nt"], t_end: float, spans: int = SPANS
) -> Float[np.ndarray, "2 spans"]:
    """Smallest and largest value in each of ``spans`` equal spans of [0, t_end]; NaN in a span without a number."""
    low, high = np.full(spans, np.nan), np.full(spans, np.nan)
    good = np.isfinite(t) & np.isfinite(a)
    k = np.clip(np.asarray(t[good] / t_end * spans), 0, spans - 1).astype(int)
    np.fmin.at(low, k, a[good])
    np.fmax.at(high, k, a[good])
    return np.stack((low, high))


def select_known(series: Sequence[Series]) -> list[Mapping[str, Any]]:
    """Those that some run has a number for: without a reference there is no error."""
    return [
        s for s in STRIPS if any(s["name"] in own and np.isfinite(own.points(s["name"])[1]).any() for own in series)
    ]


def strips_of(series: Series, run: Run, t_end: float, spans: int = SPANS, kinds: Sequence[Mapping[str, Any]] = STRIPS
              ) -> Float[np.ndarray, "n spans"]:  # fmt: skip
    """Strips of a run in the order of ``kinds``: smallest values, where they matter, and largest ones."""
    out: list[np.ndarray] = []
    for kind in kinds:
        name = kind["name"]
        t, a = series.points(name) if name in series else (np.zeros(0), np.zeros(0))
        if name == "dt" and len(a) > 2 and not run.has_stopped:
            a = a[:-1]  # cut to end at t_end; of a failure it is the point
        low_high = strip(t[: len(a)], a, t_end, spans)
        out += list(low_high) if kind["both"] else [low_high[1]]
    return np.stack(out)
