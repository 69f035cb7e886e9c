"""Work against precision: every run as a point, and how many targets each solver reaches for how much work.

A target is a variant and an accuracy, half decades of the mechanism's size. A solver reaches it with the run
of least work, whatever its options, whose error is no larger: best-tuned means the lower envelope of the runs at hand.
Targets below three times the reference's stated error cannot be judged and are left out; those a solver does not reach
count as not reached, a refusal too. Wrong runs reach nothing. Profiles count the variants that all solvers were tried
on and that are predictable to their end; points are of all variants. Further profiles count default options only.
"""

import itertools
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ...results.judgements.runs import Targets, Work, WorkPoint, WorkProfile
from ...results.records import RunRecord, is_literal, judged_own
from ...results.work import evaluations, index_1_evaluations, operations
from ...types import Status
from .symmetries import CHANGES

TARGETS = tuple(10.0 ** (-0.5 * k) for k in range(2, 19))  # 1e-1 to 1e-9 of the size (of 1 rad)
OWN = 3.0  # times the reference's stated error: nothing is judged below
EXACT = 1e-12  # of the size: where all positions are exact to rounding, orientations are compared
END = 1e-9
FEWEST = 2  # solvers on a variant: fewer are no comparison
JUDGED = 0.9  # of the simulated time: a chaotic rest costs work and is not compared
REGULAR = 0.5  # of the variants: a solver tried on fewer leaves no variant out by its absence


WORKS: Mapping[str, Callable[[RunRecord], float]] = {
    "index1": index_1_evaluations,
    "operations": operations,
    "evaluations": evaluations,
    "factorisations": lambda r: r.factorisations,
    "steps": lambda r: float(r.steps),
    "cpu": lambda r: r.cpu_median_s,
}


@dataclass(frozen=True)
class Field:
    """Runs of one variant, and the error they are compared by."""

    variant: str
    runs: tuple[RunRecord, ...]  # that have an error
    tried: frozenset[str]  # solvers, those that refused or failed among them
    kind: str  # "position error" or "orientation error"
    unit: str
    size: float  # in that unit
    own: float  # of the reference, in that unit

    def error(self, r: RunRecord) -> float:
        """While the motion is predictable."""
        return r.position_error_judged_m if self.unit == "m" else r.orientation_error_judged_rad

    @property
    def predictable(self) -> bool:
        """Whether errors are judged over nearly all of the time that the work was spent on."""
        return max(r.judged_to_s for r in self.runs) >= JUDGED * self.runs[0].t_end_s

    @property
    def targets(self) -> tuple[float, ...]:
        """Errors that the reference can judge."""
        return tuple(target * self.size for target in TARGETS if target * self.size >= OWN * self.own)


def collect_work(folder: Path, records: Iterable[RunRecord]) -> Work:
    """Points, and profiles of the variants that can be compared."""
    fields = _collect_fields(records)
    solvers = sorted({name for f in fields for name in f.tried})
    regular = {name for name in solvers if sum(name in f.tried for f in fields) >= REGULAR * len(fields)}
    counted = [f for f in fields if regular <= f.tried and f.predictable]
    compared = [name for name in solvers if any(name in f.tried for f in counted)]
    return Work(
        tuple(p for f in fields for p in _make_points(f)),
        _make_profiles(counted, compared, lambda r: True),
        _make_profiles(counted, compared, lambda r: r.solver_options == "{}"),
        tuple(Targets(f.variant, f.unit, f.own, f.targets) for f in counted),
    )


def _collect_fields(records: Iterable[RunRecord]) -> list[Field]:
    groups: dict[tuple[str, str], list[RunRecord]] = {}
    for r in sorted(records, key=lambda r: (r.problem, r.case, r.finished)):
        if not ({*CHANGES, "perturb"} & json.loads(r.problem_parameters).keys()) and not is_literal(r):
            groups.setdefault((r.problem, r.problem_parameters), []).append(r)
    fields = [f for own in groups.values() if (f := _make_field(own)) is not None]
    return [f for f in fields if len({r.solver for r in f.runs if _is_sound(r)}) >= FEWEST]


def _make_field(all_runs: Sequence[RunRecord]) -> Field | None:
    runs = tuple(r for r in all_runs if r.reference and not math.isnan(r.position_error_judged_m))
    if not runs:
        return None
    tried = frozenset(r.solver for r in all_runs)
    first = runs[0]
    length = first.length_scale_m if first.length_scale_m > 0.0 else 1.0
    own = max(judged_own(r) for r in runs)
    moved = any(r.position_error_judged_m > EXACT * length for r in runs)
    variant = first.case.split(" ")[0]
    if moved:
        return Field(variant, runs, tried, "position error", "m", length, own)
    return Field(variant, runs, tried, "orientation error", "rad", 1.0, own / length)


def _is_sound(r: RunRecord) -> bool:
    """Whether a run got to its end and nothing contradicts it."""
    return Status(r.status).lawful and r.t_reached_s >= r.t_end_s * (1.0 - END)


def _make_points(f: Field) -> list[WorkPoint]:
    sound = [r for r in f.runs if _is_sound(r)]
    return [
        WorkPoint(r.problem, f.variant, r.solver, r.case, r.settings_id, r.label,
                  _is_sound(r) and not any(_is_better(f, q, r) for q in sound if q.solver == r.solver), r.status,
                  f.error(r), f.kind, f.unit, r.energy_drift_max_J, r.phi_max, r.cpu_median_s, r.steps, evaluations(r),
                  r.factorisations, operations(r), f.own, index_1_evaluations(r))
        for r in f.runs
    ]  # fmt: skip


def _is_better(f: Field, q: RunRecord, r: RunRecord) -> bool:
    """Whether ``q`` is no worse in error and work, and better in one."""
    mine, theirs = (f.error(r), operations(r)), (f.error(q), operations(q))
    return theirs[0] <= mine[0] and theirs[1] <= mine[1] and theirs != mine


def _make_profiles(
    fields: Sequence[Field], solvers: Sequence[str], counts: Callable[[RunRecord], bool]
) -> tuple[WorkProfile, ...]:
    total = sum(len(f.targets) for f in fields)
    out = []
    for (name, of), solver in itertools.product(WORKS.items(), solvers):
        reached = []
        for f in fields:
            runs = [r for r in f.runs if r.solver == solver and _is_sound(r) and counts(r) and not math.isnan(of(r))]
            costs = [[of(r) for r in runs if f.error(r) <= target] for target in f.targets]
            reached += [min(c) for c in costs if c]
        if reached or name != "factorisations":
            out.append(WorkProfile(solver, name, total, tuple(sorted(reached))))
    return tuple(out)
