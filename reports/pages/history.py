"""The page of results over time and commits."""

import csv
import io
from collections.abc import Sequence

from ...harness.results import store
from ..model.results import Results
from ..model.words import number
from .base import Page, Site
from .svg import sparkline
from .timeline import Line, gather, lines, moments

SHOWN = 60  # runs on the page, those that changed first; the table file has all
HEADS = ("case", "runs", "changed", "ending_first", "ending_last", "energy_drift_max_J_first",
         "energy_drift_max_J_last", "error_m_first", "error_m_last", "cpu_over_first", "gate")  # fmt: skip
ALONE = 12  # where nothing changed, or there are no other results to compare with
TABLE = "data/history.csv"
MOST = 24  # results whose marks are shown in a row, the newest


def write(results: Results, site: Site) -> Page | None:
    """``history.html``."""
    rows, bad = gather(results)
    found, runs = lines(results, rows), moments(rows)
    shared = [line for line in found if len(line.rows) > 1]
    shown = found[: SHOWN if any(line.changed for line in found) else ALONE]
    store.write_text(site.folder / TABLE, table(shared))
    return site.write(
        Page("History", "history.html", nav=True, order=60), "history.html", scripts=["assets/judgement.js"],
        lines=shown, left_out=len(found) - len(shown), shared=len(shared), table=TABLE, new=len(found) - len(shared),
        changed=sum(line.changed for line in found), moments=runs, commits=list(dict.fromkeys(m.commit for m in runs)),
        bad=bad, most=MOST, here=results.folder.resolve().name, spark=spark,
    )  # fmt: skip


def spark(line: Line, what: str) -> dict[str, object]:
    """A line over all results with its first and last value."""
    values = line.errors if what == "error" else line.values(what)
    known = [v for v in values if v == v]
    if not known:
        return {"drawn": "", "first": "", "last": "", "value": ""}
    words = f"{line.case}: from {number(known[0])} to {number(known[-1])} over {len(values)} results"
    drawn = sparkline(values, words) if len(values) > 1 else ""
    return {"drawn": drawn, "first": number(known[0]), "last": number(known[-1]), "value": repr(known[-1])}


def table(found: Sequence[Line]) -> str:
    """Each run that several results hold: first and last status, drift and error, and CPU time over the first's."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(HEADS)
    for line in found:
        numbers = [v[k] for v in (line.values("energy_drift_max_J"), line.errors) for k in (0, -1)]
        ends = [f"{v:.4g}" if v == v else "" for v in (*numbers, line.values("cpu_ratio")[-1])]
        marks = line.marks
        row = [line.case, len(line.rows), "yes" if line.changed else "no", marks[0].word, marks[-1].word, *ends]
        writer.writerow([*row, line.gates[-1].word if line.gates else ""])
    return out.getvalue()
