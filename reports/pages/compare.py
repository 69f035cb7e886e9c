"""Compare two results: what changed, the most important first, and which inputs may be the cause."""

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from pathlib import Path

from ...harness.base.confined_paths import ConfinedPath
from ...harness.results.comparison import METRICS, compare, is_repeatable
from ...harness.results.findings import Finding
from ...harness.results.judgements.claims import ClaimVerdict, JudgedClaim
from ...harness.results.judgements.files import CLAIMS, FIELD_CLAIMS
from ...harness.results.provenance import find_differences, read_environment
from ...harness.results.records import DECLARED, RunRecord, find_cpu_range
from ..model.curves import find_maxima
from ..model.results import StoredResults, StoredRun, group_by, make_slug, read_results
from ..model.words import mark_status, number
from ..plots.spec import Axis, Plot, Trace
from .base import Page, Site, address_run, copy_assets, read_judged

OVERLAYS = 24  # most runs whose energy errors are overlaid, the largest changes first
ASSETS = ("site.css", "site.js", "judgement.css", "judgement.js", "plots.js")
PHYSICS = {  # column: words, unit, the record's column that scales it
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
} | {name: (d.head, d.unit, d.scale) for name, d in DECLARED.items() if d.scale is not None}
WORK = {
    "steps": "steps",
    "rejected": "rejected steps",
    "evaluations": "evaluations",
    "jacobians": "Jacobians",
    "factorisations": "factorisations",
    "newton_iterations": "Newton's corrections",
}
BETTER = ("good", "inaccurate", "open", "refused", "failed", "wrong")  # endings, best first
CLAIM_ORDER = (
    ClaimVerdict.REPRODUCED,
    ClaimVerdict.REPRODUCED_IF,
    ClaimVerdict.CANNOT_BE_TOLD,
    ClaimVerdict.NOT_REPRODUCED,
)
SAME = 0.01  # relative change below which neither is better
LITTLE = 1e-5  # fraction of the problem's scale below which "less than" is shown
SPREAD = 1.3  # timings within this factor are equal


class Rank(IntEnum):
    """The kinds of change, the most important first."""

    ENDING = 0
    CLAIM = 1
    PHYSICS = 2
    WORK = 3
    TIMING = 4


@dataclass(frozen=True)
class RankedChange:
    """A change in words."""

    rank: Rank
    settings_id: str  # settings_id of the run, or the claim's name
    title: str
    what: str
    before: str
    after: str
    size: str  # size of the change, in words
    worse: bool | None  # None if neither is better
    weight: float  # order within its rank, the largest first
    others: tuple["RankedChange", ...] = ()  # smaller changes of the same kind in the same run


def list_changed_statuses(before: Sequence[RunRecord], after: Sequence[RunRecord]) -> list[RankedChange]:
    """Return a change for each run whose status differs; runs that became worse come first."""
    out = []
    for a, b in pair_runs(before, after):
        if a.status != b.status:
            (then, old), (now, new) = (
                (m, BETTER.index(m.kind)) for m in (mark_status(a.status), mark_status(b.status))
            )
            worse = None if old == new or "unfinished" in (a.status, b.status) else new > old
            weight = 10.0 * (new > old) + max(old, new)
            out.append(
                RankedChange(Rank.ENDING, a.settings_id, a.case, "ending", then.word, now.word, "", worse, weight)
            )
    return sort_worst_first(out)


def list_changed_claims(before: Sequence[JudgedClaim], after: Sequence[JudgedClaim]) -> list[RankedChange]:
    """Return a change for each verdict on a claim that differs."""
    then = {c.id: c for c in before}
    out = []
    for c in after:
        was = then.get(c.id, c)
        for where, a, b in (("at the paper's settings", was.paper, c.paper), ("beyond them", was.beyond, c.beyond)):
            if a and b and a.verdict != b.verdict:
                change = CLAIM_ORDER.index(b.verdict) - CLAIM_ORDER.index(a.verdict)
                out.append(
                    RankedChange(
                        Rank.CLAIM,
                        c.id,
                        c.claim,
                        f"verdict {where}",
                        a.verdict.lower(),
                        b.verdict.lower(),
                        "",
                        change > 0,
                        float(abs(change)),
                    )
                )
    return sort_worst_first(out)


def list_changed_physics(before: Sequence[RunRecord], after: Sequence[RunRecord]) -> list[RankedChange]:
    """Return one change per run whose motion differs by more than it does between two machines, the largest first.

    Changes are weighed by the problem's scale; numbers that came or went with a change of status are left out.
    """
    found = (
        _describe_physics_change(a, b, c) for a, b, c in _list_changed_numbers(before, after) if c.quantity in PHYSICS
    )
    return gather_by_run([r for r in found if r])


def list_changed_work(before: Sequence[RunRecord], after: Sequence[RunRecord]) -> list[RankedChange]:
    """Return one change per run whose steps or evaluations differ, the largest ratio first."""
    out = []
    for a, _, c in _list_changed_numbers(before, after):
        if c.quantity in WORK:
            x, y = c.before, c.value
            ratio = y / x if x > 0.0 else math.inf if y > 0.0 else 1.0
            ratio = ratio if math.isfinite(x) and math.isfinite(y) else math.nan
            weight = abs(math.log(ratio)) if ratio > 0.0 else 99.0
            out.append(
                RankedChange(
                    Rank.WORK,
                    a.settings_id,
                    a.case,
                    WORK[c.quantity],
                    number(x),
                    number(y),
                    format_ratio(ratio),
                    ratio > 1.0,
                    weight,
                )
            )
    return gather_by_run(out)


def list_changed_timings(before: Sequence[RunRecord], after: Sequence[RunRecord]) -> list[RankedChange]:
    """Return a change for each CPU time that differs by more than its spreads and the factor ``SPREAD``."""
    out = []
    for a, b in pair_runs(before, after):
        x, y = a.cpu_median_s, b.cpu_median_s
        (a_low, a_high), (b_low, b_high) = find_cpu_range(a), find_cpu_range(b)
        separate = a_high < b_low or b_high < a_low
        if x > 0.0 and y > 0.0 and separate and max(x / y, y / x) > SPREAD:
            out.append(
                RankedChange(
                    Rank.TIMING,
                    a.settings_id,
                    a.case,
                    "CPU time",
                    f"{number(x)} s",
                    f"{number(y)} s",
                    format_ratio(y / x),
                    y > x,
                    abs(math.log(y / x)),
                )
            )
    return sort_worst_first(out)


def pair_runs(before: Sequence[RunRecord], after: Sequence[RunRecord]) -> list[tuple[RunRecord, RunRecord]]:
    """Return the records before and after of each run that both results have, matched by their settings."""
    there = {r.settings_id: r for r in after}
    return [(r, there[r.settings_id]) for r in before if r.settings_id in there]


def sort_worst_first(found: list[RankedChange]) -> list[RankedChange]:
    """Sort changes by rank, then the largest weight first."""
    return sorted(found, key=lambda r: (r.rank, -r.weight, r.title, r.what))


def gather_by_run(found: list[RankedChange]) -> list[RankedChange]:
    """Return one change per run: its largest, with the others beneath it."""
    by_run = group_by(sort_worst_first(found), lambda r: r.settings_id)
    return [replace(own[0], others=tuple(own[1:])) for own in by_run.values()]


def find_unmeasured(before: Sequence[RunRecord], after: Sequence[RunRecord]) -> tuple[set[str], set[str]]:
    """Return the columns that only the second of two results has, and the columns that only the first has.

    They show that other quantities were measured, not that motions changed.
    """
    both = pair_runs(before, after)
    absent = [{m for m in METRICS if all(math.isnan(float(getattr(p[k], m))) for p in both)} for k in (0, 1)]
    return absent[0] - absent[1], absent[1] - absent[0]


def format_ratio(ratio: float) -> str:
    """Format a ratio: ``2.1 times``; a dash if it is not a positive number."""
    return f"{number(ratio)} times" if math.isfinite(ratio) and ratio > 0.0 else "–"


def _list_changed_numbers(
    before: Sequence[RunRecord], after: Sequence[RunRecord]
) -> list[tuple[RunRecord, RunRecord, Finding]]:
    """Return the changes of numbers beyond rounding, each with the two records."""
    out = []
    unknown = set.union(*find_unmeasured(before, after))
    for a, b in pair_runs(before, after):
        found = compare([a], [b]).changes
        out += [(a, b, c) for c in found if not c.holds and c.quantity not in {"status", *unknown}]
    return out


def _describe_physics_change(a: RunRecord, b: RunRecord, c: Finding) -> RankedChange | None:
    """Return the change ``c`` of a number of the motion from record ``a`` to ``b``, weighed by the problem's scale.

    None is returned for a number that came or went with a change of status. A change across the benchmark's limit on
    the energy error has an infinite weight, so that it comes first.
    """
    words, unit, column = PHYSICS[c.quantity]
    x, y = c.before, c.value
    scale = float(getattr(a, column)) if column else 1.0
    scale = scale if scale > 0.0 and math.isfinite(scale) else 1.0
    # the drift at the end has a sign, which is not compared
    gap = abs(abs(y) - abs(x)) if c.quantity.endswith("_end_J") else abs(y - x)
    weight = gap / scale if math.isfinite(gap) else math.inf
    if a.status != b.status and not math.isfinite(weight):
        return None
    alike = math.isnan(x) or math.isnan(y) or gap <= SAME * max(abs(x), abs(y))
    worse = None if alike else y < x if DECLARED[c.quantity].better == "more" else abs(y) > abs(x)
    share = f"{number(100.0 * weight)} %" if weight >= LITTLE else f"less than {100.0 * LITTLE:g} %"
    size = f"{share} of the problem's scale" if math.isfinite(weight) else "came or went"
    limit = a.energy_allowed_J
    if c.quantity == "energy_drift_max_J" and (x > limit) != (y > limit) and limit > 0.0:
        weight, size = math.inf, f"crosses the benchmark's limit of {number(limit)} J"
    shown, now = (f"{v} {unit}".strip() for v in format_distinguishably(x, y))
    return RankedChange(Rank.PHYSICS, a.settings_id, a.case, words, shown, now, size, worse, weight)


def format_distinguishably(x: float, y: float) -> tuple[str, str]:
    """Format two numbers with as many digits as it takes to see that they differ."""
    pairs_of = ((number(x, digits), number(y, digits)) for digits in range(3, 13))
    return next((p for p in pairs_of if p[0] != p[1]), (number(x), number(y)))


def write_compare(a: Path, b: Path, folder: ConfinedPath) -> Path:
    """Write the comparison of the results folders ``a`` and ``b``, ``compare.html`` with its assets, into ``folder``.

    Return the path of the page.
    """
    both = read_results(a), read_results(b)
    copy_assets(folder, ASSETS)
    known = both[1].by_settings
    everyone = (*both[1].runs, *(c for c in both[0].runs if c.record.settings_id not in known))
    site = Site(replace(both[1], runs=everyone), folder)  # solvers of both results get a colour
    write_page(*both, site)
    site.finish()
    return folder.path / "compare.html"


def write_page(a: StoredResults, b: StoredResults, site: Site) -> Page:
    """Add the page that compares two results to the site, and return it."""
    before, after = ([c.record for c in results.runs] for results in (a, b))
    found, parts = compare(before, after), list_changes(a, b)
    unmeasured = find_unmeasured(before, after)
    known = [c for c in found.changes if c.quantity not in set.union(*unmeasured)]
    touched, changed = {c.subject for c in known}, {c.subject for c in known if not c.holds}
    linked = {r.settings_id for rows in parts.values() for r in rows}
    return site.write(
        Page("Comparison", "compare.html", nav=True, order=90),
        "compare.html",
        scripts=["assets/judgement.js"],
        plots=plot_overlays(a, b, parts),
        parts=parts,
        found=found,
        touched=touched,
        changed=changed,
        limited=touched & {r.case for r in (*before, *after) if not is_repeatable(r)},
        unmeasured=[sorted(u) for u in unmeasured],
        inputs=find_differences(read_environment(a.folder), read_environment(b.folder)),
        shown=OVERLAYS,
        names=[r.environment.get("results_folder") or r.folder.name for r in (a, b)],
        both=(a, b),
        beside=(site.folder / "index.html").is_own_file(),
        pages=_find_page_addresses(a, linked, site.folder) | _find_page_addresses(b, linked, site.folder),
    )


def list_changes(a: StoredResults, b: StoredResults) -> dict[Rank, list[RankedChange]]:
    """Return the changes from ``a`` to ``b`` by rank, the most important first; ranks without a change are left out."""
    before, after = ([c.record for c in results.runs] for results in (a, b))
    verdicts = (
        [c for file in (CLAIMS, FIELD_CLAIMS) for c in read_judged(results.folder, file).found or ()]
        for results in (a, b)
    )
    rows = [
        *list_changed_statuses(before, after),
        *list_changed_claims(*verdicts),
        *list_changed_physics(before, after),
        *list_changed_work(before, after),
        *list_changed_timings(before, after),
    ]
    return group_by(rows, lambda r: r.rank)


def plot_overlays(a: StoredResults, b: StoredResults, parts: Mapping[Rank, Sequence[RankedChange]]) -> list[Plot]:
    """Plot the energy error before and after of each run whose status or motion changed, at most ``OVERLAYS`` plots.

    ``parts`` are the changes by rank; the most important come first.
    """
    runs = [results.by_settings for results in (a, b)]
    wanted = dict.fromkeys(r.settings_id for rank in (Rank.ENDING, Rank.PHYSICS) for r in parts.get(rank, ()))
    taken: set[str] = set()
    plots = []
    for settings in wanted:
        drawn = (_make_trace(a, runs[0][settings], "A", dash=1), _make_trace(b, runs[1][settings], "B", dash=0))
        traces = tuple(t for t in drawn if t is not None)
        if traces:
            title = runs[1][settings].record.case
            axes = Axis("time", "s"), Axis("|energy error|", "J", log=True)
            plots.append(Plot(f"energy-{make_slug(title, taken)}", title, "", *axes, traces))
        if len(plots) == OVERLAYS:
            break
    return plots


def _make_trace(results: StoredResults, run: StoredRun, name: str, dash: int) -> Trace | None:
    """Return the energy error of a run over time as a trace, ``name`` before its solver; None if none was stored."""
    series = results.series(run)
    if series is None or "energy_error" not in series:
        return None
    curve = find_maxima(*series.points("energy_error"), run.record.t_end_s)
    end = "failed" if run.has_stopped else "wrong" if run.status == "wrong" else ""
    return (
        Trace(
            f"{name}: {run.record.solver}, {run.status}", curve.t, curve.y, solver=run.record.solver, dash=dash, end=end
        )
        if len(curve)
        else None
    )


def _find_page_addresses(results: StoredResults, settings_ids: set[str], folder: ConfinedPath) -> dict[str, str]:
    """Return by settings_id the address, relative to ``folder``, of each run's page in the report of ``results``.

    Only the runs ``settings_ids`` are looked up. A run without a page is left out: the report may not be written, or
    may be older than the run.
    """
    paths = {c.record.settings_id: ConfinedPath(results.folder) / "report" / address_run(c) for c in results.runs}
    return {
        s: os.path.relpath(paths[s].path, folder.path).replace(os.sep, "/")
        for s in settings_ids & set(paths)
        if paths[s].is_own_file()
    }
