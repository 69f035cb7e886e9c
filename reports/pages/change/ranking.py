"""Changes between two results, the most important first: status, claims, physics, work, timings last."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

from ....harness.results.comparison import METRICS, Change, Likeness, compare
from ....harness.results.judgements.claims import Claim, Verdict
from ....harness.results.records import RunRecord
from ...model.results import group_by
from ...model.words import mark, number

PHYSICS = {  # column: words, unit, the scale of the record it is measured by
    "energy_drift_max_J": ("largest energy error", "J", "energy_scale_J"),
    "energy_drift_end_J": ("energy error at the end", "J", "energy_scale_J"),
    "position_error_judged_m": ("position error judged", "m", "length_scale_m"),
    "position_error_max_m": ("largest position error", "m", "length_scale_m"),
    "orientation_error_judged_rad": ("orientation error judged", "rad", ""),
    "orientation_error_max_rad": ("largest orientation error", "rad", ""),
    "phi_max": ("largest |φ|", "m", "length_scale_m"),
    "phi_dot_max": ("largest |φ̇|", "m/s", "length_scale_m"),
    "out_of_plane_max_m": ("out of plane", "m", "length_scale_m"),
    "orthogonality_max": ("|RᵀR−1|", "", ""),
    "t_reached_s": ("time reached", "s", "t_end_s"),
}
WORK = {
    "steps": "steps", "rejected": "rejected steps", "evaluations": "evaluations", "jacobians": "Jacobians",
    "factorisations": "factorisations", "newton_iterations": "Newton's corrections",
}  # fmt: skip
BETTER = ("good", "inaccurate", "open", "refused", "failed", "wrong")  # endings, best first
CLAIM_ORDER = (Verdict.SUPPORTED, Verdict.CONDITIONAL, Verdict.MIXED, Verdict.UNTESTABLE, Verdict.REFUTED)
SAME = 0.01  # relative: a change this small is neither better nor worse
LITTLE = 1e-5  # of a problem's scale: shown as "less than"
SPREAD = 1.3  # timings closer than this factor are called equal


class Rank(IntEnum):
    """Kinds of change, the most important first."""

    ENDING = 0
    CLAIM = 1
    PHYSICS = 2
    WORK = 3
    TIMING = 4


@dataclass(frozen=True)
class Ranked:
    """One change in words."""

    rank: Rank
    settings_id: str  # of the run, or the claim's name
    title: str
    what: str
    before: str
    after: str
    size: str
    worse: bool | None  # None where neither is better
    weight: float  # within its rank, the largest first
    others: tuple["Ranked", ...] = ()  # smaller changes of the same kind in the same run


def endings(before: Sequence[RunRecord], after: Sequence[RunRecord]) -> list[Ranked]:
    """Runs whose status changed; those that became wrong first."""
    out = []
    for a, b in pairs(before, after):
        if a.status != b.status:
            (then, old), (now, new) = ((m, BETTER.index(m.kind)) for m in (mark(a.status), mark(b.status)))
            worse = None if old == new or "unfinished" in (a.status, b.status) else new > old
            weight = 10.0 * (new > old) + max(old, new)
            out.append(Ranked(Rank.ENDING, a.settings_id, a.case, "ending", then.word, now.word, "", worse, weight))
    return sort_worst_first(out)


def claims(before: Sequence[Claim], after: Sequence[Claim]) -> list[Ranked]:
    """Claims with another verdict."""
    then = {c.id: c for c in before}
    out = []
    for c in after:
        was = then.get(c.id, c)
        for where, a, b in (("at the paper's settings", was.paper, c.paper), ("beyond them", was.beyond, c.beyond)):
            if a and b and a.verdict != b.verdict:
                change = CLAIM_ORDER.index(b.verdict) - CLAIM_ORDER.index(a.verdict)
                out.append(Ranked(Rank.CLAIM, c.id, c.claim, f"verdict {where}", a.verdict.lower(), b.verdict.lower(),
                                  "", change > 0, float(abs(change))))  # fmt: skip
    return sort_worst_first(out)


def physics(before: Sequence[RunRecord], after: Sequence[RunRecord]) -> list[Ranked]:
    """Numbers that changed by more than two machines may differ by, as parts of the problem's own scale."""
    found = (_physics(a, b, c) for a, b, c in _changes(before, after) if c.metric in PHYSICS)
    return gather_by_run([r for r in found if r])


def work(before: Sequence[RunRecord], after: Sequence[RunRecord]) -> list[Ranked]:
    """Counts that changed, the largest ratio first."""
    out = []
    for a, _, c in _changes(before, after):
        if c.metric in WORK and not isinstance(c.before, str) and not isinstance(c.after, str):
            x, y = c.before, c.after
            ratio = y / x if x > 0.0 else math.inf if y > 0.0 else 1.0
            ratio = ratio if math.isfinite(x) and math.isfinite(y) else math.nan
            weight = abs(math.log(ratio)) if ratio > 0.0 else 99.0
            out.append(Ranked(Rank.WORK, a.settings_id, a.case, WORK[c.metric], number(x), number(y),
                              format_ratio(ratio), ratio > 1.0, weight))  # fmt: skip
    return gather_by_run(out)


def timings(before: Sequence[RunRecord], after: Sequence[RunRecord]) -> list[Ranked]:
    """CPU times further apart than their spreads and than a factor that says nothing."""
    out = []
    for a, b in pairs(before, after):
        x, y = a.cpu_median_s, b.cpu_median_s
        separate = a.cpu_max_s < b.cpu_min_s or b.cpu_max_s < a.cpu_min_s
        if x > 0.0 and y > 0.0 and separate and max(x / y, y / x) > SPREAD:
            out.append(Ranked(Rank.TIMING, a.settings_id, a.case, "CPU time", f"{number(x)} s", f"{number(y)} s",
                              format_ratio(y / x), y > x, abs(math.log(y / x))))  # fmt: skip
    return sort_worst_first(out)


def pairs(before: Sequence[RunRecord], after: Sequence[RunRecord]) -> list[tuple[RunRecord, RunRecord]]:
    """Runs of the same settings."""
    there = {r.settings_id: r for r in after}
    return [(r, there[r.settings_id]) for r in before if r.settings_id in there]


def sort_worst_first(found: list[Ranked]) -> list[Ranked]:
    """Worst first."""
    return sorted(found, key=lambda r: (r.rank, -r.weight, r.title, r.what))


def gather_by_run(found: list[Ranked]) -> list[Ranked]:
    """One a run: its largest change, with the others beneath."""
    by_run = group_by(sort_worst_first(found), lambda r: r.settings_id)
    return [replace(own[0], others=tuple(own[1:])) for own in by_run.values()]


def find_unmeasured(before: Sequence[RunRecord], after: Sequence[RunRecord]) -> tuple[set[str], set[str]]:
    """Columns that no record of one run has and some of the other do: what is measured changed, not the motion."""
    both = pairs(before, after)
    none = [{m for m in METRICS if all(math.isnan(float(getattr(p[k], m))) for p in both)} for k in (0, 1)]
    return none[0] - none[1], none[1] - none[0]


def format_ratio(ratio: float) -> str:
    """``2.1 times``."""
    return f"{number(ratio)} times" if math.isfinite(ratio) and ratio > 0.0 else "–"


def _changes(before: Sequence[RunRecord], after: Sequence[RunRecord]) -> list[tuple[RunRecord, RunRecord, Change]]:
    """Runs that the comparison calls changed, with the two records."""
    out = []
    unknown = set.union(*find_unmeasured(before, after))
    for a, b in pairs(before, after):
        found = compare([a], [b]).changes
        out += [(a, b, c) for c in found if c.likeness is Likeness.CHANGED and c.metric not in {"status", *unknown}]
    return out


def _physics(a: RunRecord, b: RunRecord, c: Change) -> Ranked | None:
    """A number that changed; None where the status says it already."""
    words, unit, column = PHYSICS[c.metric]
    x, y = (math.nan if isinstance(v, str) else v for v in (c.before, c.after))
    scale = float(getattr(a, column)) if column else 1.0
    scale = scale if scale > 0.0 and math.isfinite(scale) else 1.0
    gap = abs(abs(y) - abs(x)) if c.metric.endswith("_end_J") else abs(y - x)
    weight = gap / scale if math.isfinite(gap) else math.inf
    if a.status != b.status and not math.isfinite(weight):
        return None
    alike = math.isnan(x) or math.isnan(y) or gap <= SAME * max(abs(x), abs(y))
    worse = None if alike else y < x if c.metric == "t_reached_s" else abs(y) > abs(x)
    share = f"{number(100.0 * weight)} %" if weight >= LITTLE else f"less than {100.0 * LITTLE:g} %"
    size = f"{share} of the problem's scale" if math.isfinite(weight) else "came or went"
    limit = a.energy_allowed_J
    if c.metric == "energy_drift_max_J" and (x > limit) != (y > limit) and limit > 0.0:
        weight, size = math.inf, f"crosses the benchmark's limit of {number(limit)} J"
    shown, now = (f"{v} {unit}".strip() for v in apart(x, y))
    return Ranked(Rank.PHYSICS, a.settings_id, a.case, words, shown, now, size, worse, weight)


def apart(x: float, y: float) -> tuple[str, str]:
    """Both with as many digits as it takes to see that they differ."""
    pairs_of = ((number(x, digits), number(y, digits)) for digits in range(3, 13))
    return next((p for p in pairs_of if p[0] != p[1]), (number(x), number(y)))
