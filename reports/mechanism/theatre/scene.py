"""Collect all that one theatre page plays as plain data: players, poses, shapes, strips and moments to jump to."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ....harness.results.series import Series
from ...model.results import StoredResults, StoredRun, Variant, group_by, group_by_solver
from ...plots.spec import LineStyle
from . import poses as packing
from .poses import (
    Box,
    ChosenPoses,
    Poses,
    bound_points,
    choose_poses,
    fill_gaps,
    round_mantissa,
    select_finite,
    thin_poses,
)
from .shapes import (
    EVENTS,
    SPANS,
    BodyShape,
    find_ground_points,
    list_ends,
    list_marks,
    make_shapes,
    make_strips,
    select_known_strips,
)

POSE_BYTES = 4_500_000  # bytes of poses on a page, before compression
BODY_BYTES = 14  # three int16 of position and four of orientation
MOST_POSES = 2000  # most poses of a player: as many as a run stores
ADDED_POSES = 400  # most poses of a run that a visitor adds
MOST_ADDED = 24  # runs that a visitor may add to a stage
VIEWS = 60  # poses that the camera's box is computed from
FEW = 0.2  # fraction of POSE_BYTES below which strips are coarser too
LONG = 3000  # rows of a series above which it gets the finer strips
FLAT = 0.02  # motion this thin, compared with its width, is planar
AT_MOST = 10  # players of one mechanism; more only where more solvers fail, to show each failure
SOUND = 3  # successful players: the best, the middle and the worst
RULE = (
    "Of the runs that succeeded those with the least, the middle and the largest energy error, of each solver the one "
    "with the fewest options, then the finest; then of each solver one that is wrong or stopped; then those of the "
    "others that succeeded, and the rest, failures first. "
    "Settings that differ only in their label or in the number of steps allowed are shown once."
)


@dataclass(frozen=True)
class Player:
    """A run on the stage."""

    run: StoredRun
    series: Series
    poses: Poses
    added: int = 0  # number of poses that the run did not store, see ``fill_gaps``
    unknown: tuple[tuple[float, float], ...] = ()  # [s] spans between stored poses in which nothing is drawn


def collect_players(
    results: StoredResults, variant: Variant
) -> tuple[list[Player], list[Player], tuple[StoredRun, ...]]:
    """Return the players, up to ``MOST_ADDED`` that a visitor may add (failures first), and all runs not shown yet."""
    chosen, left_out = choose_players(variant, [c.record.run_id for c in variant.runs if c.record.series])
    found = _make_players(results, chosen)
    absent = tuple(c for c in chosen if all(c is not p.run for p in found))
    more = sorted((c for c in left_out if c.record.series), key=lambda c: c.is_success)
    return found, _make_players(results, more[:MOST_ADDED], found[:1]), (*left_out, *absent)


def _make_players(results: StoredResults, runs: Sequence[StoredRun], alike: Sequence[Player] = ()) -> list[Player]:
    """Return players of the runs whose stored poses have as many bodies as those ``alike``, or else as the first."""
    found = list(alike)
    for run in runs:
        series = results.series(run)
        if series is not None and all(k in series for k in ("t", "frame_t", "frame_r", "frame_q")):
            poses = select_finite(Poses(series["frame_t"], series["frame_r"], series["frame_q"]))
            same = not found or poses.r.shape[1:] == found[0].poses.r.shape[1:]
            if len(poses) and len(series["t"]) and same:
                found.append(make_player(run, series, poses))
    return found[len(alike) :]


def make_player(run: StoredRun, series: Series, poses: Poses) -> Player:
    """Return a run as a player; where the exact motion is stored, poses are interpolated within long steps."""
    exact = read_exact_motion(series)
    if len(poses) < 2 or exact is None or len(exact) < 2 or exact.r.shape[1:] != poses.r.shape[1:]:
        return Player(run, series, poses)
    scale = run.record.length_scale_m
    return Player(run, series, *fill_gaps(poses, exact, scale if scale > 0.0 else 1.0))


def read_exact_motion(series: Series) -> Poses | None:
    """Return the poses of the exact motion in a series file, up to the first that is not finite; None without any."""
    if "exact_t" not in series:
        return None
    return select_finite(Poses(series["exact_t"], series["exact_r"], series["exact_q"]))


def make_scene(
    variant: Variant,
    shown: Sequence[Player],
    looks: Mapping[str, LineStyle],
    pose_bytes: float = POSE_BYTES,
    more: Sequence[Player] = (),
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Return the data of a theatre page, and the data of each run in ``more``, which a visitor may add.

    The first of ``shown`` leads: shapes and gravity are those of its series. ``pose_bytes`` limits the size of the
    page's poses; ``looks`` gives line styles by solver.
    """
    lead = shown[0]
    record, bodies = lead.run.record, lead.poses.r.shape[1]
    scale = record.length_scale_m if record.length_scale_m > 0.0 else 1.0
    t_end = max([record.t_end_s] + [float(p.series["t"][-1]) for p in shown])
    t_end = t_end if math.isfinite(t_end) and t_end > 0.0 else 1.0
    shapes, kinds = make_shapes(lead.series, lead.poses, scale), select_known_strips([p.series for p in shown])
    lengths = [float(np.linalg.norm(np.subtract(s.b, s.a))) for s in shapes if s.kind == "rod"]
    body = min(scale, float(np.median(lengths))) if lengths else scale
    ground = find_ground_points(lead.series)
    gravity = np.asarray(lead.series["gravity"], dtype=float) if "gravity" in lead.series else np.zeros(3)
    sound = [p for p in shown if p.run.is_success] or [lead]
    stage = _bound_scene(sound, shapes, ground)
    box = stage.widen(0.75)  # diverging players stay at its walls
    long = max(len(p.series["t"]) for p in shown) > LONG and pose_bytes > FEW * POSE_BYTES
    spans = SPANS if long else SPANS // 2
    at_most = max(2, min(MOST_POSES, int(pose_bytes / (BODY_BYTES * bodies * len(shown)))))
    # a solver's second and later runs are drawn thinner, with other dashes
    ranked = group_by_solver(p.run for p in (*shown, *more)).values()
    rank = {run.record.run_id: k for own in ranked for k, run in enumerate(own)}

    exact = choose_exact(shown)

    def pack_player(k: int, p: Player, most: int) -> dict[str, Any]:
        """Return the data of player ``k`` in at most ``most`` poses, with the error of drawing it by these."""
        kept, chosen = _pack_poses(p.poses, box, body, most)
        r, strips = p.run.record, round_mantissa(make_strips(p.series, p.run, t_end, spans, kinds))
        return {
            "solver": r.solver,
            "settings": p.run.settings(),
            "label": r.label,
            "status": p.run.status,
            "because": "; ".join(p.run.reasons)[:400],
            "run": r.run_id,
            "colour": looks[r.solver].colour,
            "rank": rank[r.run_id],
            "stopped": p.run.has_stopped,
            "last": float(p.series["t"][-1]),
            **kept,
            "stored": len(p.poses) - p.added,
            "added": p.added,
            "unknown": p.unknown,
            "off_m": chosen.distance,
            "off_rad": chosen.angle,
            "strips": strips.ravel(),
            "marks": list_marks(p.series, p.run, k),
        }

    play = {
        "title": variant.title,
        "t_end": t_end,
        "bodies": bodies,
        "scale": scale,
        "gravity": gravity.tolist(),
        "normal": _find_plane_normal(lead),
        "low": stage.low.tolist(),
        "high": stage.high.tolist(),
        "middle": (0.5 * (box.low + box.high)).tolist(),
        "quantum": box.quantum.tolist(),
        "ground": ground.tolist(),
        "shapes": shapes,
        "trail": _choose_trail(lead, shapes),
        "spans": spans,
        "strips": kinds,
        "exact": exact and {**_pack_poses(exact, box, body, MOST_POSES)[0], "until": float(exact.t[-1])},
        "players": [pack_player(k, p, at_most) for k, p in enumerate(shown)],
        "events_cut": any(len(p.series.events) > EVENTS for p in shown),
    }
    return play, [pack_player(len(shown), p, min(at_most, ADDED_POSES)) for p in more]


def choose_exact(shown: Sequence[Player]) -> Poses | None:
    """Return the exact motion that is known for the longest time among the players'; None if none has one."""
    known = [read_exact_motion(p.series) for p in shown]
    alike = [e for e in known if e is not None and len(e) and e.r.shape[1:] == shown[0].poses.r.shape[1:]]
    return max(alike, key=lambda e: float(e.t[-1]), default=None)


def _pack_poses(poses: Poses, box: Box, body: float, at_most: int) -> tuple[dict[str, Any], ChosenPoses]:
    """Return at most ``at_most`` poses in the page's format, and which they are; ``body`` [m] is the size of a body."""
    chosen = choose_poses(poses, at_most, body)
    kept = poses.select_rows(chosen.rows)
    both = np.concatenate((packing.quantise_positions(kept.r, box), packing.quantise_quaternions(kept.q)), axis=-1)
    return {"t": kept.t, "poses": packing.flatten_columns(both.reshape(len(kept), -1)), "frames": len(kept)}, chosen


def _bound_scene(sound: Sequence[Player], shapes: Sequence[BodyShape], ground: Float[np.ndarray, "n 3"]) -> Box:
    """Return the box that the camera must show: the ends of all shapes over the motion of the players ``sound``."""
    thick = max((s.radius for s in shapes), default=0.0)
    body = np.array([s.body for s in shapes for _ in range(2)], dtype=int)
    local = np.array([x for s in shapes for x in (s.a, s.b)]).reshape(-1, 3)
    corners = [ground]
    for p in sound:
        some = p.poses.select_rows(thin_poses(p.poses, VIEWS, 1.0))
        for r, q in zip(some.r, some.q, strict=True):
            x = r[body] + Rotation.from_quat(q[body]).apply(local)
            corners.append(np.stack((x.min(axis=0) - thick, x.max(axis=0) + thick)))
    return bound_points(np.concatenate(corners))


def _find_plane_normal(lead: Player) -> list[float] | None:
    """Return the unit normal of the plane in which the centres of mass stay [space frame]; None if there is none."""
    points = lead.poses.r.reshape(-1, 3).astype(float)
    points = points[:: max(1, len(points) // 20000)]
    _, size, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    if len(size) < 3 or size[1] == 0.0 or size[2] > FLAT * size[1]:
        return None
    n = axes[2] * np.sign(axes[2][np.argmax(np.abs(axes[2]))])  # the largest component is positive
    return n.tolist()


def _choose_trail(lead: Player, shapes: Sequence[BodyShape]) -> dict[str, Any]:
    """Return the end of a rod with the longest path, whose trail is drawn: ``body`` and ``at`` [m, body frame]."""
    some = lead.poses.select_rows(thin_poses(lead.poses, 200, 1.0))
    best, body, at = -1.0, 0, np.zeros(3)
    bodies = some.r.shape[1]
    for k in range(0, bodies, 1 if bodies <= 200 else 50):  # of many bodies only some, which is fast
        for end in list_ends(list(shapes), k):
            x = some.r[:, k] + Rotation.from_quat(some.q[:, k]).apply(end)
            path = float(np.sum(np.linalg.norm(np.diff(x, axis=0), axis=1)))
            if path > best * (1.0 + 1e-6):
                best, body, at = path, k, end
    return {"body": body, "at": at.tolist()}


def choose_players(
    variant: Variant, playable: Sequence[str], at_most: int = AT_MOST
) -> tuple[tuple[StoredRun, ...], tuple[StoredRun, ...]]:
    """Return the runs that play and those left out; ``playable`` holds the run_ids of those that may play.

    At most ``at_most`` play, more only to show a failure of each solver that has one. The first player, drawn solid, is
    a success with the fewest options and then the least energy drift, if there is a success.
    """
    available = [c for c in variant.runs if c.record.run_id in set(playable)]
    failing = {c.record.solver for c in available if not c.is_success}
    at_most += max(len(failing) - (AT_MOST - SOUND), 0)
    chosen: list[StoredRun] = []
    for run in _list_candidates(available):
        if len(chosen) < at_most and all(_make_settings_key(run) != _make_settings_key(other) for other in chosen):
            chosen.append(run)
    chosen.sort(key=_rank_soundness)
    return tuple(chosen), tuple(c for c in variant.runs if c not in chosen)


def _list_candidates(runs: Sequence[StoredRun]) -> Iterator[StoredRun]:
    """Yield the runs in the order in which they are chosen as players, see ``RULE``; some appear more than once."""

    def rank_plainness(c: StoredRun) -> tuple[bool, int, float]:
        """Return the sort key that puts successes first, then fewest options, then the finest step or tolerance."""
        return (not c.is_success, len(c.options), c.step_or_tolerance)

    def rank_failure(c: StoredRun) -> tuple[bool, bool, float]:
        """Return the sort key that puts stopped runs first, then other failures, then the finest step or tolerance."""
        return (not c.has_stopped, c.is_success, c.step_or_tolerance)

    def read_label(c: StoredRun) -> tuple[str, str]:
        """Return the label and the solver of a run."""
        return c.record.label, c.record.solver

    by_name = sorted(runs, key=lambda c: c.record.solver)
    firsts = [min(own, key=rank_plainness) for own in group_by_solver(by_name).values()]
    known = set(map(read_label, firsts))
    sound = sorted((c for c in firsts if c.is_success), key=_rank_soundness)
    yield from (sound[k] for k in (0, len(sound) // 2, -1) if sound)
    yield from (min(own, key=rank_failure) for own in group_by_solver(c for c in by_name if not c.is_success).values())
    yield from firsts
    by_label = group_by(sorted(runs, key=read_label), read_label).items()
    yield from (min(own, key=rank_failure) for name, own in by_label if name not in known)
    yield from sorted(runs, key=rank_failure)


def _make_settings_key(c: StoredRun) -> tuple[str, ...]:
    """Return the run's settings without its label and its step limit."""
    r = c.record
    return (r.solver, r.control, *map(repr, (r.dt_s, r.rtol, r.max_step_s, r.t_end_s)), repr(sorted(c.options.items())))


def _rank_soundness(c: StoredRun) -> tuple[bool, int, float, str]:
    """Return the sort key that puts successes first, then fewest options, then the least energy drift."""
    drift = c.record.energy_drift_max_J
    return (not c.is_success, len(c.options), drift if drift == drift else float("inf"), c.record.run_id)
