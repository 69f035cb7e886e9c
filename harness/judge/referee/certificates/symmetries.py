"""Check symmetries of mechanics that a solver must keep for every motion, without a reference.

Each check compares two runs that differ only in the presentation: frame, mirror image, numbering, units, a joint
declared twice, or the direction of time. The allowed distance of their ends is measured: ``SLACK`` times the change of
the solver's end at a tenth of its tolerance, plus rounding times the growth of a start changed by 1e-10, plus for fixed
steps ``HALVES`` times the change at half the step. Two runs of one motion may differ by their errors; whether a fixed
step keeps a symmetry exactly, without that last part, is stated beside the verdict.

A number that is not finite gives no verdict; nor does a bound above the mechanism's size, or one that is missed by less
than its uncertainty. Of a broken symmetry ``false_successes`` says whether it misleads.

Distances are of whole poses: the maximum over bodies of |r - r'| and of L times the angle from R to R', with L the
mechanism's size.
"""

import functools
import itertools
import json
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from ....mechanics import so3
from ....mechanics.types import Status
from ....mechanics.types.presentations import PRESENTATIONS
from ....results import store
from ....results.judgements.runs import PLANARITY, Symmetry, SymmetryVerdict, Unjudged
from ....results.records import RunRecord
from ....results.words import describe_ending
from ...distance import measure_distance
from ...invariance import SLACK, Yardstick
from ..false_successes import weigh_break
from .orders import read_tolerance

TENTH = (0.05, 0.2)  # range of tolerance ratios that count as a tenth
CHANGES: Mapping[str, str] = {p.name: p.check for p in PRESENTATIONS}
SHAPING = ("problem", "problem_parameters", "solver", "solver_options", "control", "dt_s", "rtol", "max_step_s")
COMPARED = ("problem_parameters", "rtol", "dt_s")  # columns in which runs of a check differ, one at a time
End = tuple[np.ndarray, np.ndarray, np.ndarray]  # r [m] and R of all bodies, and gravity, in space
ReadEnd = Callable[[RunRecord], End | None]


def check_symmetries(folder: Path, records: Iterable[RunRecord]) -> tuple[Symmetry, ...]:
    """Compare pairs of runs that differ in the presentation alone; return a verdict for each solver, check and variant.

    ``folder`` has the series of ``records``. A run is judged if the results also have the runs that its bound is
    measured from: one with a tenth of the tolerance, one from a perturbed start, and for fixed steps one with half the
    step. Whether a planar motion stays in its plane is judged of these runs, too.
    """
    known = {_make_key(r): r for r in sorted(records, key=lambda r: (r.finished, r.settings_id))}
    runs = sorted(known.values(), key=lambda r: (r.problem, r.problem_parameters, r.solver, r.settings_id))
    read: ReadEnd = functools.cache(functools.partial(read_last_poses, folder))  # each run once
    grouped: dict[tuple, list[RunRecord]] = {}  # grouped, so that thousands of runs are not compared in pairs
    for r, column in itertools.product(runs, COMPARED):
        grouped.setdefault(_make_key(r, column), []).append(r)
    found = []
    for base in runs:
        relatives, others, finer = (grouped[_make_key(base, column)] for column in COMPARED)
        presented = [r for r in relatives if _find_change(base, r)]
        explicit = base if math.isnan(read_tolerance(base)) else None  # no equations are solved to a tolerance
        tighter = min(
            (r for r in others if TENTH[0] < read_tolerance(r) / read_tolerance(base) < TENTH[1]),
            key=lambda r: _distance_from_tenth(base, r),
            default=explicit,
        )
        perturbed = (r for r in relatives if _is_perturbed(base, r))
        nudged = min(perturbed, key=lambda r: (_read_perturbation(r), r.settings_id), default=None)
        halved = next((r for r in finer if 2.0 * r.dt_s == base.dt_s), None)
        if not presented or tighter is None or nudged is None or (halved is None and base.control == "dt"):
            continue
        found.append((base, presented, _measure_yardstick(base, tighter, nudged, halved, read)))
    measured = [(base, yardstick) for base, _, yardstick in found if yardstick is not None]
    out: list[Symmetry] = []
    for base, presented, own in found:
        yardstick = own and replace(own, growth=_find_least_growth(base, measured))
        for r in sorted(presented, key=lambda r: (list(CHANGES).index(_find_change(base, r)), r.case)):
            out.append(weigh_break(_judge_presentation(base, r, _find_change(base, r), yardstick, read), base, r))
        for r in (base, *presented):
            if (row := _judge_planarity(base, r, yardstick)) is not None:
                out.append(weigh_break(row, r, r))
    return tuple(out)


def _measure_distance(read: ReadEnd, one: RunRecord, other: RunRecord, turned: np.ndarray) -> float:
    """Return the distance of the last poses of two runs [m]; NaN if one run has no series.

    ``turned`` (3, 3) is the rotation of the scene of ``other`` relative to that of ``one``; poses are rotated back.
    """
    a, b = read(one), read(other)
    if a is None or b is None:
        return math.nan
    return float(measure_distance((b[0] @ turned, turned.T @ b[1]), a[:2], one.length_scale_m))


def read_last_poses(folder: Path, r: RunRecord) -> End | None:
    """Return the last poses of a run with its gravity, from its series in ``folder``; None if it has no series."""
    s = store.read_run_series(folder, r)
    return None if s is None else (s["end_r"], s["end_R"], s["gravity"])


def _make_key(r: RunRecord, left_out: str = "") -> tuple[str, ...]:
    """Return the settings that determine a run's motion as a key, by which equal runs are found or grouped.

    The column ``left_out`` of the record is not in the key, so that runs that differ in it alone share it; for ``rtol``
    and fixed steps that is the tolerance of the step equations.
    """
    shape = {k: str(getattr(r, k)) for k in SHAPING if k != left_out}
    if left_out == "rtol" and r.control == "dt":
        options = {k: v for k, v in r.options.items() if k != "tolerance"}
        shape["solver_options"] = json.dumps(options, sort_keys=True)
    return left_out, *shape.values()


def _find_change(base: RunRecord, r: RunRecord) -> str:
    """Return the name of the presentation, such as ``yaw`` or ``mirror``, that ``r`` has and ``base`` has not.

    It is empty unless ``r`` has exactly one parameter of the problem more, a presentation, and ``base`` has none.
    """
    here, there = base.parameters, r.parameters
    if any(k in CHANGES for k in here) or any(there.get(k) != v for k, v in here.items()):
        return ""
    more = [k for k in there if k not in here]
    return more[0] if len(more) == 1 and more[0] in CHANGES else ""


def _is_perturbed(base: RunRecord, r: RunRecord) -> bool:
    """Return whether ``r`` differs from ``base`` only by a perturbed start."""
    others = {k: v for k, v in r.parameters.items() if k != "perturb"}
    return _read_perturbation(r) > 0.0 and others == base.parameters


def _read_perturbation(r: RunRecord) -> float:
    """Return the relative perturbation of a run's start; 0 if the start is not perturbed."""
    return float(r.parameters.get("perturb", 0.0))


def _distance_from_tenth(base: RunRecord, r: RunRecord) -> tuple[float, str]:
    """Return a sort key of ``r``: how far its tolerance is from a tenth of that of ``base``, as |ln| of their ratio.

    Its settings_id decides ties.
    """
    return abs(math.log(10.0 * read_tolerance(r) / read_tolerance(base))), r.settings_id


def _measure_yardstick(
    base: RunRecord, tighter: RunRecord, nudged: RunRecord, halved: RunRecord | None, read: ReadEnd
) -> Yardstick | None:
    """Return the yardstick of ``base``, the difference allowed to its presentations; None if one run did not succeed.

    ``tighter`` has a tenth of the tolerance, ``nudged`` a perturbed start, ``halved`` half the step (None under
    error control); from their distances to ``base`` it is measured.
    """
    if any(r is not None and r.claimed != "success" for r in (base, tighter, nudged, halved)):
        return None
    level = _measure_distance(read, base, tighter, np.eye(3))
    growth = _measure_distance(read, base, nudged, np.eye(3)) / (_read_perturbation(nudged) * base.length_scale_m)
    step = 0.0 if halved is None else _measure_distance(read, base, halved, np.eye(3))
    return Yardstick(level, step, growth, base.steps, base.length_scale_m)


def _find_least_growth(base: RunRecord, found: Iterable[tuple[RunRecord, Yardstick]]) -> float:
    """Return the least growth of a changed start among runs of the motion of ``base``; NaN if none is finite.

    The least is the best estimate: under error control a changed start also moves the steps, which adds to the growth.
    """
    same = [y.growth for b, y in found if (b.problem, b.problem_parameters) == (base.problem, base.problem_parameters)]
    return min((g for g in same if math.isfinite(g)), default=math.nan)


def _prepare_row(base: RunRecord, check: str, *runs: RunRecord) -> Callable[..., Symmetry]:
    """Return a function that makes the ``Symmetry`` of ``check`` for these runs, given the verdict and the numbers."""
    options, variant = dict(base.options), base.case.split(" ")[0]
    ids = tuple(r.settings_id for r in runs)
    return functools.partial(Symmetry, base.solver, options, check, base.problem, variant, ids)


def _judge_presentation(
    base: RunRecord, r: RunRecord, change: str, yardstick: Yardstick | None, read: ReadEnd
) -> Symmetry:
    """Return the verdict on whether ``r`` ends where ``base`` ends; they differ by the presentation ``change`` alone.

    ``yardstick`` is the allowed difference, None if a run that it is measured from failed. Without a verdict, the row
    says which run failed or refused, or that the check does not apply: one body cannot be renumbered.
    """
    value = r.parameters[change]
    make_row = _prepare_row(base, CHANGES[change], base, r)
    if change.startswith("unit_"):
        make_row = functools.partial(make_row, factor=float(value))
    if base.claimed != "success":
        return make_row(_judge_ending(base), Unjudged.BASE, base.status, describe_ending(base))
    if yardstick is None:
        return make_row("failed", Unjudged.BOUND)
    if r.claimed != "success":
        return make_row(_judge_ending(r), Unjudged.PRESENTED, r.status, describe_ending(r))
    end = read(base)
    if change == "renumber" and end is not None and len(end[0]) == 1:
        return make_row("not applicable", Unjudged.SINGLE)
    deviation = measure_deviation(base, r, read)
    if change == "retrace":
        yardstick = replace(yardstick, grown=yardstick.return_factor)
        if math.isnan(deviation):
            return make_row("failed", Unjudged.WAY_BACK, "", *r.note_lines[-1:], bound=yardstick.bound)
    return _judge_deviation(make_row, deviation, yardstick)


def measure_deviation(base: RunRecord, r: RunRecord, read: ReadEnd) -> float:
    """Return the distance [m] between the ends of ``base`` and ``r``, its presentation, in the frame of ``base``.

    For a motion that is integrated back to its start (``retrace``), it is the distance of ``r`` from that start. NaN if
    a pose that is compared does not exist.
    """
    change = _find_change(base, r)
    if change == "retrace":
        return float(np.maximum(r.return_error_m, r.length_scale_m * r.return_error_rad))
    end = read(base)
    turned = np.eye(3) if end is None else _compute_frame_rotation(change, r.parameters[change], end[2])
    return _measure_distance(read, base, r, turned)


def _judge_planarity(base: RunRecord, r: RunRecord, yardstick: Yardstick | None) -> Symmetry | None:
    """Return the verdict on whether the planar motion ``r`` stays in its plane.

    ``r`` is ``base`` itself or its presentation in a rotated frame. None for other presentations, motions that are not
    planar, runs that did not succeed, and without the allowed difference ``yardstick``.
    """
    if math.isnan(r.out_of_plane_max_m) or yardstick is None or r.claimed != "success":
        return None
    change = _find_change(base, r)
    if r is not base and change not in ("yaw", "rotation"):
        return None
    make_row = _prepare_row(base, PLANARITY, r)
    return _judge_deviation(
        functools.partial(make_row, presented=CHANGES.get(change, "")), r.out_of_plane_max_m, yardstick
    )


def _judge_deviation(make_row: Callable[..., Symmetry], deviation: float, yardstick: Yardstick) -> Symmetry:
    """Return the row of a check, with the verdict on a deviation [m] against the allowed difference ``yardstick``.

    ``make_row`` makes the row of verdict and numbers. A deviation or bound that is not finite gives ``failed``.
    """
    if not math.isfinite(deviation) or not math.isfinite(yardstick.bound):
        reason = Unjudged.BOUND if math.isfinite(deviation) else Unjudged.END
        return make_row("failed", reason, bound=yardstick.bound)
    verdict = yardstick.judge(deviation)
    return make_row(
        verdict,
        deviation=deviation,
        bound=yardstick.bound,
        exact=None if yardstick.halved == 0.0 else yardstick.is_exact(deviation) and verdict == "holds",
        exact_bound=yardstick.exact,
        level=yardstick.level,
        halved=yardstick.halved,
        rounding=yardstick.rounding / SLACK,
        growth=yardstick.growth,
    )


def _judge_ending(r: RunRecord) -> SymmetryVerdict:
    """Return the verdict for a run that did not succeed: ``refused`` or ``failed``."""
    return "refused" if r.status == Status.REFUSED else "failed"


def _compute_frame_rotation(change: str, value: Any, gravity: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    """Return the rotation matrix by which a presentation turns the whole problem in space; the identity for others.

    ``change`` names the presentation: ``rotation`` with the rotation vector ``value`` [rad], or ``yaw`` with the angle
    ``value`` [rad] about the upward vertical, against ``gravity`` [m/s2] or, without gravity, the z axis.
    """
    if change == "rotation":
        return so3.exp(np.array(value, dtype=float))
    if change == "yaw":
        g = float(np.linalg.norm(gravity))
        return so3.exp(float(value) * (-gravity / g if g > 0.0 else np.array([0.0, 0.0, 1.0])))
    return np.eye(3)
