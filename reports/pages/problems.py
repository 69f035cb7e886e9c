"""A page for each problem as posed: what holds there, all its cells, and its interactive plots."""

from ..model.accuracy import measure_for
from ..model.curves import SPANS_UPPER
from ..model.extras import events, extras, facts_of
from ..model.findings import findings_of
from ..model.motion import motion_of
from ..model.posings import broadest, groups_of, themselves
from ..model.reading import Posing, Run
from ..plots.interactive.group import lines_of
from ..plots.interactive.time import Chapter, Drawing, errors, invariants, laws, observables
from ..plots.interactive.work import work
from .base import Page, Site

ROWS = 100  # of a folded table: the first page's table and the CSV have all
SPANS_VARIANT = 80  # of time in the curves of a variant: a run has a hundred of them


def write(run: Run, site: Site) -> Page | None:
    """``problem-<slug>.html`` of every posing; none of them in the navigation."""
    label = broadest(run)
    plain = {p.title for p in themselves(run, label)}
    for posing in run.posings:  # one problem at a time: its series are large
        _write(run, site, posing, label, SPANS_UPPER if posing.title in plain else SPANS_VARIANT)
    return None


def _write(run: Run, site: Site, posing: Posing, label: str, spans: int) -> None:
    lines = lines_of(posing, site.url)
    motions = {line.cell.record.cell: motion_of(run, line.cell, spans) for line in lines}
    drawing = Drawing(posing, lines, motions, spans)
    groups = groups_of(posing, label)
    made = (work(posing, site.url), *(make(drawing) for make in (laws, errors, observables, invariants)))
    chapters: list[Chapter] = [c for c in made if c is not None]
    page = Page(posing.title, site.url(posing), brief=spans < SPANS_UPPER)
    where = f"index.html?problem={run.posings.index(posing)}&label="
    drifts = [d for d in site.judgement("drift") or [] if isinstance(d, dict) and d.get("posing") == posing.title]
    site.write(
        page, "problem.html", posing=posing, chapters=chapters, measure=measure_for(posing.cells), drifts=drifts,
        plots=[p for c in chapters for p in c.plots], left_out=len(posing.cells) - len(lines),
        facts_of_it=facts_of(posing, max((m.bodies for m in motions.values()), default=0)),
        findings=findings_of(posing, label), groups=groups, most=ROWS,
        rest={name: f"{where}{run.labels().index(name)}#cells" for name in groups},
        extras=extras([line.cell for line in lines]),
        events=events([m for m in motions.values() if m.events]),
    )  # fmt: skip
    site.drawn.update((line.cell.record.cell, posing.slug) for line in lines if motions[line.cell.record.cell].moved)
