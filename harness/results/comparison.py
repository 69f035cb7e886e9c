"""Compare two sets of results run by run: equal bit for bit, different by rounding, or changed.

Runs are matched by their settings, which exclude the code. Times, memory and paths are not compared.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..mechanics.types import Status
from .findings import Finding, Verdict
from .records import COLUMNS, Deviation, RunRecord
from .store import select_newest

NOT_COMPARED = {  # numbers that the machine or the settings determine
    "cpu_min_s",
    "cpu_q1_s",
    "cpu_median_s",
    "cpu_q3_s",
    "cpu_max_s",
    "cpu_call_s",
    "setup_s",
    "wall_s",
    "measure_s",
    "peak_memory_MB",
    "code_s",
    "cpu_import_s",
    "cpu_refuses_s",
    "cpu_process_s",
    "repeats",
    "cpu_limit_s",
    "wall_limit_s",
    "memory_limit_MB",
    "max_steps",
    "series_rows",
    "signal",
    "exit_code",
    "schema",
    "dt_s",
    "rtol",
    "max_step_s",
    "t_end_s",
}
METRICS = tuple(c.name for c in COLUMNS if c.type in (float, int) and c.name not in NOT_COMPARED)
LEAST = 1e-10  # fraction of the scale (or of one unit) below which differences are rounding or stop tests
FIXED_STEP = 1e-6  # relative: rounding accumulated over the steps
ERROR_CONTROL = 0.6  # relative, a factor of 2.5: another libm may change which steps are accepted


@dataclass(frozen=True)
class Comparison:
    """All differences between two sets of results: a finding on each number or status, the largest first.

    It is met if the numbers differ by rounding, within the difference allowed between two machines, and failed if they
    changed. The words of a status are those after; those before are what is required.
    """

    changes: tuple[Finding, ...]
    only_before: tuple[str, ...]
    only_after: tuple[str, ...]
    compared: int  # number of runs compared

    @property
    def is_identical(self) -> bool:
        """True if both sets have the same runs with numbers that are equal bit for bit."""
        return not (self.changes or self.only_before or self.only_after)

    @property
    def alike(self) -> bool:
        """True if both sets have the same runs, and no number differs by more than it may between two machines."""
        changed = any(not c.holds for c in self.changes)
        return not (changed or self.only_before or self.only_after)


def compare(before: Sequence[RunRecord], after: Sequence[RunRecord]) -> Comparison:
    """Compare two sets of records run by run, matched by ``settings_id``; the newest record of each run counts."""
    a, b = ({r.settings_id: r for r in select_newest(records)} for records in (before, after))
    both = [s for s in a if s in b]
    changes = [c for s in both for c in _find_changes(a[s], b[s])]
    return Comparison(
        tuple(sorted(changes, key=lambda c: (-measure_change(c), c.subject, c.quantity))),
        tuple(r.case for s, r in a.items() if s not in b),
        tuple(r.case for s, r in b.items() if s not in a),
        len(both),
    )


def measure_change(c: Finding) -> float:
    """Return the relative change of a number; infinite for a status, and if a number is not finite before or after."""
    if not (math.isfinite(c.before) and math.isfinite(c.value)):
        return math.inf
    return abs(c.value - c.before) / max(abs(c.before), abs(c.value), 1e-300)


def read_change(c: Finding) -> tuple[float | str, float | str]:
    """Return the values before and after a change: two statuses, or two numbers."""
    return (c.required, c.words) if c.words else (c.before, c.value)


def is_repeatable(record: RunRecord) -> bool:
    """Return whether the same run must give the same numbers; False if a limit on time or memory ended it."""
    return record.status not in (Status.STALLED, Status.UNFINISHED, Status.MEMORY) and record.claimed != Status.STALLED


def _find_changes(a: RunRecord, b: RunRecord) -> list[Finding]:
    """Return a finding on each difference in status or a number between the records ``a`` and ``b`` of one run.

    A status that differs fails; a number fails unless it may differ so much between two machines.
    """
    out = []
    if a.status != b.status:
        out.append(Finding("status", words=b.status, required=a.status, verdict=Verdict.FAILED, subject=a.case))
    pairs = [(name, float(getattr(a, name)), float(getattr(b, name))) for name in METRICS]
    pairs += _pair_deviations("observable_errors", a.observables, b.observables)
    pairs += _pair_deviations("invariant_drifts", a.invariants, b.invariants)
    for name, x, y in pairs:
        if not (x == y or (math.isnan(x) and math.isnan(y))):
            verdict = Verdict.from_outcome(_is_rounding(a, name, x, y))
            out.append(Finding(name, y, verdict=verdict, subject=a.case, before=x))
    return out


def _is_rounding(a: RunRecord, name: str, x: float, y: float) -> bool:
    """Return whether two values of the column ``name`` differ by no more than a run may on two machines.

    ``x`` is the value in the record ``a``, ``y`` that in another record of the same run. The allowed difference covers
    rounding or, under error control, another choice of steps. The number of fixed steps must be equal, and a value that
    is not finite differs by more.
    """
    if not (math.isfinite(x) and math.isfinite(y)) or (name == "steps" and a.control == "dt"):
        return False
    scale = max(_finite_or_one(a.energy_scale_J), _finite_or_one(a.length_scale_m), 1.0)
    allowed = FIXED_STEP if a.control == "dt" else ERROR_CONTROL
    return abs(x - y) <= allowed * max(abs(x), abs(y)) + LEAST * scale


def _pair_deviations(
    column: str, a: Mapping[str, Deviation], b: Mapping[str, Deviation]
) -> list[tuple[str, float, float]]:
    """Return name and both maxima of each observable or invariant that both records have in the ``column``."""
    return [(f"{column}.{k}.max", a[k].max, b[k].max) for k in a if k in b]


def _finite_or_one(x: float) -> float:
    """Return ``x``, or 1 if it is not finite."""
    return x if math.isfinite(x) else 1.0
