"""Mechanisms in motion for small canvases: runs over the exact motion seen from the front, and how far off each is."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ...harness.results.series import Series
from ..model.accuracy import Measure
from ..model.results import Results, Run
from ..plots.browser import Steps
from ..plots.spec import Look
from .segments import Mechanism, flat, mechanism_of, view_of
from .theatre.poses import Poses, finite, interpolate_poses
from .theatre.scene import player_of, stored_exact

FRAMES = 240  # of a stage; more bodies have fewer, or its file would be large
COORDINATES = 30_000  # of a player, at most
WINDOW = 8.0  # [s] of the motion, at most: what is seen in its own time
STEPS = 4095  # of the box: a fifth of a pixel
ROOM = 0.06  # of the box on each side


def stage(results: Results, roles: Sequence[tuple[Run, str]], measure: Measure | None, looks: Mapping[str, Look],
          frames: int = FRAMES) -> dict[str, Any] | None:  # fmt: skip
    """Segments at even times of the exact motion and of runs, each with its role; None where no run kept poses."""
    read = [(run, role, results.readable_series(run)) for run, role in roles]
    found = [(run, role, s, m) for run, role, s in read if s is not None and (m := mechanism_of(s)) is not None]
    if not found:
        return None
    first = found[0][3]
    view = view_of(first)
    known = next((e for _, _, s, _ in found if (e := stored_exact(s)) is not None and len(e) > 1), None)
    horizon = measure.until if measure and measure.until else math.inf  # beyond it no error tells one from another
    whole = min(max(float(m.t[-1]) for *_, m in found), WINDOW, horizon)
    t = np.linspace(0.0, whole, max(min(frames, COORDINATES // (4 * len(first.body))), 24))
    lines = [segments_at(m, player_of(run, s, load_poses(s)).poses, t, view) for run, _, s, m in found]
    until = 0.0 if known is None else float(known.t[-1])
    exact = None if known is None else segments_at(first, known, t[t <= until], view)
    ground = flat(first.ground, view)
    sound = np.concatenate([(lines[0] if exact is None else exact).reshape(-1, 2), ground])
    low, high = sound.min(axis=0), sound.max(axis=0)  # what flies apart may leave the picture
    size = float(np.max(high - low)) or 1.0
    low, high = low - ROOM * size, high + ROOM * size
    step = float(np.max(high - low)) / STEPS
    return {
        "t": whole, "frames": len(t), "size": ((high - low) / step).tolist(),
        "ground": ((ground - low) / step).tolist(),
        "exact": None if exact is None else {"until": min(until, whole), "frames": len(exact),
                                            "lines": _columns((exact - low) / step)},
        "unit": measure.unit if measure else "m",
        "players": [{
            "solver": run.record.solver, "colour": looks[run.record.solver].colour, "words": role,
            "stopped": run.has_stopped, "last": float(m.t[-1]), "lines": _columns((xy - low) / step),
            "off": Steps(_off(s, measure, t), log=True),
        } for (run, role, s, m), xy in zip(found, lines, strict=True)],
    }  # fmt: skip


def moment(results: Results, run: Run, t: float) -> tuple[np.ndarray, np.ndarray | None, np.ndarray] | None:
    """Segments of a run, of the exact motion where it is known, and the ground, as seen from the front at ``t``."""
    series = results.readable_series(run)
    mechanism = mechanism_of(series)
    if mechanism is None or series is None:
        return None
    view, at = view_of(mechanism), np.array([t])
    exact = stored_exact(series)
    known = exact is not None and len(exact) > 1 and float(exact.t[-1]) >= t
    own = segments_at(mechanism, player_of(run, series, load_poses(series)).poses, at, view)[0]
    return own, segments_at(mechanism, exact, at, view)[0] if known and exact else None, flat(mechanism.ground, view)


def load_poses(series: Series) -> Poses:
    """The poses that a run kept."""
    return finite(Poses(series["frame_t"], series["frame_r"], series["frame_q"]))


def segments_at(
    m: Mechanism, poses: Poses, t: Float[np.ndarray, " n"], view: np.ndarray
) -> Float[np.ndarray, "n ns 2 2"]:
    """Both ends of every segment on paper; held where the poses end."""
    at = interpolate_poses(poses, t)
    R = Rotation.from_quat(at.q.reshape(-1, 4)).as_matrix().reshape(*at.q.shape[:2], 3, 3)
    moved = replace(m, t=t, r=at.r, R=R)
    return flat(np.stack([moved.segments(k) for k in range(len(t))]), view)


def _off(series: Series, measure: Measure | None, t: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """The error that judges, at ``t``; the largest float where it is not known."""
    name = measure.name if measure else ""
    if name not in series:
        return np.full(len(t), np.inf)
    at, values = series.points(name)
    known = np.isfinite(values)
    if not known.any():
        return np.full(len(t), np.inf)
    at, values = at[known], np.abs(values[known])
    return np.interp(t, at, values, right=values[-1] if t[-1] <= at[-1] * (1.0 + 1e-9) else np.inf)


def _columns(values: np.ndarray) -> np.ndarray:
    """Each coordinate over time, one after the other; up to four boxes away from this one."""
    return np.clip(np.rint(values.reshape(len(values), -1).T) + 4 * STEPS, 0, 65535).astype(np.int64).ravel()
