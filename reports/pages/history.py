"""The page of results over runs and commits."""

from reports.pages.base import Page, Site
from reports.pages.svg import sparkline
from reports.pages.timeline import Line, gather, lines, moments
from reports.reading import Run
from reports.words import number

MOST = 24  # runs whose marks are shown in a row, the newest


def write(run: Run, site: Site) -> Page | None:
    """``history.html``."""
    rows, bad = gather(run)
    found = lines(run, rows)
    runs = moments(rows)
    return site.write(
        Page("History", "history.html", nav=True, order=60), "history.html", scripts=["assets/judgement.js"],
        lines=found, moments=runs, commits=list(dict.fromkeys(m.commit for m in runs)), bad=bad, most=MOST,
        here=run.folder.resolve().name, spark=spark, problems=sorted({line.problem for line in found}),
        solvers=sorted({line.solver for line in found}),
    )  # fmt: skip


def spark(line: Line, what: str) -> dict[str, object]:
    """A line over the runs with its first and last value."""
    values = line.errors if what == "error" else line.values(what)
    known = [v for v in values if v == v]
    if not known:
        return {"drawn": "", "first": "", "last": "", "value": ""}
    words = f"{line.case}: from {number(known[0])} to {number(known[-1])} over {len(values)} runs"
    drawn = sparkline(values, words) if len(values) > 1 else ""
    return {"drawn": drawn, "first": number(known[0]), "last": number(known[-1]), "value": repr(known[-1])}
