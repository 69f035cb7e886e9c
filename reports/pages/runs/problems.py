"""The list of mechanisms, and a page for each variant: its motion, why it is hard, who follows it, at what cost."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from ....harness.results.judgements.files import DRIFTS
from ....harness.results.records import judged_own
from ....harness.results.series import Series
from ...mechanism.segments import flat, mechanism_of, view_of
from ...model.accuracy import Followed, judged_until, list_followed, measure_for
from ...model.catalogue import about_problem, why_hard
from ...model.curves import SPANS_UPPER
from ...model.heat import best_and_worst, boxes_of
from ...model.motion import Motion, motion_of
from ...model.results import Results, Run, Variant
from ...model.scores import Score, score, unpredictable
from ...model.variants import broadest, groups_of, mechanisms, themselves, variant_groups
from ...model.words import NONE, number, plural, time, unit
from ...plots.laws import Drawing, errors, invariants, laws, observables
from ...plots.lines import EVER, lines_of
from ...plots.palette import choose_focus
from ...plots.spec import Chapter
from ...plots.work import work_chapter
from ..base import Page, Site
from ..judged.orders import describe_drift
from ..judgement import read_judged
from ..svg import sketch
from .scenes import scene_of

MOST_EVENTS = 20  # of one run in the table
ROWS = 100  # of a folded table: the first page's table and the CSV have all
SEEN = 0.2  # an axis that is shorter than this part of itself points at the reader
EVER_VARIANT = 12  # runs drawn of a variant: a report has a hundred of them, and each run is a file to read
SPANS_VARIANT = 80  # of time in the curves of a variant: a run has a hundred of them
Table = tuple[tuple[str, ...], tuple[tuple[Run, tuple[tuple[float, str], ...]], ...]]  # heads, and a row for each run


@dataclass(frozen=True)
class Events:
    """Events reported during a run, e.g. singular passages: a row each, columns as the solvers named them."""

    heads: tuple[str, ...]
    rows: tuple[tuple[Run, tuple[str, ...]], ...]
    left_out: int


def extras(runs: Sequence[Run]) -> dict[str, Table]:
    """Observables against the reference, invariants against their start, by title; only tables that have a column."""
    tables = {"Largest distance of observables from the reference": [c.observable_errors for c in runs],
              "Largest departure of invariants from their start": [c.invariant_drifts for c in runs]}  # fmt: skip
    return {title: _extra(runs, found) for title, found in tables.items() if any(found)}


def facts_of(variant: Variant, bodies: int) -> tuple[str, ...]:
    """The facts about the problem at the head of its page."""
    records = [c.record for c in variant.runs]
    out = [variant.section] if variant.section else []
    times = sorted({r.t_end_s for r in records if not math.isnan(r.t_end_s)})
    if times:
        out.append(f"{', '.join(time(t) for t in times)} s simulated")
    if bodies:
        out.append(plural(bodies, "body", "bodies"))
    scale = next((r for r in records if r.energy_scale_J > 0.0), None)
    if scale:
        out.append(f"energy scale {number(scale.energy_scale_J)} J, size {number(scale.length_scale_m)} m")
    own = [r for r in records if r.reference]
    known = max(own, key=lambda r: (r.reference_own_error_m >= 0.0, r.reference_own_error_m), default=None)
    if known is None:
        return (*out, "no exact solution: only energy and constraints are checked")
    until = f" up to {time(known.reference_horizon_s)} s" if math.isfinite(known.reference_horizon_s) else ""
    judged = judged_until(variant.runs)
    there = "" if judged is None else f", {number(judged_own(known))} m up to {time(judged)} s, where errors are judged"
    return (*out, f"reference: {known.reference}, stated error {number(known.reference_own_error_m)} m{until}{there}")


def _extra(runs: Sequence[Run], found: Sequence[Mapping[str, Mapping[str, Any]]]) -> Table:
    units = {n: str(e.get("unit", "")) for of in found for n, e in of.items()}
    rows = tuple((c, tuple(_value(of.get(n)) for n in units)) for c, of in zip(runs, found, strict=True))
    return tuple(f"{n} [{unit(u)}]" if u else n for n, u in units.items()), rows


def _value(found: Mapping[str, Any] | None) -> tuple[float, str]:
    try:
        value = float(found["max"]) if found else math.nan
    except (KeyError, TypeError, ValueError):
        value = math.nan
    return value, number(value) if found else NONE


def events(motions: Sequence[Motion]) -> Events | None:
    """One table of all events of these motions; None when there is none."""
    heads = list(dict.fromkeys(k for m in motions for e in m.events for k in e))
    if not heads:
        return None
    rows = [(m.run, tuple(_print_value(e.get(k)) for k in heads)) for m in motions for e in m.events[:MOST_EVENTS]]
    left_out = sum(max(len(m.events) - MOST_EVENTS, 0) for m in motions)
    return Events(tuple(h.replace("_", " ") for h in heads), tuple(rows), left_out)


def _print_value(value: Any) -> str:
    if isinstance(value, float):
        return number(value)
    return NONE if value is None else str(value)


def sketch_of(title: str, series: Series | None) -> Markup | None:
    """The mechanism at its start with its supports, gravity, axes, and the names of its first and last body."""
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
    return sketch(
        lines, joints, ground, arrows, names, f"{title} at its start, with its supports, the axes and gravity"
    )


@dataclass(frozen=True)
class MechanismCard:
    """A problem in the list."""

    variant: Variant
    sketch: Markup | None
    about: str
    sentence: str
    score: Score


def write(results: Results, site: Site) -> Page | None:
    """``mechanisms.html``, and ``problem-<slug>.html`` of every variant."""
    label = broadest(results)
    plain = {p.title for p in themselves(results, label)}
    for variant in results.variants:  # one problem at a time: its series are large
        _write(results, site, variant, label, SPANS_UPPER if variant.title in plain else SPANS_VARIANT)
    cards = [MechanismCard(p, _draw_mechanism(results, p), about_problem(p.problem), best_and_worst(boxes_of(p, label)),
                           score(p.runs)) for p in results.variants if p.title in plain]  # fmt: skip
    title = mechanisms(results)
    return site.write(Page("Mechanisms", "mechanisms.html", nav=True, order=10), "mechanisms.html", cards=cards,
                      title=title, unpredictable=unpredictable(results),
                      apart=[(v, score(v.runs)) for v in variant_groups(results, label)])  # fmt: skip


def follow_title(variant: Variant, found: Sequence[Followed]) -> str:
    """How many follow the motion to its end, and who leaves it first."""
    if not found:
        return ""
    whole, last = [f for f in found if f.whole], found[-1]
    follow = "follows" if len(whole) == 1 else "follow"
    out = f"{len(whole)} of {plural(len(found), 'solver')} {follow} the motion to {time(float(f'{last.known:.3g}'))} s"
    return out if last.whole else f"{out}; {last.run.record.solver} leaves it at {number(last.until)} s"


def _draw_mechanism(results: Results, variant: Variant) -> Markup | None:
    poses = next((s for c in variant.runs if c.record.series and (s := results.readable_series(c))), None)
    return sketch_of(variant.title, poses)


def _write(results: Results, site: Site, variant: Variant, label: str, spans: int) -> None:
    lines = lines_of(variant, site.url, EVER if spans == SPANS_UPPER else EVER_VARIANT)
    motions = {
        line.run.record.run_id: motion_of(line.run, results.series(line.run, poses=False), spans) for line in lines
    }
    boxes = sorted(boxes_of(variant, label), key=lambda b: b.order)
    colours = choose_focus(b.run.record.solver for b in boxes)
    drawing = Drawing(variant.runs, lines, motions, spans, colours, label)
    groups = groups_of(variant, label)
    plain = spans == SPANS_UPPER  # the scene is of the problems themselves
    scene = scene_of(results, site, variant, label) if plain else None
    if scene is not None:
        site.scenes[variant.title] = scene
    made = (work_chapter(variant, site.url), *(make(drawing) for make in (laws, errors, observables, invariants)))
    chapters: list[Chapter] = [c for c in made if c is not None]
    first = next((p for c in chapters for p in c.plots if p.name == "energy"), None)
    page = Page(variant.title, site.url(variant), brief=spans < SPANS_UPPER)
    where = f"runs.html?problem={results.variants.index(variant)}&label="
    follow = list_followed(variant)
    drifts = [d for d in read_judged(results.folder, DRIFTS).found or () if d.variant == variant.title]
    site.write(
        page, "problem.html", variant=variant, scene=scene, work=next((c for c in chapters if c.plots[0].x.log), None),
        scripts=[f"data/{scene['file']}.js", "assets/stage.js"] if scene else [],
        follow_title=follow_title(variant, follow), chapters=chapters, measure=measure_for(variant.runs),
        drifts=drifts, describe_drift=describe_drift,
        plots=[p for c in chapters for p in c.plots], left_out=len(variant.runs) - len(lines),
        facts_of_it=facts_of(variant, max((m.bodies for m in motions.values()), default=0)),
        sentence=best_and_worst(boxes_of(variant, label)), first=first, sketch=_draw_mechanism(results, variant),
        about=about_problem(variant.problem), hard=why_hard(variant.problem), groups=groups, most=ROWS,
        rest={name: f"{where}{results.labels().index(name)}#runs" for name in groups},
        followed=follow,
        extras=extras([line.run for line in lines]),
        events=events([m for m in motions.values() if m.events]),
    )  # fmt: skip
    site.drawn.update((line.run.record.run_id, variant.slug) for line in lines if motions[line.run.record.run_id].moved)
