"""The list of mechanisms, and a page for each variant: its motion, why it is hard, who follows it, at what cost."""

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from markupsafe import Markup

from ....harness.results.judgements.files import DRIFTS
from ....harness.results.records import judged_own
from ...mechanism.segments import picture_of
from ...mechanism.stage import stage
from ...model.accuracy import judged_until, measure_for
from ...model.catalogue import about_problem, code_of_others, why_hard
from ...model.curves import SPANS_UPPER
from ...model.frontier import of_most_problems
from ...model.heat import Heat, boxes_of, farthest_and_nearest, rank
from ...model.margin import margin
from ...model.motion import Motion, motion_of
from ...model.results import Results, Run, Variant, group_by
from ...model.scores import unpredictable
from ...model.tracking import list_followed
from ...model.variants import broadest, groups_of, mechanisms, themselves, variant_groups
from ...model.words import mark, unit
from ...plots.laws import Drawing, errors, invariants, laws, observables
from ...plots.lines import EVER, lines_of
from ...plots.spec import choose_focus
from ...plots.work import work_chapter
from ..base import Page, Site, read_judged
from ..svg import sketch

MOST_EVENTS = 20  # of one run in the table
ROWS = 100  # of a folded table: the first page's table and the CSV have all
EVER_VARIANT = 12  # runs drawn of a variant: a report has a hundred of them, and each run is a file to read
SPANS_VARIANT = 80  # of time in the curves of a variant: a run has a hundred of them
MINIATURES = 6
PAPER = "ODE-GC"  # the paper's method; what is added to it has a longer label
SMALL = 60  # pictures of a miniature


def extras(runs: Sequence[Run]) -> Iterator[tuple[str, dict[str, str], list[tuple[Run, list[float]]]]]:
    """Observables against the reference, invariants against their start: title, units by name, a row for each run."""
    for title, found in (
        ("Largest distance of observables from the reference", [c.observable_errors for c in runs]),
        ("Largest departure of invariants from their start", [c.invariant_drifts for c in runs]),
    ):
        if any(found):
            units = {n: unit(str(e.get("unit", ""))) for of in found for n, e in of.items()}
            yield title, units, [(c, [_largest(of.get(n)) for n in units]) for c, of in zip(runs, found, strict=True)]


def _largest(found: Any) -> float:
    try:
        return float(found["max"])
    except (KeyError, TypeError, ValueError):
        return math.nan


def events(motions: Iterable[Motion]) -> dict[str, Any]:
    """Events reported during runs, e.g. singular passages: a row each, columns as the solvers named them."""
    heads = list(dict.fromkeys(k for m in motions for e in m.events for k in e))
    rows = [(m.run, [e.get(k) for k in heads]) for m in motions for e in m.events[:MOST_EVENTS]]
    return {"heads": heads, "rows": rows, "left_out": sum(max(len(m.events) - MOST_EVENTS, 0) for m in motions)}


def sketch_of(results: Results, variant: Variant) -> Markup | None:
    """The mechanism at its start with its supports, gravity, axes, and the names of its first and last body."""
    series = next((s for c in variant.runs if c.record.series and (s := results.readable_series(c))), None)
    picture = picture_of(series)
    words = f"{variant.title} at its start, with its supports, the axes and gravity"
    return None if picture is None else sketch(picture, words)


def write(results: Results, site: Site) -> Page | None:
    """``mechanisms.html``, and ``problem-<slug>.html`` of every variant."""
    label = broadest(results)
    plain = {p.title for p in themselves(results, label)}
    for variant in results.variants:  # one problem at a time: its series are large
        _write(results, site, variant, label, SPANS_UPPER if variant.title in plain else SPANS_VARIANT)
    cards = [(p, sketch_of(results, p), farthest_and_nearest(boxes_of(p, label)))
             for p in results.variants if p.title in plain]  # fmt: skip
    return site.write(Page("Mechanisms", "mechanisms.html", nav=True, order=10), "mechanisms.html", cards=cards,
                      about=about_problem, title=mechanisms(results), unpredictable=unpredictable(results),
                      apart=variant_groups(results, label))  # fmt: skip


def _write(results: Results, site: Site, variant: Variant, label: str, spans: int) -> None:
    plain = spans == SPANS_UPPER  # one of the problems themselves
    lines = lines_of(variant, site.url, EVER if plain else EVER_VARIANT)
    read = ((k.run, results.series(k.run, poses=False)) for k in lines)
    motions = {run.record.run_id: motion_of(run, series, spans) for run, series in read}
    boxes = sorted(boxes_of(variant, label), key=lambda b: b.order)
    drawing = Drawing(variant.runs, lines, motions, spans, choose_focus(b.run.record.solver for b in boxes), label)
    made = (work_chapter(variant, site.url), *(make(drawing) for make in (laws, errors, observables, invariants)))
    chapters = [c for c in made if c is not None]
    groups = groups_of(variant, label)
    scene = scene_of(results, site, variant, label) if plain else None
    if scene is not None:
        site.scenes[variant.title] = scene
    where = f"runs.html?problem={results.variants.index(variant)}&label="
    site.write(
        Page(variant.title, site.url(variant), brief=not plain), "problem.html", variant=variant, scene=scene,
        scripts=[f"data/{scene['file']}.js", "assets/stage.js"] if scene else [], chapters=chapters,
        work=next((c for c in chapters if c.plots[0].x.log), None), measure=measure_for(variant.runs),
        first=next((p for c in chapters for p in c.plots if p.name == "energy"), None),
        drifts=[d for d in read_judged(results.folder, DRIFTS).found or () if d.variant == variant.title],
        plots=[p for c in chapters for p in c.plots],
        left_out=len(variant.runs) - len(lines),
        bodies=max((m.bodies for m in motions.values()), default=0), until=judged_until(variant.runs), own=judged_own,
        sentence=farthest_and_nearest(boxes), sketch=sketch_of(results, variant),
        about=about_problem(variant.problem), hard=why_hard(variant.problem), groups=groups, most=ROWS,
        rest={name: f"{where}{results.labels().index(name)}#runs" for name in groups},
        followed=list_followed(variant), extras=list(extras([k.run for k in lines])), events=events(motions.values()),
    )  # fmt: skip
    site.drawn.update((name, variant.slug) for name, m in motions.items() if m.has_steps)


def one_a_problem(picture: Heat | None, label: str) -> list[Variant]:
    """Choose the variant with a wrong run, else with most runs, of each problem of the heat map; most telling first."""

    def telling(variant: Variant) -> tuple[int, int, int]:
        """How many solvers are wrong on it in the plain comparison, and in all; how many runs it has."""
        wrong = [c for c in variant.runs if c.status == "wrong"]
        plain = {c.record.solver for c in wrong if c.record.label == label}
        return len(plain), len({c.record.solver for c in wrong}), len(variant.runs)

    found = group_by(picture.problems if picture else (), lambda p: p.problem)
    best = [max(own, key=telling) for own in found.values()]
    return sorted(best, key=telling, reverse=True)[:MINIATURES]


def roles_of(variant: Variant, label: str, site: Site) -> list[tuple[Run, str]]:
    """An accurate run that costs little, the paper's method, and a false success or, without one, the last in rank.

    The false success is of an implicit method where there is one, which most codes in use are: it is not the worst.
    """
    best_first = [b.run for b in rank(boxes_of(variant, label))]
    cheap, cheapest = "among the cheapest accurate", _cheapest_first(variant, site)
    if not cheapest:
        cheap, cheapest = "far below its limits", best_first
    paper = sorted((c for c in best_first if c.record.paper_label.startswith(PAPER) and c.is_success),
                   key=lambda c: len(c.record.paper_label))  # fmt: skip
    sizes = {c.record.run_id: min(m.part, 1e9) if (m := margin(c)) else 0.0 for c in variant.runs}
    wrong = sorted(
        (c for c in variant.runs if c.status == "wrong"), reverse=True,
        key=lambda c: (site.looks[c.record.solver].family == "implicit", sizes[c.record.run_id], c.record.run_id),
    )  # fmt: skip
    last, end = (wrong, "a false success") if wrong else (best_first[1:][-1:], "nearest to a limit, or beyond")
    out: dict[str, tuple[Run, str]] = {}
    for runs, words in ((cheapest, cheap), (paper, "the paper's"), (last, end)):
        for run in [c for c in runs if c.record.series][:1]:
            out.setdefault(run.record.run_id, (run, words))
    return list(out.values())


def _cheapest_first(variant: Variant, site: Site) -> list[Run]:
    """Successes by their solver's cost at one error, whose ladder may be over another time of the same motion."""

    def start(v: Variant) -> dict[str, Any]:
        return {name: value for name, value in v.runs[0].parameters.items() if name != "t_end"}

    same = {v.title for v in site.results.variants if v.problem == variant.problem and start(v) == start(variant)}
    found = of_most_problems([f for f in site.frontiers if f.variant in same])
    order = [p.run.record.solver for f in sorted(found, key=lambda f: -len(f.places)) for p in f.places]
    sound = [c for c in variant.runs if c.is_success and c.record.solver in order]
    return sorted(sound, key=lambda c: (order.index(c.record.solver), c.record.cpu_median_s))


def scene_of(results: Results, site: Site, variant: Variant, label: str) -> dict[str, Any] | None:
    """A stage in ``data/stage-<slug>.js`` and what the page says beside it; None where no run kept poses."""
    roles, measure = roles_of(variant, label, site), measure_for(variant.runs)
    play = stage(results, roles, measure, site.looks)
    if play is None:
        return None
    site.bundle(f"stage-{variant.slug}", play)
    small = stage(results, roles[:1], measure, site.looks, SMALL)
    return {
        "file": f"stage-{variant.slug}", "title": variant.title, "problem": variant.problem.replace("_", " "),
        "slug": variant.slug, "said": [_describe_role(run, role, site) for run, role in roles],
        "small": small and {**small, "players": [] if small["exact"] else small["players"]},
    }  # fmt: skip


def _describe_role(run: Run, role: str, site: Site) -> dict[str, str]:
    measured, r = mark(run.status), run.record
    return {
        "solver": r.solver, "code": code_of_others(r.solver), "words": role, "step": run.step_words,
        "url": site.url(run), "claimed": r.claimed.replace("_", " "), "measured": measured.word,
        "kind": measured.kind, "why": run.reasons[0] if run.reasons else "",
    }  # fmt: skip
