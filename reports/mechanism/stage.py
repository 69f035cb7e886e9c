"""Prepare small animations: runs drawn over the exact motion, with the error of each over time."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ...harness.results.series import Series
from ..model.accuracy import ErrorMeasure
from ..model.results import StoredResults, StoredRun
from ..plots.browser import Steps
from ..plots.spec import LineStyle
from .segments import DrawnMechanism, choose_view, project_points, read_mechanism
from .theatre.poses import Poses, interpolate_poses, select_finite
from .theatre.scene import make_player, read_exact_motion

FRAMES = 240  # frames of a stage; mechanisms of many bodies get fewer, which bounds the file
COORDINATES = 30_000  # most coordinates of one player
WINDOW = 8.0  # [s] longest motion shown, played in real time
STEPS = 4095  # steps across the box: one is a fifth of a pixel
ROOM = 0.06  # margin on each side, as a fraction of the box


def make_stage(
    results: StoredResults,
    roles: Sequence[tuple[StoredRun, str]],
    measure: ErrorMeasure | None,
    looks: Mapping[str, LineStyle],
    frames: int = FRAMES,
) -> dict[str, Any] | None:
    """Return the data of a small animation: segments of the exact motion and of runs at equal time steps, and errors.

    ``roles`` pairs each run with words on why it is shown, ``looks`` gives line styles by solver, and ``frames`` is the
    largest number of frames. Coordinates are in steps of the picture's box. None is returned if no run stored poses.
    """
    read = [(run, role, results.readable_series(run)) for run, role in roles]
    found = [(run, role, s, m) for run, role, s in read if s is not None and (m := read_mechanism(s)) is not None]
    if not found:
        return None
    first = found[0][3]
    view = choose_view(first)
    known = next((e for _, _, s, _ in found if (e := read_exact_motion(s)) is not None and len(e) > 1), None)
    horizon = measure.until if measure and measure.until else math.inf  # beyond it no error distinguishes solvers
    whole = min(max(float(m.t[-1]) for *_, m in found), WINDOW, horizon)
    t = np.linspace(0.0, whole, max(min(frames, COORDINATES // (4 * len(first.body))), 24))
    lines = [place_segments(m, make_player(run, s, load_poses(s)).poses, t, view) for run, _, s, m in found]
    until = 0.0 if known is None else float(known.t[-1])
    exact = None if known is None else place_segments(first, known, t[t <= until], view)
    ground = project_points(first.ground, view)
    sound = np.concatenate([(lines[0] if exact is None else exact).reshape(-1, 2), ground])
    low, high = sound.min(axis=0), sound.max(axis=0)  # a diverging run may leave the picture
    size = float(np.max(high - low)) or 1.0
    low, high = low - ROOM * size, high + ROOM * size
    step = float(np.max(high - low)) / STEPS
    return {
        "t": whole,
        "frames": len(t),
        "size": ((high - low) / step).tolist(),
        "ground": ((ground - low) / step).tolist(),
        "exact": None
        if exact is None
        else {"until": min(until, whole), "frames": len(exact), "lines": _round_coordinates((exact - low) / step)},
        "unit": measure.unit if measure else "m",
        "players": [
            {
                "solver": run.record.solver,
                "colour": looks[run.record.solver].colour,
                "words": role,
                "stopped": run.has_stopped,
                "last": float(m.t[-1]),
                "lines": _round_coordinates((xy - low) / step),
                "off": Steps(_measure_error(s, measure, t), log=True),
            }
            for (run, role, s, m), xy in zip(found, lines, strict=True)
        ],
    }


def project_moment(
    results: StoredResults, run: StoredRun, t: float
) -> tuple[np.ndarray, np.ndarray | None, np.ndarray] | None:
    """Return the drawing at time ``t`` [s]: the run's segments, those of the exact motion, and the ground's points [m].

    The exact segments are None where the exact motion is unknown. None is returned if the run stored no poses.
    """
    series = results.readable_series(run)
    mechanism = read_mechanism(series)
    if mechanism is None or series is None:
        return None
    view, at = choose_view(mechanism), np.array([t])
    exact = read_exact_motion(series)
    known = exact is not None and len(exact) > 1 and float(exact.t[-1]) >= t
    own = place_segments(mechanism, make_player(run, series, load_poses(series)).poses, at, view)[0]
    return (
        own,
        place_segments(mechanism, exact, at, view)[0] if known and exact else None,
        project_points(mechanism.ground, view),
    )


def load_poses(series: Series) -> Poses:
    """Return the poses that a run stored, up to the first that is not finite."""
    return select_finite(Poses(series["frame_t"], series["frame_r"], series["frame_q"]))


def place_segments(
    m: DrawnMechanism, poses: Poses, t: Float[np.ndarray, " n"], view: Float[np.ndarray, "2 3"]
) -> Float[np.ndarray, "n ns 2 2"]:
    """Return both ends of every segment in the drawing plane [m] at times ``t`` [s].

    The axes of the result are time, segment, end, and coordinate (right, up). ``view`` (2, 3) has these two directions
    of space as its rows. Before the first and after the last of ``poses``, that pose is held.
    """
    at = interpolate_poses(poses, t)
    R = Rotation.from_quat(at.q.reshape(-1, 4)).as_matrix().reshape(*at.q.shape[:2], 3, 3)
    moved = replace(m, t=t, r=at.r, R=R)
    return project_points(np.stack([moved.segments(k) for k in range(len(t))]), view)


def _measure_error(series: Series, measure: ErrorMeasure | None, t: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Return the magnitude of the error ``measure`` of a run, interpolated at times ``t`` [s].

    It is infinite after the last known value, and everywhere without a measure or values.
    """
    name = measure.name if measure else ""
    if name not in series:
        return np.full(len(t), np.inf)
    at, values = series.points(name)
    known = np.isfinite(values)
    if not known.any():
        return np.full(len(t), np.inf)
    at, values = at[known], np.abs(values[known])
    return np.interp(t, at, values, right=values[-1] if t[-1] <= at[-1] * (1.0 + 1e-9) else np.inf)


def _round_coordinates(values: np.ndarray) -> np.ndarray:
    """Return coordinates, in steps of the box, as whole numbers: the time histories one after another.

    ``values`` have time as their first axis. The numbers are shifted by four widths of the box, so that none is
    negative, and clipped to 16 bits.
    """
    return np.clip(np.rint(values.reshape(len(values), -1).T) + 4 * STEPS, 0, 65535).astype(np.int64).ravel()
