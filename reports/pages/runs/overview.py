"""Write the first page: mechanisms in motion, false successes, costs, heat map, numbers, claims and links."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from ....harness.mechanics.types import ACCURATE
from ....harness.results.judgements.files import CLAIMS, PUBLISHED
from ....harness.results.misleading import is_misleading
from ....harness.results.reproduce import write_command
from ...mechanism.stage import project_moment
from ...model.accuracy import ErrorMeasure, choose_measure
from ...model.catalogue import is_engine, name_external_code
from ...model.curves import find_maxima
from ...model.frontier import choose_target, select_broad, tabulate_costs
from ...model.heat import HeatCell, HeatMap
from ...model.margin import LEVELS, describe_excess, find_margin
from ...model.results import StoredResults, StoredRun, Variant, group_by, read_results
from ...model.scores import name_unpredictable
from ...model.tracking import list_tracking_times
from ...model.variants import find_plain_label, format_problem_counts
from ...model.words import number, seconds, time
from ...plots.browser import Steps
from ...plots.spec import LineStyle
from ..base import JUDGE, Page, Site, read_judged_or_published, read_or_explain
from ..judged import cost
from ..judged.claims import ClaimView, count_verdicts, select_claims
from ..svg import draw_snapshot, draw_tracking
from .problems import choose_miniatures

PANELS = 6
STRIP = 60  # spans of time in the energy strip of a cell
RANK = 5  # after the pages of cost, problems and solvers, whose plots, scenes and cards it shows
CARDS = 6
ENGINES = PUBLISHED.path / "engines"  # false successes of engines, shown for results without engines
SENTENCES = 6


def write_variant(results: StoredResults, site: Site, variant: Variant) -> dict[str, dict[str, Steps] | None]:
    """Return the energy error over time of each run of a variant that has a cell of the heat map, by run_id."""
    shown = (b for row in (site.heat_map.rows if site.heat_map else ()) for b in row.boxes if b)
    return {b.run.record.run_id: _draw_energy(results, b.run) for b in shown if b.run.variant == variant.title}


def write(results: StoredResults, site: Site) -> Page | None:
    """Add ``index.html`` to the site and return the page."""
    label, picture = find_plain_label(results), site.heat_map
    found = select_broad(results, site.frontiers)
    races = tabulate_costs(results, found, site.url)
    stages = [site.scenes[p.title] for p in choose_miniatures(picture, label) if p.title in site.scenes]
    on = stages[0] if stages else {}
    same_problem = [k for k, r in enumerate(races) if r["problem"] == on.get("problem")]
    # of these the one with most points is shown first
    first = max(same_problem, key=lambda k: sum(len(s["points"]) for s in races[k]["solvers"].values()), default=0)
    target = choose_target(races[first]) if races else 0
    problems, rows = (picture.problems, picture.rows) if picture else ((), ())
    boxes = [(row.solver, p, b) for row in rows for p, b in zip(problems, row.boxes, strict=True) if b]
    strips = {run: strip for found in site.parts.get(__name__, {}).values() for run, strip in found.items()}
    cells = {
        f"{solver} {p.slug}": _describe_cell(results, site, b, choose_measure(p.runs), strips[b.run.record.run_id])
        for solver, p, b in boxes
    }
    tables = [
        (p, [b.run for row in rows if (b := row.boxes[k])], choose_measure(p.runs)) for k, p in enumerate(problems)
    ]
    data = {
        "costs": races,
        "stages": stages,
        "cells": cells,
        "first": first,
        "target": target,
        "colours": {s: k.colour for s, k in site.looks.items()},
    }
    scripts = [
        site.write_bundle("overview", data),
        *(f"data/{s['file']}.js" for s in stages[:1]),
        "assets/stage.js",
        "assets/overview.js",
    ]
    cards, wrong, accused = list_false_successes(results, label)
    # per problem, the variant that most solvers ran
    by_problem = group_by(site.work, lambda title: title.partition("[")[0])
    panels = [site.work[titles[0]] for titles in by_problem.values()][:PANELS]
    return site.write(
        Page("Overview", "index.html", nav=True, order=0),
        "overview.html",
        plots=panels,
        scripts=scripts,
        heat=picture,
        tables=tables,
        levels=LEVELS,
        label=label,
        unpredictable=name_unpredictable(results),
        races=races,
        first=first,
        target=target,
        stages=stages,
        panels_title=cost.state_cheapest(found),
        cards=cards,
        wrong=wrong,
        accused=accused,
        accurate_until=ACCURATE["accurate_until_s"],
        strips=draw_strips(picture, site.looks),
        verdicts=collect_verdicts(results),
        mechanisms=format_problem_counts(results),
        door=max(site.cards.values(), key=lambda c: (len(c["facts"]), c["solver"]), default=None),
    )


def _draw_energy(results: StoredResults, run: StoredRun) -> dict[str, Steps] | None:
    """Return the energy error of a run over time, in few points; None without a series of it."""
    r = run.record
    series = results.series(run, poses=False) if r.series else None
    if series is None or "energy_error" not in series or not len(series["t"]):
        return None
    curve = find_maxima(*series.points("energy_error"), r.t_end_s, STRIP)
    return {"t": Steps(curve.t), "y": Steps(curve.y, log=True)}


def _describe_cell(
    results: StoredResults, site: Site, b: HeatCell, measure: ErrorMeasure | None, strip: dict[str, Steps] | None
) -> dict[str, Any]:
    """Return the data of one cell of the heat map: words, address, command, energy error over time, and facts."""
    r = b.run.record
    error = f"{number(measure.of(b.run))} {measure.unit}" if measure else "no reference"
    facts = (
        ("CPU", seconds(r.cpu_median_s)),
        (measure.what if measure else "error", error),
        ("energy error", f"{number(r.energy_drift_max_J)} J"),
        ("steps", str(r.steps)),
    )
    return {
        "words": b.words,
        "url": site.url(b.run),
        "kind": b.mark.kind,
        "command": write_command(r, results.plugins),
        "strip": strip,
        "facts": facts,
    }


def list_false_successes(results: StoredResults, label: str) -> tuple[list[dict[str, Any]], int, int]:
    """Return cards of false successes, the number of wrong runs, and the number of solvers that could have a card.

    A card shows the largest violation of a solver, among its wrong runs under ``label`` if there are any, and of these
    among those with default options if there are any. External code comes first; at most ``CARDS`` are returned. A run
    that is wrong by rates alone and right by comparison misleads nobody and has no card. If these results have no
    engine, published false successes of engines have cards, too, but do not count as wrong runs.
    """
    wrong = [c for c in results.runs if c.status == "wrong"]
    engines = any(is_engine(s) for s in results.solvers)
    published = () if engines else read_results(ENGINES).runs  # runs of engines that these results lack

    def key(c: StoredRun) -> tuple[bool, bool, bool, float, str]:
        """Return the sort key: external code first, then the plain comparison, default options, large violations."""
        m = find_margin(c)
        size = m.ratio if m and math.isfinite(m.ratio) else 0.0
        return not name_external_code(c.record.solver), c.record.label != label, bool(c.options), -size, c.record.run_id

    shown = [c for c in (*wrong, *published) if is_misleading(c.record, c.record.reasons)]
    worst = [min(own, key=key) for own in group_by(shown, lambda c: c.record.solver).values()]
    return [_make_card(results, c, c in published) for c in sorted(worst, key=key)[:CARDS]], len(wrong), len(worst)


def _make_card(results: StoredResults, run: StoredRun, published: bool) -> dict[str, Any]:
    """Return the seven entries of the card of a false success, as the template reads them.

    These are the run, the name of its external code (empty for a solver of the project), whether it is a ``published``
    run of an engine, its picture over the exact motion, a sentence on the limit that it exceeds, the time [s] of the
    picture, and the command that repeats it. The time is the least of those to which the run came, its reference is
    known, and the run was judged. The picture is None for published runs and for runs without stored poses.
    """
    m, r = find_margin(run), run.record
    reason = m.error if m else r.reasons[0]
    drawn_at = min(t for t in (r.t_reached_s, r.reference_horizon_s, r.judged_to_s) if t > 0.0)  # others: not known
    seen = project_moment(results, run, drawn_at) if r.series and not published else None
    words = f"{r.solver} on {run.variant} at {time(drawn_at)} s, over the exact motion"
    return {
        "run": run,
        "code": name_external_code(r.solver).partition(" on ")[0],  # of "SUNDIALS CVODE on Eq. (65)" the package
        "published": published,
        "picture": draw_snapshot(*seen, words) if seen else None,
        "broken": describe_excess(reason),
        "drawn_at": drawn_at,
        "command": write_command(r, results.plugins),
    }


def draw_strips(picture: HeatMap | None, looks: Mapping[str, LineStyle]) -> list[dict[str, Any]]:
    """Draw for each problem with a reference a strip that shows how long each solver tracks the exact motion.

    A strip has a dot for each solver that does not track it to its end, and the number of those that do.
    """
    out = []
    for variant in picture.problems if picture else ():
        own = list_tracking_times(variant)
        known = max((f.known for f in own), default=0.0)
        if known > 0.0:
            whole = sum(f.whole for f in own)
            dots = [
                (
                    f.until / known,
                    looks[f.run.record.solver].colour,
                    f"{f.run.record.solver}: {f.words}",
                    f.run.record.solver,
                )
                for f in own
                if not f.whole
            ]
            words = f"{variant.title}: {whole} of {len(own)} to {time(float(f'{known:.3g}'))} s"
            out.append(
                {
                    "variant": variant,
                    "whole": whole,
                    "count": len(own),
                    "known": known,
                    "picture": draw_tracking(dots, whole, words),
                }
            )
    return out


def collect_verdicts(results: StoredResults) -> dict[str, Any] | None:
    """Return the verdicts on the paper's claims by these results, or else the published ones; None without any."""
    found = read_judged_or_published(results.folder, CLAIMS)
    kept = (
        read_or_explain(PUBLISHED, CLAIMS, f"{JUDGE} --publish").found or ()
    )  # for claims without runs in these results
    shown = [c for c in select_claims(found.found or (), results.by_settings, kept) if not c.presentation]
    if not shown:
        return None
    columns, published = group_by(shown, lambda c: c.section), found.published or any(c.published for c in shown)
    return {
        "counts": {m.word: k for m, k in count_verdicts(shown)},
        "columns": columns,
        "published": published,
        "sentences": choose_sentences(shown),
    }


def choose_sentences(shown: Sequence[ClaimView]) -> list[ClaimView]:
    """Choose at most ``SENTENCES`` claims with verdicts of each kind in turn, in the order of the paper."""
    kinds = {w: [c for c in shown if c.mark.word == w] for w in ("not reproduced", "reproduced", "reproduced if")}
    turns = [c for k in range(SENTENCES) for own in kinds.values() for c in own[k : k + 1]][:SENTENCES]
    return [c for c in shown if c in turns]
