"""All that one theatre page plays, as plain data: cast, poses, shapes, strips, moments to jump to."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from ....harness.results.series import Series
from ...model.results import Results, Run, Variant, by_solver, group_by
from ...plots.spec import Look
from ..theatre import poses as packing
from .poses import Box, Poses, box_of, enough, fill, finite, off, round_mantissa, thin_poses
from .shapes import EVENTS, SPANS, Shape, ends, ground_points, marks_of, select_known, shapes_of, strips_of

POSE_BYTES = 4_500_000  # of all players of a page, before compression
BODY_BYTES = 14  # three int16 and four
MOST_POSES = 2000  # as many as are stored
ADDED_POSES = 400  # of a run that a visitor adds
MOST_ADDED = 24  # runs that a visitor may add to a stage
VIEWS = 60  # poses from which the camera's box is taken
FEW = 0.2  # [of POSE_BYTES] below, strips too are coarser
LONG = 3000  # [rows] of a series that needs the finer strips
FLAT = 0.02  # motion this thin, compared with its width, is planar
AT_MOST = 10  # of one mechanism; more only where more solvers fail, so that each failure is seen
SOUND = 3  # the best, the middle and the worst
RULE = (
    "Of the runs that succeeded those with the least, the middle and the largest energy error, of each solver the one "
    "with the fewest options, then the finest; then of each solver one that is wrong or stopped; then those of the "
    "others that succeeded, and the rest, failures first. "
    "Settings that differ only in their label or in the number of steps allowed are shown once."
)


@dataclass(frozen=True)
class Player:
    """A run on the stage."""

    run: Run
    series: Series
    poses: Poses
    added: int = 0  # of the poses: not stored by the run, see ``fill``
    unknown: tuple[tuple[float, float], ...] = ()  # [s] spans between stored poses in which nothing is drawn


def players(results: Results, variant: Variant) -> tuple[list[Player], list[Player], tuple[Run, ...]]:
    """The cast with its motion, runs that a visitor may add, failures first, and the runs left out of the cast."""
    chosen, left_out = choose_players(variant, [c.record.run_id for c in variant.runs if c.record.series])
    found = _with_motion(results, chosen)
    absent = tuple(c for c in chosen if all(c is not p.run for p in found))
    more = sorted((c for c in left_out if c.record.series), key=lambda c: c.is_success)
    return found, _with_motion(results, more[:MOST_ADDED], found[:1]), (*left_out, *absent)


def _with_motion(results: Results, runs: Sequence[Run], alike: Sequence[Player] = ()) -> list[Player]:
    """Those that kept poses, of as many bodies as the first."""
    found = list(alike)
    for run in runs:
        series = results.series(run)
        if series is not None and all(k in series for k in ("t", "frame_t", "frame_r", "frame_q")):
            poses = finite(Poses(series["frame_t"], series["frame_r"], series["frame_q"]))
            same = not found or poses.r.shape[1:] == found[0].poses.r.shape[1:]
            if len(poses) and len(series["t"]) and same:
                found.append(player_of(run, series, poses))
    return found[len(alike) :]


def player_of(run: Run, series: Series, poses: Poses) -> Player:
    """With poses in the gaps of long steps, where the exact motion is stored beside them."""
    exact = stored_exact(series)
    if len(poses) < 2 or exact is None or len(exact) < 2 or exact.r.shape[1:] != poses.r.shape[1:]:
        return Player(run, series, poses)
    scale = run.record.length_scale_m
    return Player(run, series, *fill(poses, exact, scale if scale > 0.0 else 1.0))


def stored_exact(series: Series) -> Poses | None:
    """The exact motion of a series file; None where there is none."""
    if "exact_t" not in series:
        return None
    return finite(Poses(series["exact_t"], series["exact_r"], series["exact_q"]))


def scene(
    variant: Variant, cast_: Sequence[Player], looks: Mapping[str, Look], pose_bytes: float = POSE_BYTES,
    more: Sequence[Player] = (),
) -> tuple[dict[str, Any], list[dict[str, Any]]]:  # fmt: skip
    """The data of a page, and that of runs which a visitor may add; ``looks`` is colour by solver."""
    lead = cast_[0]
    record, bodies = lead.run.record, lead.poses.r.shape[1]
    scale = record.length_scale_m if record.length_scale_m > 0.0 else 1.0
    t_end = max([record.t_end_s] + [float(p.series["t"][-1]) for p in cast_])
    t_end = t_end if math.isfinite(t_end) and t_end > 0.0 else 1.0
    shapes, kinds = shapes_of(lead.series, lead.poses, scale), select_known([p.series for p in cast_])
    lengths = [float(np.linalg.norm(np.subtract(s.b, s.a))) for s in shapes if s.kind == "rod"]
    body = min(scale, float(np.median(lengths))) if lengths else scale
    ground = ground_points(lead.series)
    gravity = np.asarray(lead.series["gravity"], dtype=float) if "gravity" in lead.series else np.zeros(3)
    sound = [p for p in cast_ if p.run.is_success] or [lead]
    stage = _reach(sound, shapes, ground)
    box = stage.widen(0.75)  # players that fly apart stay at its walls
    long = max(len(p.series["t"]) for p in cast_) > LONG and pose_bytes > FEW * POSE_BYTES
    spans = SPANS if long else SPANS // 2
    at_most = max(2, min(MOST_POSES, int(pose_bytes / (BODY_BYTES * bodies * len(cast_)))))
    ranked = by_solver(p.run for p in (*cast_, *more)).values()  # from a solver's second on: thinner, other dashes
    rank = {run.record.run_id: k for own in ranked for k, run in enumerate(own)}

    exact = exact_of(cast_)

    def pack_player(k: int, p: Player, most: int) -> dict[str, Any]:
        kept, rows = _pack_poses(p.poses, box, body, most)
        distance, angle = off(p.poses, rows)
        r, strips = p.run.record, round_mantissa(strips_of(p.series, p.run, t_end, spans, kinds))
        return {
            "solver": r.solver, "settings": p.run.settings(), "label": r.label,
            "status": p.run.status, "because": "; ".join(p.run.reasons)[:400],
            "run": r.run_id, "colour": looks[r.solver].colour, "rank": rank[r.run_id],
            "stopped": p.run.has_stopped, "last": float(p.series["t"][-1]),
            **kept, "stored": len(p.poses) - p.added, "added": p.added, "unknown": p.unknown,
            "off_m": distance, "off_rad": angle, "strips": strips.ravel(), "marks": marks_of(p.series, p.run, k),
        }  # fmt: skip

    play = {
        "title": variant.title, "t_end": t_end, "bodies": bodies, "scale": scale,
        "gravity": gravity.tolist(), "normal": _normal(lead), "low": stage.low.tolist(), "high": stage.high.tolist(),
        "middle": (0.5 * (box.low + box.high)).tolist(), "quantum": box.quantum.tolist(),
        "ground": ground.tolist(), "shapes": shapes, "trail": _trail(lead, shapes), "spans": spans, "strips": kinds,
        "exact": exact and {**_pack_poses(exact, box, body, MOST_POSES)[0], "until": float(exact.t[-1])},
        "players": [pack_player(k, p, at_most) for k, p in enumerate(cast_)],
        "events_cut": any(len(p.series.events) > EVENTS for p in cast_),
    }  # fmt: skip
    return play, [pack_player(len(cast_), p, min(at_most, ADDED_POSES)) for p in more]


def exact_of(cast_: Sequence[Player]) -> Poses | None:
    """The exact motion, of the run beside which it is known for the longest time."""
    known = [stored_exact(p.series) for p in cast_]
    alike = [e for e in known if e is not None and len(e) and e.r.shape[1:] == cast_[0].poses.r.shape[1:]]
    return max(alike, key=lambda e: float(e.t[-1]), default=None)


def _pack_poses(poses: Poses, box: Box, body: float, at_most: int) -> tuple[dict[str, Any], Int[np.ndarray, " n"]]:
    """Poses as a page holds them, and which ones."""
    rows = enough(poses, at_most, body)
    kept = poses.at(rows)
    both = np.concatenate((packing.positions(kept.r, box), packing.quaternions(kept.q)), axis=-1)
    return {"t": kept.t, "poses": packing.columns(both.reshape(len(kept), -1)), "frames": len(kept)}, rows


def _reach(sound: Sequence[Player], shapes: Sequence[Shape], ground: Float[np.ndarray, "n 3"]) -> Box:
    """The box around all that a camera must hold: the ends of all shapes, wherever they go."""
    thick = max((s.radius for s in shapes), default=0.0)
    body = np.array([s.body for s in shapes for _ in range(2)], dtype=int)
    local = np.array([x for s in shapes for x in (s.a, s.b)]).reshape(-1, 3)
    corners = [ground]
    for p in sound:
        some = p.poses.at(thin_poses(p.poses, VIEWS, 1.0))
        for r, q in zip(some.r, some.q, strict=True):
            x = r[body] + Rotation.from_quat(q[body]).apply(local)
            corners.append(np.stack((x.min(axis=0) - thick, x.max(axis=0) + thick)))
    return box_of(np.concatenate(corners))


def _normal(lead: Player) -> list[float] | None:
    """Normal [space] of the plane in which the bodies' centres stay; None if there is none."""
    points = lead.poses.r.reshape(-1, 3).astype(float)
    points = points[:: max(1, len(points) // 20000)]
    _, size, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    if len(size) < 3 or size[1] == 0.0 or size[2] > FLAT * size[1]:
        return None
    n = axes[2] * np.sign(axes[2][np.argmax(np.abs(axes[2]))])
    return n.tolist()


def _trail(lead: Player, shapes: Sequence[Shape]) -> dict[str, Any]:
    """The end of a body that goes the longest way: what a trail is drawn of."""
    some = lead.poses.at(thin_poses(lead.poses, 200, 1.0))
    best, body, at = -1.0, 0, np.zeros(3)
    bodies = some.r.shape[1]
    for k in range(0, bodies, 1 if bodies <= 200 else 50):
        for end in ends(list(shapes), k):
            x = some.r[:, k] + Rotation.from_quat(some.q[:, k]).apply(end)
            way = float(np.sum(np.linalg.norm(np.diff(x, axis=0), axis=1)))
            if way > best * (1.0 + 1e-6):
                best, body, at = way, k, end
    return {"body": body, "at": at.tolist()}


def choose_players(
    variant: Variant, moved: Sequence[str], at_most: int = AT_MOST
) -> tuple[tuple[Run, ...], tuple[Run, ...]]:
    """The runs that play and those left out; ``moved`` are ids of runs with poses. The first is the solid one.

    The first is one that succeeded, with the fewest options and then the least energy drift.
    """
    can = [c for c in variant.runs if c.record.run_id in set(moved)]
    failing = {c.record.solver for c in can if not c.is_success}
    at_most += max(len(failing) - (AT_MOST - SOUND), 0)
    chosen: list[Run] = []
    for run in _order(can):
        if len(chosen) < at_most and all(_setting(run) != _setting(other) for other in chosen):
            chosen.append(run)
    chosen.sort(key=_soundness)
    return tuple(chosen), tuple(c for c in variant.runs if c not in chosen)


def _order(can: Sequence[Run]) -> Iterator[Run]:
    """All of ``can``, the most telling first; some more than once."""

    def plainest(c: Run) -> tuple[bool, int, float]:
        return (not c.is_success, len(c.options), c.step_or_tolerance)

    def broke(c: Run) -> tuple[bool, bool, float]:
        return (not c.has_stopped, c.is_success, c.step_or_tolerance)

    def label(c: Run) -> tuple[str, str]:
        return c.record.label, c.record.solver

    by_name = sorted(can, key=lambda c: c.record.solver)
    firsts = [min(own, key=plainest) for own in by_solver(by_name).values()]
    known = set(map(label, firsts))
    sound = sorted((c for c in firsts if c.is_success), key=_soundness)
    yield from (sound[k] for k in (0, len(sound) // 2, -1) if sound)
    yield from (min(own, key=broke) for own in by_solver(c for c in by_name if not c.is_success).values())
    yield from firsts
    by_label = group_by(sorted(can, key=label), label).items()
    yield from (min(own, key=broke) for name, own in by_label if name not in known)
    yield from sorted(can, key=broke)


def _setting(c: Run) -> tuple[str, ...]:
    """Its settings, but for the label and the largest number of steps."""
    r = c.record
    return (r.solver, r.control, *map(repr, (r.dt_s, r.rtol, r.max_step_s, r.t_end_s)), repr(sorted(c.options.items())))


def _soundness(c: Run) -> tuple[bool, int, float, str]:
    drift = c.record.energy_drift_max_J
    return (not c.is_success, len(c.options), drift if drift == drift else float("inf"), c.record.run_id)
