"""The report of a run: one page that opens from disk, its figures as files, its tables for papers."""

import base64
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from harness import store
from reports.chapters import Chapter, chapter
from reports.columns import COLUMNS
from reports.drawing import Written, write
from reports.figures.scaling import scaling, scalings
from reports.findings import findings
from reports.motion import bodies_in, motion_of
from reports.overview import matrix
from reports.palette import looks
from reports.provenance import cautions, facts, packages
from reports.reading import Cell, Run, read_run, slug
from reports.tables import write_tables
from reports.words import mark, time

TEMPLATES = Path(__file__).parent / "templates"
PAGE = 13_000_000  # bytes of figures that a page may hold; the largest ones beyond it are put in as pixels
WORST = {"wrong": 0, "failed": 1, "refused": 2}  # order in the table of failures


def build(run_folder: Path) -> Path:
    """Write ``report/index.html``, ``report/figures/`` and ``report/tables/`` in the run folder; the page's path."""
    run = read_run(Path(run_folder))
    report = Path(run_folder) / "report"
    (report / "figures").mkdir(parents=True, exist_ok=True)
    chapters, scaled = _chapters(run)
    written = [w for c in chapters for s in c.sets for w in s.figures] + scaled
    for w in written:
        store.write_text(report / "figures" / f"{w.drawn.name}.svg", w.svg)
        (report / "figures" / f"{w.drawn.name}.png").write_bytes(w.png)
    write_tables(run, report / "tables")
    index = report / "index.html"
    store.write_text(index, page(run, chapters, scaled))
    return index


def page(run: Run, chapters: list[Chapter], scaled: list[Written]) -> str:
    """The HTML page."""
    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    written = [w for c in chapters for s in c.sets for w in s.figures] + scaled
    failures = sorted(
        (c for c in run.cells if not c.succeeded), key=lambda c: (WORST[mark(c.status).kind], c.posing, c.method)
    )
    return environment.get_template("page.html").render(
        run=run,
        title=run.environment.get("run") or run.folder.name,
        css=Markup((TEMPLATES / "page.css").read_text(encoding="utf-8")),
        script=Markup((TEMPLATES / "sort.js").read_text(encoding="utf-8")),
        facts=facts(run),
        cautions=cautions(run),
        packages=packages(run),
        matrix=matrix(run),
        findings=findings(run),
        failures=failures,
        chapters=chapters,
        scaled=scaled,
        columns=COLUMNS,
        looks=looks(run.solvers),
        pictures=_pictures(written),
        mark=mark,
        time=time,
        sortable=_sortable,
    )


def _chapters(run: Run) -> tuple[list[Chapter], list[Written]]:
    own_looks = looks(run.solvers)
    bodies = {c.record.cell: bodies_in(s) for c in run.cells if (s := run.series(c)) is not None}
    found = scalings(run.cells, bodies)
    sizes = {cell for s in found for cell in s.cells}
    chapters = []
    for posing in run.posings:  # one problem at a time: its series are large
        motions = {c.record.cell: motion_of(run, c) for c in posing.cells}
        brief = all(c.record.cell in sizes for c in posing.cells)  # posed for its size alone: the laws are enough
        chapters.append(chapter(posing, motions, own_looks, brief=brief))
    taken = {p.slug.lower() for p in run.posings}
    problems = dict.fromkeys(s.problem for s in found)
    return chapters, [write(scaling(slug(f"{p}-scaling", taken), p, found, own_looks)) for p in problems]


def _pictures(written: list[Written]) -> dict[str, Markup]:
    """What the page holds for each figure: SVG, or PNG where the page would become too large."""
    size = sum(len(w.inline) for w in written)
    out = {}
    for w in sorted(written, key=lambda w: -len(w.inline)):
        pixels = base64.b64encode(w.png).decode("ascii")
        if size > PAGE and len(pixels) < len(w.inline):
            size -= len(w.inline) - len(pixels)
            out[w.drawn.name] = Markup('<img alt="" src="data:image/png;base64,{}">').format(pixels)
        else:
            out[w.drawn.name] = Markup(w.inline)  # made by us; text from results is escaped in it
    return out


def _sortable(value: float | str, cell: Cell | None = None) -> str:
    """A value as the page's sorting reads it."""
    return value if isinstance(value, str) else "" if value != value else repr(value)
