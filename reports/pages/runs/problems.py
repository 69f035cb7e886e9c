"""List the mechanisms, and show each variant: its motion, its difficulty, which solvers follow it and at what cost."""

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from markupsafe import Markup

from ....harness.columns.declared.errors import find_judged_reference_error
from ...mechanism.segments import draw_picture
from ...mechanism.stage import make_stage
from ...model.accuracy import choose_measure, find_judged_end
from ...model.catalogue import describe_mechanism, explain_difficulty, name_external_code
from ...model.curves import SPANS_UPPER
from ...model.frontier import select_at_shared_target
from ...model.heat import HeatMap, describe_extremes, make_cells, sort_cells
from ...model.margin import find_margin
from ...model.motion import MotionCurves, read_curves
from ...model.results import StoredResults, StoredRun, Variant, group_by
from ...model.scores import name_unpredictable
from ...model.tracking import list_tracking_times
from ...model.variants import find_plain_label, format_problem_counts, group_by_label, group_variants, select_variants
from ...model.words import mark_status, unit
from ...plots.laws import Drawing, plot_declared, plot_errors, plot_invariants, plot_laws, plot_observables
from ...plots.lines import EVER, choose_lines
from ...plots.spec import choose_focus
from ...plots.work import make_work_chapter
from ..base import Page, Site
from ..svg import draw_sketch

MOST_EVENTS = 20  # most events of one run in the table
ROWS = 100  # most rows of a folded table; the table of all runs and the CSV have all
EVER_VARIANT = 12  # runs drawn of a variant: a report has a hundred variants, and each run is a file to read
SPANS_VARIANT = 80  # spans of time in a variant's curves: a report has a hundred variants
MINIATURES = 6
PAPER = "ODE-GC"  # the paper's method; its extensions have longer labels
SMALL = 60  # frames of a miniature


def tabulate_extras(
    runs: Sequence[StoredRun],
) -> Iterator[tuple[str, dict[str, str], list[tuple[StoredRun, list[float]]]]]:
    """Yield a table of observables against the reference and one of invariants against their start.

    A table has a title, units by name and a row of numbers per run, NaN where a run lacks one; it is left out if no run
    has any.
    """
    for title, found in (
        ("Largest distance of observables from the reference", [c.record.observables for c in runs]),
        ("Largest departure of invariants from their start", [c.record.invariants for c in runs]),
    ):
        if any(found):
            units = {n: unit(e.unit) for own in found for n, e in own.items()}
            rows = ([own[n].max if n in own else math.nan for n in units] for own in found)
            yield title, units, list(zip(runs, rows, strict=True))


def tabulate_events(motions: Iterable[MotionCurves]) -> dict[str, Any]:
    """Tabulate the events that solvers reported, e.g. singular passages, in columns named as the solvers name them.

    The dict holds the column heads, at most ``MOST_EVENTS`` rows per run, and the number of events left out.
    """
    heads = list(dict.fromkeys(k for m in motions for e in m.events for k in e))
    rows = [(m.run, [e.get(k) for k in heads]) for m in motions for e in m.events[:MOST_EVENTS]]
    return {"heads": heads, "rows": rows, "left_out": sum(max(len(m.events) - MOST_EVENTS, 0) for m in motions)}


def draw_start(results: StoredResults, variant: Variant) -> Markup | None:
    """Draw the mechanism at its start with supports, gravity, axes, and names; None if no run stored poses."""
    series = next((s for c in variant.runs if c.record.series and (s := results.readable_series(c))), None)
    picture = draw_picture(series)
    words = f"{variant.title} at its start, with its supports, the axes and gravity"
    return None if picture is None else draw_sketch(picture, words)


def write(results: StoredResults, site: Site) -> Page | None:
    """Add ``mechanisms.html`` to the site and return it."""
    label = find_plain_label(results)
    plain = {p.title for p in select_variants(results, label)}
    sketches = site.parts.get(__name__, {})
    cards = [
        (p, sketches[p.slug], describe_extremes(make_cells(p, label))) for p in results.variants if p.title in plain
    ]
    return site.write(
        Page("Mechanisms", "mechanisms.html", nav=True, order=10),
        "mechanisms.html",
        cards=cards,
        about=describe_mechanism,
        title=format_problem_counts(results),
        unpredictable=name_unpredictable(results),
        apart=group_variants(results, label),
    )


def write_variant(results: StoredResults, site: Site, variant: Variant) -> Markup | None:
    """Add ``problem-<slug>.html`` of one variant to the site, with its animation; return the drawing of its start.

    The animation's data and the runs with curves are kept in the site for other pages. A variant outside the plain
    comparison has no animation, and fewer and coarser curves.
    """
    label = find_plain_label(results)
    plain = any(p.title == variant.title for p in select_variants(results, label))  # at its default presentation
    spans = SPANS_UPPER if plain else SPANS_VARIANT
    lines = choose_lines(variant, site.url, EVER if plain else EVER_VARIANT)
    read = ((k.run, results.series(k.run, poses=False)) for k in lines)
    motions = {run.record.run_id: read_curves(run, series, spans) for run, series in read}
    boxes = sorted(make_cells(variant, label), key=lambda b: b.order)
    drawing = Drawing(variant.runs, lines, motions, spans, choose_focus(b.run.record.solver for b in boxes), label)
    made = (
        make_work_chapter(variant, site.url),
        *(make(drawing) for make in (plot_laws, plot_declared, plot_errors, plot_observables, plot_invariants)),
    )
    chapters = [c for c in made if c is not None]
    groups = group_by_label(variant, label)
    scene = write_stage(results, site, variant, label) if plain else None
    if scene is not None:
        site.scenes[variant.title] = scene
    sketch = draw_start(results, variant)
    where = f"runs.html?problem={results.variants.index(variant)}&label="
    site.write(
        Page(variant.title, site.url(variant), brief=not plain),
        "problem.html",
        variant=variant,
        scene=scene,
        scripts=[f"data/{scene['file']}.js", "assets/stage.js"] if scene else [],
        chapters=chapters,
        work=next((c for c in chapters if c.plots[0].x.log), None),
        measure=choose_measure(variant.runs),
        first=next((p for c in chapters for p in c.plots if p.name == "energy"), None),
        plots=[p for c in chapters for p in c.plots],
        left_out=len(variant.runs) - len(lines),
        bodies=max((m.bodies for m in motions.values()), default=0),
        until=find_judged_end(variant.runs),
        own=find_judged_reference_error,
        sentence=describe_extremes(boxes),
        sketch=sketch,
        about=describe_mechanism(variant.problem),
        hard=explain_difficulty(variant.problem),
        groups=groups,
        most=ROWS,
        rest={name: f"{where}{results.labels().index(name)}#runs" for name in groups},
        followed=list_tracking_times(variant),
        extras=list(tabulate_extras([k.run for k in lines])),
        events=tabulate_events(motions.values()),
    )
    site.drawn.update((name, variant.slug) for name, m in motions.items() if m.has_steps)
    return sketch


def choose_miniatures(picture: HeatMap | None, label: str) -> list[Variant]:
    """Choose for each problem of the heat map the variant with most wrong solvers, then with most runs.

    The first ``MINIATURES`` by the same criteria are returned. Wrong runs under ``label`` count first.
    """

    def count_wrong(variant: Variant) -> tuple[int, int, int]:
        """Return the sort key: wrong solvers in the plain comparison, wrong solvers in all, and runs."""
        wrong = [c for c in variant.runs if c.status == "wrong"]
        plain = {c.record.solver for c in wrong if c.record.label == label}
        return len(plain), len({c.record.solver for c in wrong}), len(variant.runs)

    found = group_by(picture.problems if picture else (), lambda p: p.problem)
    best = [max(own, key=count_wrong) for own in found.values()]
    return sorted(best, key=count_wrong, reverse=True)[:MINIATURES]


def choose_roles(variant: Variant, label: str, site: Site) -> list[tuple[StoredRun, str]]:
    """Choose at most three runs to animate, each with words on its role; only runs with a series are chosen.

    They are an accurate cheap run, one of the paper's method, and a false success or, without one, the run nearest to a
    limit. The false success is of an implicit method if there is one, since most codes in use are implicit, then one
    with default options under ``label``, then the one with the largest violation.
    """
    best_first = [b.run for b in sort_cells(make_cells(variant, label))]
    cheap, cheapest = "among the cheapest accurate", _sort_by_cost(variant, site)
    if not cheapest:
        cheap, cheapest = "far below its limits", best_first
    paper = sorted(
        (c for c in best_first if c.record.paper_label.startswith(PAPER) and c.is_success),
        key=lambda c: len(c.record.paper_label),
    )
    sizes = {c.record.run_id: min(m.ratio, 1e9) if (m := find_margin(c)) else 0.0 for c in variant.runs}
    wrong = sorted(
        (c for c in variant.runs if c.status == "wrong"),
        reverse=True,
        key=lambda c: (
            site.looks[c.record.solver].family == "implicit",
            c.record.label == label and not c.options,
            sizes[c.record.run_id],
            c.record.run_id,
        ),
    )
    last, end = (wrong, "a false success") if wrong else (best_first[1:][-1:], "nearest to a limit, or beyond")
    out: dict[str, tuple[StoredRun, str]] = {}
    for runs, words in ((cheapest, cheap), (paper, "the paper's"), (last, end)):
        for run in [c for c in runs if c.record.series][:1]:
            out.setdefault(run.record.run_id, (run, words))
    return list(out.values())


def _sort_by_cost(variant: Variant, site: Site) -> list[StoredRun]:
    """Return the successes of a variant, sorted by their solver's cost at one error, then by their own CPU time.

    Costs may come from the same motion with another end time; solvers without a cost are left out.
    """

    def select_motion(v: Variant) -> dict[str, Any]:
        """Return the parameters without the end time: variants that agree in them have the same motion."""
        return {name: value for name, value in v.runs[0].parameters.items() if name != "t_end"}

    same = {
        v.title
        for v in site.results.variants
        if v.problem == variant.problem and select_motion(v) == select_motion(variant)
    }
    found = select_at_shared_target([f for f in site.frontiers if f.variant in same])
    order = [p.run.record.solver for f in sorted(found, key=lambda f: -len(f.places)) for p in f.places]
    sound = [c for c in variant.runs if c.is_success and c.record.solver in order]
    return sorted(sound, key=lambda c: (order.index(c.record.solver), c.record.cpu_median_s))


def write_stage(results: StoredResults, site: Site, variant: Variant, label: str) -> dict[str, Any] | None:
    """Write the animation's data, ``data/stage-<slug>.js``, and return what is shown beside it; None without poses."""
    roles, measure = choose_roles(variant, label, site), choose_measure(variant.runs)
    play = make_stage(results, roles, measure, site.looks)
    if play is None:
        return None
    site.write_bundle(f"stage-{variant.slug}", play)
    small = make_stage(results, roles[:1], measure, site.looks, SMALL)
    return {
        "file": f"stage-{variant.slug}",
        "title": variant.title,
        "problem": variant.problem.replace("_", " "),
        "slug": variant.slug,
        "said": [_describe_role(run, role, site) for run, role in roles],
        "small": small and {**small, "players": [] if small["exact"] else small["players"]},
    }


def _describe_role(run: StoredRun, role: str, site: Site) -> dict[str, str]:
    """Return what the page shows beside an animated run: its solver and step, what it claimed and what was measured."""
    measured, r = mark_status(run.status), run.record
    return {
        "solver": r.solver,
        "code": name_external_code(r.solver),
        "words": role,
        "step": run.settings(),
        "url": site.url(run),
        "claimed": r.claimed.replace("_", " "),
        "measured": measured.word,
        "kind": measured.kind,
        "why": run.reasons[0] if run.reasons else "",
    }
