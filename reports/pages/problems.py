"""A page for each variant: what its runs show, all of them, and interactive plots."""

from ...harness.results.judgements import DRIFTS
from ..model.accuracy import measure_for
from ..model.curves import SPANS_UPPER
from ..model.extras import events, extras, facts_of
from ..model.findings import findings_of
from ..model.motion import motion_of
from ..model.results import Results, Variant
from ..model.variants import broadest, groups_of, themselves
from ..plots.laws import Drawing, errors, invariants, laws, observables
from ..plots.lines import lines_of
from ..plots.spec import Chapter
from ..plots.work import work_chapter
from .base import Page, Site
from .drifts import words
from .judgement import judged

ROWS = 100  # of a folded table: the first page's table and the CSV have all
SPANS_VARIANT = 80  # of time in the curves of a variant: a run has a hundred of them


def write(results: Results, site: Site) -> Page | None:
    """``problem-<slug>.html`` of every variant; none of them in the navigation."""
    label = broadest(results)
    plain = {p.title for p in themselves(results, label)}
    for variant in results.variants:  # one problem at a time: its series are large
        _write(results, site, variant, label, SPANS_UPPER if variant.title in plain else SPANS_VARIANT)
    return None


def _write(results: Results, site: Site, variant: Variant, label: str, spans: int) -> None:
    lines = lines_of(variant, site.url)
    motions = {line.run.record.run_id: motion_of(line.run, results.series(line.run), spans) for line in lines}
    drawing = Drawing(variant.runs, lines, motions, spans)
    groups = groups_of(variant, label)
    made = (work_chapter(variant, site.url), *(make(drawing) for make in (laws, errors, observables, invariants)))
    chapters: list[Chapter] = [c for c in made if c is not None]
    page = Page(variant.title, site.url(variant), brief=spans < SPANS_UPPER)
    where = f"index.html?problem={results.variants.index(variant)}&label="
    drifts = [d for d in judged(results.folder, DRIFTS).found or () if d.variant == variant.title]
    site.write(
        page, "problem.html", variant=variant, chapters=chapters, measure=measure_for(variant.runs), drifts=drifts,
        drift_words=words,
        plots=[p for c in chapters for p in c.plots], left_out=len(variant.runs) - len(lines),
        facts_of_it=facts_of(variant, max((m.bodies for m in motions.values()), default=0)),
        findings=findings_of(variant, label), groups=groups, most=ROWS,
        rest={name: f"{where}{results.labels().index(name)}#runs" for name in groups},
        extras=extras([line.run for line in lines]),
        events=events([m for m in motions.values() if m.events]),
    )  # fmt: skip
    site.drawn.update((line.run.record.run_id, variant.slug) for line in lines if motions[line.run.record.run_id].moved)
