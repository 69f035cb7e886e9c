"""The page of all runs: one table to filter and sort, whose choice is in the address."""

from collections.abc import Sequence
from typing import Any

from ...model.accuracy import energy_kind, measure_for
from ...model.results import Results, Run
from ...model.variants import broadest, themselves
from ...model.words import mark
from ..base import Page, Site

DIGITS = 6  # of numbers in the table's data file: twice what is shown


def write(results: Results, site: Site) -> Page | None:
    """``runs.html``, which every page of runs leads to; None without a run."""
    if not results.runs:
        return None
    label = broadest(results)
    main = {c.record.run_id for p in themselves(results, label) for c in p.runs}
    ordered = sorted(results.runs, key=lambda c: (c.record.label != label, c.record.run_id not in main))
    scripts = [site.bundle("runs", _table(results, site, ordered)), "assets/runs.js"]
    return site.write(Page("All runs", "runs.html"), "runs.html", scripts=scripts)


def _table(results: Results, site: Site, runs: Sequence[Run]) -> dict[str, Any]:
    """``runs`` as rows of numbers and texts; problems, solvers and labels are stored by their place in a list."""
    titles = [p.title for p in results.variants]
    variants, labels, solvers = ({name: k for k, name in enumerate(names)}
                                 for names in (titles, results.labels(), results.solvers))  # fmt: skip
    measures = [measure_for(p.runs) for p in results.variants]
    rows = []
    for c in runs:
        r, m = c.record, mark(c.status)
        measure = measures[variants[c.variant]]
        rows.append([
            r.run_id, m.kind, f"{m.symbol} {m.word}", solvers[r.solver], variants[c.variant], labels[r.label],
            c.settings(), "" if c.succeeded else " ".join(c.reasons[0].split())[:160],
            *_numbers(c, measure.of(c) if measure else None),
        ])  # fmt: skip
    return {
        "rows": rows,
        "solvers": [[s, site.url(s), site.looks[s].colour] for s in results.solvers],
        "problems": [[p.title, site.url(p)] for p in results.variants],
        "labels": list(results.labels()),
    }


def _numbers(c: Run, error: float | None) -> list[Any]:
    r = c.record
    values = [r.t_reached_s, r.energy_drift_max_J, error, r.phi_max, r.evaluations, r.cpu_median_s]
    return [*(None if v is None or v != v else float(f"{v:.{DIGITS}g}") for v in values), energy_kind(c)]
