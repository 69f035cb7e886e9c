"""The order of entries: what they solve, what they claim falsely, and their CPU time at an error."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from ..results.records import RunRecord
from ..types import Status
from .bundling import Entry

TARGET = 1e-3  # of the length of a motion: the error that is to be met
FALSE = -1  # points of an instance with a false success; one that is solved has 1, one without an answer 0
DRAWS, SPREAD, SEED = 1000, 0.9, 1  # of the bootstrap over instances: how many, which share lies within, random seed
LIES = (Status.WRONG, Status.INACCURATE)
INDEPENDENT, OURS, RE_RUN = LABELS = ("independent", "ours", "re-run by us")
MOTION, COST = 0.01, 0.5  # relative difference of errors, and least share of our CPU time, that a re-run allows


@dataclass(frozen=True)
class Interval:
    """A value with the bounds of its confidence interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Row:
    """An entry in the ladder."""

    file: str
    solver: str
    label: str
    points: int
    solved: int
    instances: int
    false: int
    cost: Interval  # [s] of CPU to meet the target, geometric mean over instances that are solved
    frontier: tuple[tuple[float, Interval], ...]  # error, cost [s] of each setting, of instances that all succeed
    forged: tuple[str, ...] = ()
    rank: int = 0
    leads: bool = False  # run by us, and no other entry meets an error as small for surely less
    fenced: bool = False  # whether its runs were kept from all that is not theirs


def rank_entries(entries: Sequence[tuple[Entry, str]]) -> list[Row]:
    """Rows of entries with their labels, the best first; those with a forgery last and without a rank."""
    known = {(e.digest, e.seed): e for e, label in entries if label == RE_RUN and not e.forged}
    rows = [
        _row(entry if label == RE_RUN else replace(entry, forged=entry.forged + _differences(entry, known)), label)
        for entry, label in entries
    ]
    sound = sorted((r for r in rows if not r.forged), key=lambda r: (-r.points, _or_last(r.cost.value), r.file))
    ranked = [replace(r, rank=k + 1, leads=r.label != INDEPENDENT and _leads(r, sound)) for k, r in enumerate(sound)]
    return ranked + sorted((r for r in rows if r.forged), key=lambda r: r.file)


def _differences(entry: Entry, known: Mapping[tuple[str, str], Entry]) -> tuple[str, ...]:
    """Where an entry differs from our own re-run of it, if there is one."""
    ours = known.get((entry.digest, entry.seed))
    if ours is None:
        return ()
    found, stated = list[str](), {_setting(r): r for r in entry.records}
    for own in ours.records:
        r = stated.get(_setting(own))
        if r is None or r.status != own.status:
            found.append(f"{own.case}: {own.status} when run again")
        elif abs(r.motion_error_max_m - own.motion_error_max_m) > MOTION * own.motion_error_max_m:
            found.append(f"{own.case}: an error of {own.motion_error_max_m:.3g} m when run again")
        elif r.cpu_median_s < COST * own.cpu_median_s:
            found.append(f"{own.case}: {own.cpu_median_s:.2g} s of CPU when run again")
    return tuple(found)


def _setting(r: RunRecord) -> str:
    return str((_instance(r), r.dt_s, r.rtol))


def _instance(r: RunRecord) -> str:
    return f"{r.problem} {json.dumps(json.loads(r.problem_parameters), sort_keys=True)}"


def _row(entry: Entry, label: str) -> Row:
    nothing = Interval(math.nan, math.nan, math.nan)
    if entry.forged:
        return Row(entry.file, entry.solver, label, 0, 0, 0, 0, nothing, (), entry.forged, fenced=entry.fenced)
    instances = dict[str, list[RunRecord]]()
    for r in entry.records:
        instances.setdefault(_instance(r), []).append(r)
    false = sum(any(r.status in LIES for r in runs) for runs in instances.values())
    honest = [runs for runs in instances.values() if not any(r.status in LIES for r in runs)]
    cheapest = [min(met) for runs in honest if (met := [r.cpu_median_s for r in runs if error_of(r) <= TARGET])]
    return Row(
        entry.file, entry.solver, label, len(cheapest) + FALSE * false, len(cheapest), len(instances), false,
        mean_of(np.array(cheapest)), tuple(_frontier(honest)), fenced=entry.fenced,
    )  # fmt: skip


def error_of(r: RunRecord) -> float:
    """The motion's largest error over its length; infinite where there is no success."""
    error = r.motion_error_max_m / r.length_scale_m if r.status == Status.SUCCESS else math.nan
    return error if math.isfinite(error) else math.inf


def _frontier(honest: Sequence[Sequence[RunRecord]]) -> list[tuple[float, Interval]]:
    settings = sorted({(r.dt_s, r.rtol) for runs in honest for r in runs}, key=str)
    points = []
    for setting in settings:
        runs = [r for of in honest for r in of if str((r.dt_s, r.rtol)) == str(setting) and error_of(r) < math.inf]
        if runs:
            error = float(np.exp(np.mean(np.log([max(error_of(r), 1e-16) for r in runs]))))
            points.append((error, mean_of(np.array([r.cpu_median_s for r in runs]))))
    return points


def mean_of(x: Float[np.ndarray, " n"]) -> Interval:
    """The geometric mean, with the interval that a bootstrap over instances gives."""
    if not len(x):
        return Interval(math.nan, math.nan, math.nan)
    logs = np.log(np.maximum(x, 1e-6))
    drawn = np.random.default_rng(SEED).choice(logs, (DRAWS, len(logs))).mean(axis=1)
    low, high = np.quantile(drawn, [0.5 - SPREAD / 2, 0.5 + SPREAD / 2])
    return Interval(float(np.exp(logs.mean())), float(np.exp(low)), float(np.exp(high)))


def _leads(row: Row, rows: Sequence[Row]) -> bool:
    others = [p for r in rows if r is not row and r.points >= row.points for p in r.frontier]
    return any(
        not any(error <= own and cost.high < own_cost.low for error, cost in others) for own, own_cost in row.frontier
    )


def _or_last(value: float) -> float:
    return value if math.isfinite(value) else math.inf
