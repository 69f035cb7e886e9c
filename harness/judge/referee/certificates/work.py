"""Compare work and precision: every run as a point, and how many targets each solver reaches for how much work.

A target is a variant and an accuracy, half decades of the mechanism's size. A solver reaches it with the run of least
work, whatever its options, whose error is no larger: best-tuned means the lower envelope of the available runs. Targets
below three times the reference's stated error cannot be judged and are left out; targets that a solver misses count as
not reached, also by a refusal. Wrong runs reach nothing. Profiles count the variants that all solvers were tried on and
that are predictable to their end; points are of all variants. Further profiles count default options only.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ....columns.declared.errors import find_judged_reference_error
from ....mechanics.types import Status
from ....results.judgements.runs import Targets, Work, WorkPoint, WorkProfile
from ....results.least_cost import choose_error, find_cheapest
from ....results.records import RunRecord, is_literal
from ....results.work import count_evaluations, count_index_1_evaluations, count_operations
from ...distance import RESOLVED
from ..claims.measures import reached_end
from .symmetries import CHANGES

TARGETS = tuple(10.0 ** (-0.5 * k) for k in range(2, 19))  # 1e-1 to 1e-9 of the size (or of 1 rad)
FEWEST = 2  # least number of solvers on a variant
JUDGED = 0.9  # fraction of the simulated time that must be judged: a chaotic rest costs work uncompared
REGULAR = 0.5  # fraction of the variants: a solver tried on fewer does not exclude variants


WORKS: Mapping[str, Callable[[RunRecord], float]] = {
    "index1": count_index_1_evaluations,
    "operations": count_operations,
    "evaluations": count_evaluations,
    "factorisations": lambda r: r.factorisations,
    "steps": lambda r: float(r.steps),
    "cpu": lambda r: r.cpu_median_s,
}


@dataclass(frozen=True)
class Field:
    """The runs of one variant by all solvers, and the error by which they are compared."""

    variant: str
    runs: tuple[RunRecord, ...]  # runs that have an error
    tried: frozenset[str]  # solvers, including those that refused or failed
    kind: str  # "position error" or "orientation error"
    unit: str
    size: float  # in that unit
    own: float  # stated error of the reference, in that unit

    def error(self, r: RunRecord) -> float:
        """Return the largest error of a run while the motion is predictable, in ``unit``."""
        return r.position_error_judged_m if self.unit == "m" else r.orientation_error_judged_rad

    @property
    def predictable(self) -> bool:
        """True if errors are judged over nearly all of the time that the work was spent on."""
        return max(r.judged_to_s for r in self.runs) >= JUDGED * self.runs[0].t_end_s

    @property
    def targets(self) -> tuple[float, ...]:
        """The error levels of the variant, in ``unit``, that the reference is precise enough to judge."""
        return tuple(target * self.size for target in TARGETS if target * self.size >= RESOLVED * self.own)


def collect_work(folder: Path, records: Iterable[RunRecord]) -> Work:
    """Return all runs as points of work and error, and work profiles of the variants that can be compared.

    There are profiles of all options and of default options. Variants can be compared if all solvers that were tried on
    ``REGULAR`` of the variants were tried on them, and if their motion is predictable. ``folder`` is not read; the
    signature is that of all judgements.
    """
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
    """Group runs by variant, without those in another presentation or from a literal or perturbed start.

    Variants on which fewer than ``FEWEST`` solvers keep all laws to the end are left out.
    """
    groups: dict[tuple[str, str], list[RunRecord]] = {}
    for r in sorted(records, key=lambda r: (r.problem, r.case, r.finished)):
        if not ({*CHANGES, "perturb"} & r.parameters.keys()) and not is_literal(r):
            groups.setdefault((r.problem, r.problem_parameters), []).append(r)
    fields = [f for own in groups.values() if (f := _make_field(own)) is not None]
    return [f for f in fields if len({r.solver for r in f.runs if _is_sound(r)}) >= FEWEST]


def _make_field(all_runs: Sequence[RunRecord]) -> Field | None:
    """Return the field of all runs of one variant; None if none was compared with a reference.

    Errors are those of positions or, if all positions are exact, of orientations.
    """
    runs = tuple(r for r in all_runs if r.reference and not math.isnan(r.position_error_judged_m))
    if not runs:
        return None
    tried = frozenset(r.solver for r in all_runs)
    name, unit = choose_error(runs)
    length = runs[0].length_scale_m if runs[0].length_scale_m > 0.0 else 1.0
    own, variant = max(find_judged_reference_error(r) for r in runs), runs[0].case.split(" ")[0]
    size, own = (length, own) if unit == "m" else (1.0, own / length)
    return Field(variant, runs, tried, name.replace("_", " "), unit, size, own)


def _is_sound(r: RunRecord) -> bool:
    """Return whether a run reached its end and kept all laws."""
    return Status(r.status).lawful and reached_end(r)


def _make_points(f: Field) -> list[WorkPoint]:
    """Return each run of a variant as a point; ``best`` marks runs that no sound run of the same solver beats."""
    sound = [r for r in f.runs if _is_sound(r)]
    return [
        WorkPoint(
            r.problem,
            f.variant,
            r.solver,
            r.case,
            r.settings_id,
            r.label,
            best=_is_sound(r) and not any(_is_better(f, q, r) for q in sound if q.solver == r.solver),
            status=r.status,
            error=f.error(r),
            error_kind=f.kind,
            unit=f.unit,
            energy_drift_J=r.energy_drift_max_J,
            phi_max=r.phi_max,
            cpu_s=r.cpu_median_s,
            steps=r.steps,
            evaluations=count_evaluations(r),
            factorisations=r.factorisations,
            operations=count_operations(r),
            reference_own_error=f.own,
            index1=count_index_1_evaluations(r),
        )
        for r in f.runs
    ]


def _is_better(f: Field, q: RunRecord, r: RunRecord) -> bool:
    """Return whether ``q`` is no worse than ``r`` in error and operations, and better in one of them."""
    mine, theirs = (f.error(r), count_operations(r)), (f.error(q), count_operations(q))
    return theirs[0] <= mine[0] and theirs[1] <= mine[1] and theirs != mine


def _make_profiles(
    fields: Sequence[Field], solvers: Sequence[str], counts: Callable[[RunRecord], bool]
) -> tuple[WorkProfile, ...]:
    """Return, for each kind of work in ``WORKS`` and each solver, the sorted least work at the targets it reaches.

    ``counts`` tells which runs may reach a target, for example those with default options. Solvers that factorise
    nothing have no profile of factorisations.
    """
    total = sum(len(f.targets) for f in fields)
    out = []
    for (name, of), solver in itertools.product(WORKS.items(), solvers):
        reached = []
        for f in fields:
            runs = [r for r in f.runs if r.solver == solver and _is_sound(r) and counts(r) and not math.isnan(of(r))]
            reached += [of(r) for t in f.targets if (r := find_cheapest(runs, t, f.error, of)) is not None]
        if reached or name != "factorisations":
            out.append(WorkProfile(solver, name, total, tuple(sorted(reached))))
    return tuple(out)
