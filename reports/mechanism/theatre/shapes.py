"""Derive the contents of a theatre from a series: shapes of bodies, strips of errors over time, moments to jump to.

Shapes follow from joint points and from how the bodies turn. A body with two or more joints is drawn as rods between
them. A body on a single joint extends as far beyond its centre of mass as the joint is before it; if it mostly turns
about that line, it is drawn as a top. A body held at its centre of mass, or free, is drawn as three crossed rods along
its axes. Thickness has no physical meaning.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from ....harness.results.series import Series
from ...model.results import StoredRun
from ..segments import SAME, find_joint_points
from .poses import Poses, measure_rates

SPINS = 2.0  # least ratio of spin about the axis to rotation across it for a top
AXES = np.eye(3)
EVENTS = 200  # first events of a run that are shown; the page says if there are more
SPANS = 720  # spans of a strip, which is about 500 pixels wide; an envelope has as many
STRIPS: Sequence[Mapping[str, Any]] = (  # ``signed``: it has a sign; ``both``: smallest values matter too
    {"name": "energy_error", "symbol": "E − E₀", "unit": "J", "signed": True, "both": True},
    {"name": "position_error", "symbol": "|r − r exact|", "unit": "m", "signed": False, "both": False},
    {"name": "phi_norm", "symbol": "|φ|", "unit": "m", "signed": False, "both": False},
    {"name": "phi_dot_norm", "symbol": "|φ̇|", "unit": "m/s", "signed": False, "both": False},
    {"name": "dt", "symbol": "step", "unit": "s", "signed": False, "both": True},
)


@dataclass(frozen=True)
class BodyShape:
    """A ``rod`` or ``disc`` from a to b, a ``cone`` with its tip at a, a ``ball`` at a; body frame [m]."""

    kind: str
    body: int
    a: tuple[float, ...]
    b: tuple[float, ...]
    radius: float
    tint: float = 1.0  # below 1: darker than the body, to show how it turns


def find_ground_points(series: Series) -> Float[np.ndarray, "n 3"]:
    """Return the distinct joint points on the ground [m, space frame]."""
    if "joint_i" not in series:
        return np.zeros((0, 3))
    found = [series[f"joint_s_{k}"][series[f"joint_{k}"] < 0] for k in ("i", "j")]
    return np.unique(np.concatenate(found).astype(float).reshape(-1, 3), axis=0)


def make_shapes(series: Series, poses: Poses, scale: float) -> list[BodyShape]:
    """Return the shapes of all bodies, by the rules at the head of this file; ``scale`` [m] is the mechanism's size."""
    bodies = poses.r.shape[1]
    out: list[BodyShape] = []
    for body, points in enumerate(find_joint_points(series, bodies, scale)):
        far = [p for p in points if np.linalg.norm(p) > SAME * scale]
        if len(points) >= 2:
            out += _make_bars(body, points)
        elif far and _is_top(poses, body, far[0]):
            out += _make_top(body, far[0])
        elif far:
            out.append(_rod(body, far[0], -far[0], 0.045))
        else:
            out += _make_crossed_rods(body, 0.5 * scale)
    return out


def list_ends(shapes: list[BodyShape], body: int) -> Float[np.ndarray, "n 3"]:
    """Return the ends of a body's rods [m, body frame], among which a trail is chosen."""
    return np.array([p for s in shapes if s.body == body and s.kind == "rod" for p in (s.a, s.b)]).reshape(-1, 3)


def _make_bars(body: int, points: Float[np.ndarray, "n 3"]) -> list[BodyShape]:
    """Return a rod between the two joints farthest apart, arms from it to the others, and a ball at each joint."""
    distance = np.linalg.norm(points[:, None] - points[None], axis=-1)
    i, j = (int(k) for k in np.unravel_index(np.argmax(distance), distance.shape))
    out = [_rod(body, points[i], points[j], 0.03)]
    u = points[j] - points[i]
    for k in set(range(len(points))) - {i, j}:
        foot = points[i] + u * (np.dot(points[k] - points[i], u) / np.dot(u, u))  # a joint off the line gets an arm
        if np.linalg.norm(foot - points[k]) > 1e-3 * np.linalg.norm(u):
            out.append(_rod(body, points[k], foot, 0.03))
    return out + [_shape("ball", body, p, p, 0.045 * float(np.linalg.norm(u)), 0.75) for p in points]


def _is_top(poses: Poses, body: int, point: np.ndarray) -> bool:
    """Return whether a body mostly spins about the line from its centre of mass to its joint ``point``."""
    if len(poses) < 3:
        return False
    omega, axis = measure_rates(poses, body), point / np.linalg.norm(point)
    about = omega @ axis
    across = np.linalg.norm(omega - about[:, None] * axis, axis=1)
    return bool(np.median(np.abs(about)) > SPINS * np.median(across))


def _make_top(body: int, tip: np.ndarray) -> list[BodyShape]:
    """Return a top: a cone on its ``tip`` [m, body frame], a disc at its centre and a rod through both.

    A darker spoke on the disc shows the spin.
    """
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


def _make_crossed_rods(body: int, half: float) -> list[BodyShape]:
    """Return rods along the body's axes, with balls at the positive ends: large, middle and small for x, y and z."""
    out: list[BodyShape] = []
    for tip, ball in zip(half * AXES, (0.11, 0.08, 0.055), strict=True):
        out += [_rod(body, -tip, tip, 0.022), _shape("ball", body, tip, tip, ball * half, 0.75)]
    return out


def _rod(body: int, a: np.ndarray, b: np.ndarray, thick: float) -> BodyShape:
    """Return a rod from a to b [m, body frame] of radius ``thick`` times its length."""
    return _shape("rod", body, a, b, thick * float(np.linalg.norm(b - a)))


def _shape(kind: str, body: int, a: np.ndarray, b: np.ndarray, radius: float, tint: float = 1.0) -> BodyShape:
    """Return a shape with ends rounded to 0.1 µm, which compress well."""
    first, second = (tuple(round(float(x), 7) for x in p) for p in (a, b))
    return BodyShape(kind, body, first, second, radius, tint)


def list_marks(series: Series, run: StoredRun, player: int) -> list[dict[str, Any]]:
    """List the moments of a run to which a visitor can jump, in order of time, each with time, kind and words.

    The kinds are ``event`` (reported by the solver), ``whip`` (the largest energy error) and ``stop``; ``player`` is
    the run's position among the players.
    """
    t, out = series["t"], []
    for event in series.events[:EVENTS]:
        at = event.get("t")
        if isinstance(at, int | float) and math.isfinite(at):
            rest = [
                f"{k.replace('_', ' ')} {v:.3g}" if isinstance(v, float) else f"{k.replace('_', ' ')} {v}"
                for k, v in event.items()
                if k not in ("t", "kind")
            ]
            out.append((float(at), "event", ", ".join([str(event.get("kind", "event")), *rest])[:200]))
    if "energy_error" in series:
        at, error = series.points("energy_error")
        k = int(np.argmax(np.abs(np.where(np.isfinite(error), error, 0.0)))) if len(error) else 0
        if len(error) and abs(error[k]) > 0.0:
            out.append((float(at[k]), "whip", f"largest energy error, {error[k]:.3g} J"))
    if run.has_stopped:
        out.append((float(t[-1]), "stop", f"{run.status.replace('_', ' ')}: {'; '.join(run.reasons)}"[:400]))
    return [
        {"t": at, "kind": kind, "player": player, "words": words} for at, kind, words in sorted(out, key=lambda m: m[0])
    ]


def reduce_to_spans(
    t: Float[np.ndarray, " nt"], a: Float[np.ndarray, " nt"], t_end: float, spans: int = SPANS
) -> Float[np.ndarray, "2 spans"]:
    """Return the smallest and largest value in each of ``spans`` equal spans of [0, t_end]; NaN in an empty span."""
    low, high = np.full(spans, np.nan), np.full(spans, np.nan)
    good = np.isfinite(t) & np.isfinite(a)
    k = np.clip(np.asarray(t[good] / t_end * spans), 0, spans - 1).astype(int)
    np.fmin.at(low, k, a[good])
    np.fmax.at(high, k, a[good])
    return np.stack((low, high))


def select_known_strips(series: Sequence[Series]) -> list[Mapping[str, Any]]:
    """Return the entries of ``STRIPS`` of which one of the runs' ``series`` has a finite value."""
    return [
        s for s in STRIPS if any(s["name"] in own and np.isfinite(own.points(s["name"])[1]).any() for own in series)
    ]


def make_strips(
    series: Series, run: StoredRun, t_end: float, spans: int = SPANS, kinds: Sequence[Mapping[str, Any]] = STRIPS
) -> Float[np.ndarray, "n spans"]:
    """Return the strips of a run as rows in the order of ``kinds``: the smallest value in each span, then the largest.

    The smallest values are left out of kinds in which they do not matter. The last step is left out unless the run
    stopped, since it is cut to end at ``t_end`` [s].
    """
    out: list[np.ndarray] = []
    for kind in kinds:
        name = kind["name"]
        t, a = series.points(name) if name in series else (np.zeros(0), np.zeros(0))
        if name == "dt" and len(a) > 2 and not run.has_stopped:
            a = a[:-1]  # the last step is cut to end at t_end; in a failure it is of interest
        low_high = reduce_to_spans(t[: len(a)], a, t_end, spans)
        out += list(low_high) if kind["both"] else [low_high[1]]
    return np.stack(out)
