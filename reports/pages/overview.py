"""The first page: who holds, who drifts, who breaks, and why; the matrix; and all cells, to sort and to filter."""

from typing import Any

from ..model.accuracy import drifts, measure_for
from ..model.columns import COLUMNS
from ..model.findings import findings
from ..model.overview import matrix, tally
from ..model.posings import broadest, of_parts, themselves, variants
from ..model.reading import Cell, Run
from ..model.scores import headline, score, unpredictable, verdicts
from ..model.words import mark
from .base import Page, Site

DIGITS = 6  # of numbers in the table's data file: twice what is shown


def write(run: Run, site: Site) -> Page | None:
    """``index.html``."""
    found, label = verdicts(run), broadest(run)
    apart = variants(run, label)
    main = {c.record.cell for p in themselves(run, label) for c in p.cells}
    page = Page("Overview", "index.html", nav=True, order=0)
    return site.write(
        page, "overview.html", scripts=[site.bundle("cells", _table(run, site, label, main)), "assets/overview.js"],
        findings=findings(run), matrix=matrix(run), verdicts=found, label=label,
        answers=headline(found, label, unpredictable(run)),
        score=score(run.cells), variants=[(v, score(v.cells), tally(run, v)) for v in apart], columns=COLUMNS,
        apart=score(of_parts(apart)), problems=list(dict.fromkeys(p.problem for p in run.posings)),
        loud=sorted(run.cells, key=lambda c: (c.record.label != label, c.record.cell not in main)),
    )  # fmt: skip


def _table(run: Run, site: Site, label: str, main: set[str]) -> dict[str, Any]:
    """All cells as rows of numbers and texts, those of the plain comparison first, then of the same problems.

    Problems, solvers and labels are told by their place in a list.
    """
    posings, labels = {p.title: k for k, p in enumerate(run.posings)}, {name: k for k, name in enumerate(run.labels())}
    solvers = {s: k for k, s in enumerate(run.solvers)}
    measures = [measure_for(p.cells) for p in run.posings]
    rows = []
    for c in sorted(run.cells, key=lambda c: (c.record.label != label, c.record.cell not in main)):
        r, m = c.record, mark(c.status)
        measure = measures[posings[c.posing]]
        rows.append([
            r.cell, m.kind, f"{m.symbol} {m.word}", solvers[r.solver], posings[c.posing], labels[r.label], c.settings(),
            "" if c.succeeded else " ".join(c.reasons[0].split())[:160],
            *_numbers(c, measure.of(c) if measure else None),
        ])  # fmt: skip
    return {
        "rows": rows,
        "solvers": [[s, site.url(s), site.looks[s].colour] for s in run.solvers],
        "problems": [[p.title, site.url(p)] for p in run.posings],
        "labels": list(run.labels()),
    }


def _numbers(c: Cell, error: float | None) -> list[Any]:
    r, wanders = c.record, drifts(c)
    values = [r.t_reached_s, r.energy_drift_max_J, error, r.phi_max, r.evaluations, r.cpu_median_s]
    return [*(None if v is None or v != v else float(f"{v:.{DIGITS}g}") for v in values),
            "" if wanders is None else "drifts" if wanders else "bounded"]  # fmt: skip
