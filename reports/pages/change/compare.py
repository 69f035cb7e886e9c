"""Two results side by side: what changed, the most important first, and which inputs may be the cause."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from ....harness.places import Place
from ....harness.results.comparison import Likeness, compare, is_repeatable
from ....harness.results.judgements.files import CLAIMS
from ....harness.results.provenance import find_differences, stamp_of
from ...model.motion import upper
from ...model.results import Results, Run, group_by, read_results, slug
from ...plots.spec import Axis, Plot, Trace
from ..base import Page, Site, copy_assets, page_of, read_judged
from . import ranking
from .ranking import Rank, Ranked

OVERLAYS = 24  # runs whose energy errors are drawn over each other, the largest changes first
ASSETS = ("site.css", "site.js", "judgement.css", "judgement.js", "plots.js")  # fmt: skip


def write_compare(a: Path, b: Path, folder: Place) -> Path:
    """Write ``compare.html`` with what it needs into ``folder``; returns its path."""
    both = read_results(a), read_results(b)
    copy_assets(folder, ASSETS)
    known = both[1].by_settings
    everyone = (*both[1].runs, *(c for c in both[0].runs if c.record.settings_id not in known))
    site = Site(replace(both[1], runs=everyone), folder)  # solvers of either run have their colour
    write_page(*both, site)
    site.finish()
    return folder.path / "compare.html"


def write_page(a: Results, b: Results, site: Site) -> Page:
    """The page of the two results."""
    before, after = ([c.record for c in results.runs] for results in (a, b))
    found, parts = compare(before, after), changes(a, b)
    unmeasured = ranking.find_unmeasured(before, after)
    known = [c for c in found.changes if c.metric not in set.union(*unmeasured)]
    touched, changed = {c.case for c in known}, {c.case for c in known if c.likeness is Likeness.CHANGED}
    linked = {r.settings_id for rows in parts.values() for r in rows}
    return site.write(
        Page("Comparison", "compare.html", nav=True, order=90), "compare.html", scripts=["assets/judgement.js"],
        plots=overlays(a, b, parts), parts=parts, found=found, touched=touched, changed=changed,
        limited=touched & {r.case for r in (*before, *after) if not is_repeatable(r)},
        unmeasured=[sorted(u) for u in unmeasured],
        inputs=find_differences(stamp_of(a.folder), stamp_of(b.folder)), shown=OVERLAYS,
        names=[r.environment.get("results_folder") or r.folder.name for r in (a, b)],
        both=(a, b), beside=(site.folder / "index.html").is_own_file(),
        pages=_addresses(a, linked, site.folder) | _addresses(b, linked, site.folder),
    )  # fmt: skip


def changes(a: Results, b: Results) -> dict[Rank, list[Ranked]]:
    """By rank, the most important first; ranks without a change are left out."""
    before, after = ([c.record for c in results.runs] for results in (a, b))
    verdicts = (read_judged(results.folder, CLAIMS).found or () for results in (a, b))
    rows = [*ranking.endings(before, after), *ranking.claims(*verdicts), *ranking.physics(before, after),
            *ranking.work(before, after), *ranking.timings(before, after)]  # fmt: skip
    return group_by(rows, lambda r: r.rank)


def overlays(a: Results, b: Results, parts: Mapping[Rank, Sequence[Ranked]]) -> list[Plot]:
    """The energy errors of both runs, for the runs whose ending or motion changed, the most important first."""
    runs = [results.by_settings for results in (a, b)]
    wanted = dict.fromkeys(r.settings_id for rank in (Rank.ENDING, Rank.PHYSICS) for r in parts.get(rank, ()))
    taken: set[str] = set()
    plots = []
    for settings in wanted:
        drawn = (_trace(a, runs[0][settings], "A", dash=1), _trace(b, runs[1][settings], "B", dash=0))
        traces = tuple(t for t in drawn if t is not None)
        if traces:
            title = runs[1][settings].record.case
            axes = Axis("time", "s"), Axis("|energy error|", "J", log=True)
            plots.append(Plot(f"energy-{slug(title, taken)}", title, "", *axes, traces))
        if len(plots) == OVERLAYS:
            break
    return plots


def _trace(results: Results, run: Run, name: str, dash: int) -> Trace | None:
    series = results.series(run)
    if series is None or "energy_error" not in series:
        return None
    curve = upper(series["t"], series["energy_error"], run.record.t_end_s)
    end = "failed" if run.stopped else "wrong" if run.status == "wrong" else ""
    return Trace(f"{name}: {run.record.solver}, {run.status}", curve.t, curve.y, solver=run.record.solver, dash=dash,
                 end=end) if len(curve) else None  # fmt: skip


def _addresses(results: Results, wanted: set[str], folder: Place) -> dict[str, str]:
    """By settings_id: the pages of runs in their own report, those that were written."""
    paths = {c.record.settings_id: Place(results.folder) / "report" / page_of(c) for c in results.runs}
    return {s: os.path.relpath(paths[s].path, folder.path).replace(os.sep, "/") for s in wanted & set(paths)
            if paths[s].is_own_file()}  # fmt: skip
