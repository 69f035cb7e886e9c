"""Two sets of results, run by run: what is the same bit for bit, what differs by rounding, what has changed.

Runs are matched by their settings, which the code is no part of. Times, memory and places of files are not compared.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from ..types import Status
from .records import COLUMNS, RunRecord
from .store import newest

NOT_COMPARED = {
    "cpu_min_s", "cpu_q1_s", "cpu_median_s", "cpu_q3_s", "cpu_max_s", "cpu_call_s", "setup_s", "wall_s", "measure_s",
    "peak_memory_MB", "code_s", "cpu_import_s", "cpu_refuses_s", "cpu_process_s", "repeats", "cpu_limit_s",
    "wall_limit_s", "memory_limit_MB", "max_steps", "series_rows", "signal", "exit_code", "schema", "dt_s", "rtol",
    "max_step_s", "t_end_s",
}  # fmt: skip
METRICS = tuple(c.name for c in COLUMNS if c.type in (float, int) and c.name not in NOT_COMPARED)
LEAST = 1e-10  # of the scale (or of one unit): below it, numbers are rounding and stop tests of another machine
FIXED_STEP = 1e-6  # relative: rounding, piled up over the steps
ERROR_CONTROL = 0.6  # relative, a factor of 2.5: another libm may change which steps are accepted


class Likeness(StrEnum):
    """Likeness of two numbers, worst last."""

    SAME = "same"  # bit for bit
    ROUNDING = "rounding"  # within what two machines may differ by
    CHANGED = "changed"


@dataclass(frozen=True)
class Change:
    """One metric of one run, before and after; for "status" the words are compared."""

    case: str
    metric: str
    before: float | str
    after: float | str
    likeness: Likeness

    @property
    def size(self) -> float:
        """Relative, infinite where a status changed or a number came or went."""
        a, b = self.before, self.after
        if isinstance(a, str) or isinstance(b, str) or not (math.isfinite(a) and math.isfinite(b)):
            return math.inf
        return abs(b - a) / max(abs(a), abs(b), 1e-300)


@dataclass(frozen=True)
class Comparison:
    """All that differs, the largest first."""

    changes: tuple[Change, ...]
    only_before: tuple[str, ...]
    only_after: tuple[str, ...]
    compared: int  # runs

    @property
    def same(self) -> bool:
        """Bit for bit, with the same runs."""
        return not (self.changes or self.only_before or self.only_after)

    @property
    def alike(self) -> bool:
        """Nothing changed by more than machines may differ."""
        changed = any(c.likeness is Likeness.CHANGED for c in self.changes)
        return not (changed or self.only_before or self.only_after)


def compare(before: Sequence[RunRecord], after: Sequence[RunRecord]) -> Comparison:
    """Differences between two sets of records; of several records of a run the newest counts."""
    a, b = ({r.settings_id: r for r in newest(records)} for records in (before, after))
    both = [s for s in a if s in b]
    changes = [c for s in both for c in _find_changes(a[s], b[s])]
    return Comparison(
        tuple(sorted(changes, key=lambda c: (-c.size, c.case, c.metric))),
        tuple(r.case for s, r in a.items() if s not in b),
        tuple(r.case for s, r in b.items() if s not in a),
        len(both),
    )


def is_repeatable(record: RunRecord) -> bool:
    """Whether the same run must give the same numbers: not when a limit on time or memory ended it."""
    return record.status not in (Status.STALLED, Status.UNFINISHED, Status.MEMORY) and record.claimed != Status.STALLED


def _find_changes(a: RunRecord, b: RunRecord) -> list[Change]:
    out = []
    if a.status != b.status:
        out.append(Change(a.case, "status", a.status, b.status, Likeness.CHANGED))
    pairs = [(name, float(getattr(a, name)), float(getattr(b, name))) for name in METRICS]
    pairs += _pair_extents("observable_errors", a, b) + _pair_extents("invariant_drifts", a, b)
    for name, x, y in pairs:
        likeness = _compare_numbers(a, name, x, y)
        if likeness is not Likeness.SAME:
            out.append(Change(a.case, name, x, y, likeness))
    return out


def _compare_numbers(a: RunRecord, name: str, x: float, y: float) -> Likeness:
    if x == y or (math.isnan(x) and math.isnan(y)):
        return Likeness.SAME
    if not (math.isfinite(x) and math.isfinite(y)):
        return Likeness.CHANGED
    scale = max(_finite_or_one(a.energy_scale_J), _finite_or_one(a.length_scale_m), 1.0)
    allowed = FIXED_STEP if a.control == "dt" else ERROR_CONTROL
    if name == "steps" and a.control == "dt":
        return Likeness.CHANGED
    return Likeness.ROUNDING if abs(x - y) <= allowed * max(abs(x), abs(y)) + LEAST * scale else Likeness.CHANGED


def _pair_extents(column: str, a: RunRecord, b: RunRecord) -> list[tuple[str, float, float]]:
    x, y = (json.loads(getattr(r, column)) for r in (a, b))
    return [(f"{column}.{k}.max", float(x[k]["max"]), float(y[k]["max"])) for k in x if k in y]


def _finite_or_one(x: float) -> float:
    return x if math.isfinite(x) else 1.0
