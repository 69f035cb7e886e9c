"""The list of mechanisms, and a page for each variant: its motion, why it is hard, who follows it, at what cost."""

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from ....harness.results.judgements.files import DRIFTS
from ....harness.results.records import judged_own
from ...mechanism.segments import flat, mechanism_of, view_of
from ...model.accuracy import judged_until, list_followed, measure_for
from ...model.catalogue import about_problem, why_hard
from ...model.heat import best_and_worst, boxes_of
from ...model.motion import SPANS_UPPER, Motion, motion_of
from ...model.results import Results, Run, Variant
from ...model.scores import broadest, groups_of, mechanisms, themselves, unpredictable, variant_groups
from ...model.words import unit
from ...plots.laws import Drawing, errors, invariants, laws, observables
from ...plots.lines import EVER, lines_of
from ...plots.palette import choose_focus
from ...plots.work import work_chapter
from ..base import Page, Site, read_judged
from ..svg import sketch
from .scenes import scene_of

MOST_EVENTS = 20  # of one run in the table
ROWS = 100  # of a folded table: the first page's table and the CSV have all
SEEN = 0.2  # an axis that is shorter than this part of itself points at the reader
EVER_VARIANT = 12  # runs drawn of a variant: a report has a hundred of them, and each run is a file to read
SPANS_VARIANT = 80  # of time in the curves of a variant: a run has a hundred of them


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
    mechanism = mechanism_of(series)
    if mechanism is None or series is None:
        return None
    view = view_of(mechanism)
    arrows = [(name, way) for name, e in zip("XYZ", np.eye(3), strict=True) if np.linalg.norm(way := view @ e) > SEEN]
    g = mechanism.gravity
    if np.any(g):
        arrows.append(("g", view @ (g / np.linalg.norm(g))))
    ends = sorted({0, len(series.body_names) - 1} & set(range(len(series.body_names))))
    names = [(series.body_names[k], view @ mechanism.r[0, k]) for k in ends]
    lines, joints, ground = (flat(p, view) for p in (mechanism.segments(0), mechanism.joints(0), mechanism.ground))
    words = f"{variant.title} at its start, with its supports, the axes and gravity"
    return sketch(lines, joints, ground, arrows, names, words)


def write(results: Results, site: Site) -> Page | None:
    """``mechanisms.html``, and ``problem-<slug>.html`` of every variant."""
    label = broadest(results)
    plain = {p.title for p in themselves(results, label)}
    for variant in results.variants:  # one problem at a time: its series are large
        _write(results, site, variant, label, SPANS_UPPER if variant.title in plain else SPANS_VARIANT)
    cards = [(p, sketch_of(results, p), best_and_worst(boxes_of(p, label)))
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
        sentence=best_and_worst(boxes), sketch=sketch_of(results, variant),
        about=about_problem(variant.problem), hard=why_hard(variant.problem), groups=groups, most=ROWS,
        rest={name: f"{where}{results.labels().index(name)}#runs" for name in groups},
        followed=list_followed(variant), extras=list(extras([k.run for k in lines])), events=events(motions.values()),
    )  # fmt: skip
    site.drawn.update((name, variant.slug) for name, m in motions.items() if m.moved)
