"""Rank entries by the instances that they solve, their false successes, and their CPU time at a given error."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from ...judge.invariance import describe_rerun
from ...mechanics.types import Status
from ...results.least_cost import find_cheapest
from ...results.records import RunRecord
from .bundling import Entry

TARGET = 1e-3  # error to be met, relative to the length of the motion
FALSE = -1  # points of an instance with a false success; a solved one has 1, one without an answer 0
# bootstrap over instances: the share below an end is known to 0.007 (half: 0.01, twice: 0.005); random seed
DRAWS, SPREAD, SEED = 1000, 0.9, 1
LIES = (Status.WRONG, Status.INACCURATE)  # statuses that count as false success
INDEPENDENT, OURS, RE_RUN = LABELS = ("independent", "ours", "re-run by us")


@dataclass(frozen=True)
class Interval:
    """A value with the ends of its confidence interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class RankedEntry:
    """The row of an entry in the ladder."""

    file: str
    solver: str
    label: str
    points: int
    solved: int  # instances solved at ``TARGET`` without any false success
    instances: int  # number of instances in all
    false: int  # instances with a false success
    cost: Interval  # [s] of CPU to meet the target, geometric mean over solved instances
    frontier: tuple[tuple[float, Interval], ...]  # error and cost [s] of each setting, over its successes
    forged: tuple[str, ...] = ()
    rank: int = 0
    leads: bool = False  # run by us, and no other entry is significantly cheaper at an error as small
    fenced: bool = False  # whether its runs were confined


def rank_entries(entries: Sequence[tuple[Entry, str]]) -> list[RankedEntry]:
    """Return the ladder's rows, the best first, from entries with their labels.

    The order is by points, then by cost. Invalid entries, which include those that our own re-run contradicts, come
    last and have no rank.
    """
    known = {(e.digest, e.seed): e for e, label in entries if label == RE_RUN and not e.forged}
    rows = [
        _make_row(
            entry if label == RE_RUN else replace(entry, forged=entry.forged + _find_differences(entry, known)), label
        )
        for entry, label in entries
    ]
    sound = sorted((r for r in rows if not r.forged), key=lambda r: (-r.points, _make_cost_key(r.cost.value), r.file))
    ranked = [
        replace(r, rank=k + 1, leads=r.label != INDEPENDENT and _is_leading(r, sound)) for k, r in enumerate(sound)
    ]
    return ranked + sorted((r for r in rows if r.forged), key=lambda r: r.file)


def _find_differences(entry: Entry, known: Mapping[tuple[str, str], Entry]) -> tuple[str, ...]:
    """Return in words where an entry differs from our own re-run of it; empty if it agrees or there is no re-run.

    ``known`` are re-runs by digest and seed.
    """
    ours = known.get((entry.digest, entry.seed))
    if ours is None:
        return ()
    stated = {_make_setting_key(r): r for r in entry.records}
    return tuple(filter(None, (describe_rerun(stated.get(_make_setting_key(own)), own) for own in ours.records)))


def _make_setting_key(r: RunRecord) -> str:
    """Return a key that identifies a record's instance and its step or tolerance."""
    return str((_make_instance_key(r), r.dt_s, r.rtol))


def _make_instance_key(r: RunRecord) -> str:
    """Return a key that identifies a record's instance: its problem with all parameters."""
    return f"{r.problem} {json.dumps(dict(r.parameters), sort_keys=True)}"


def _make_row(entry: Entry, label: str) -> RankedEntry:
    """Return the row of an entry, without rank; if the entry is invalid, without numbers.

    An instance with a false success counts ``FALSE`` points and has no part in the costs.
    """
    nothing = Interval(math.nan, math.nan, math.nan)
    if entry.forged:
        return RankedEntry(entry.file, entry.solver, label, 0, 0, 0, 0, nothing, (), entry.forged, fenced=entry.fenced)
    instances = dict[str, list[RunRecord]]()
    for r in entry.records:
        instances.setdefault(_make_instance_key(r), []).append(r)
    false = sum(any(r.status in LIES for r in runs) for runs in instances.values())
    honest = [runs for runs in instances.values() if not any(r.status in LIES for r in runs)]
    found = (find_cheapest(runs, TARGET, compute_relative_error, lambda r: r.cpu_median_s) for runs in honest)
    cheapest = [r.cpu_median_s for r in found if r is not None]
    return RankedEntry(
        entry.file,
        entry.solver,
        label,
        len(cheapest) + FALSE * false,
        len(cheapest),
        len(instances),
        false,
        average_geometrically(np.array(cheapest)),
        tuple(_compute_frontier(honest)),
        fenced=entry.fenced,
    )


def compute_relative_error(r: RunRecord) -> float:
    """Return the largest motion error of a run over the length scale; infinity unless it is a finite success."""
    error = r.motion_error_max_m / r.length_scale_m if r.status == Status.SUCCESS else math.nan
    return error if math.isfinite(error) else math.inf


def _compute_frontier(honest: Sequence[Sequence[RunRecord]]) -> list[tuple[float, Interval]]:
    """Return error and cost [s] of each setting: geometric means over its successes on the instances given.

    ``honest`` are the runs of each instance that has no false success. Errors are relative to the length scale.
    """
    settings = sorted({(r.dt_s, r.rtol) for runs in honest for r in runs}, key=str)
    points = []
    for setting in settings:
        runs = [
            r
            for of in honest
            for r in of
            if str((r.dt_s, r.rtol)) == str(setting) and compute_relative_error(r) < math.inf
        ]
        if runs:
            error = float(np.exp(np.mean(np.log([max(compute_relative_error(r), 1e-16) for r in runs]))))
            points.append((error, average_geometrically(np.array([r.cpu_median_s for r in runs]))))
    return points


def average_geometrically(x: Float[np.ndarray, " n"]) -> Interval:
    """Return the geometric mean of positive numbers, with its 90 % confidence interval by a bootstrap over them.

    NaN without numbers. Numbers below 1e-6 count as 1e-6.
    """
    if not len(x):
        return Interval(math.nan, math.nan, math.nan)
    logs = np.log(np.maximum(x, 1e-6))
    drawn = np.random.default_rng(SEED).choice(logs, (DRAWS, len(logs))).mean(axis=1)
    low, high = np.quantile(drawn, [0.5 - SPREAD / 2, 0.5 + SPREAD / 2])
    return Interval(float(np.exp(logs.mean())), float(np.exp(low)), float(np.exp(high)))


def _is_leading(row: RankedEntry, rows: Sequence[RankedEntry]) -> bool:
    """Return whether one of an entry's settings is undercut by none of the better or equal entries.

    These have at least as many points; they undercut it at an error as small, by a cost whose interval lies below.
    """
    others = [p for r in rows if r is not row and r.points >= row.points for p in r.frontier]
    return any(
        not any(error <= own and cost.high < own_cost.low for error, cost in others) for own, own_cost in row.frontier
    )


def _make_cost_key(value: float) -> float:
    """Return a cost as a sort key: infinity if it is not finite."""
    return value if math.isfinite(value) else math.inf
