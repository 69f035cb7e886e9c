"""A page for each run: what was asked, how it ended, every number with its meaning; and the table of all runs."""

from collections.abc import Sequence
from typing import Any

from ....harness.results.reproduce import write_command
from ...model.accuracy import energy_kind, measure_for
from ...model.results import Results, Run
from ...model.tables import COLUMNS
from ...model.variants import broadest, themselves
from ...model.words import NONE, mark, number
from ..base import PLOTTING, Page, Site

RANK = 10  # after the problems: their pages' data files hold the curves
RECORDED = {"newton": "newton_iterations"}  # counters that are columns under another name
LEFT_OUT = ("label", "settings", "status", "energy_kind")  # said elsewhere on the page
DIGITS = 6  # of numbers in the table's data file: twice what is shown


def write(results: Results, site: Site) -> Page | None:
    """``runs/<run>.html``, none of them in the navigation, and ``runs.html``; None without a run."""
    if not results.runs:
        return None
    meanings = site.data("meanings", {c.heading: c.doc for c in COLUMNS})
    variants = {c.record.run_id: p for p in results.variants for c in p.runs}
    for run in results.runs:
        slug = site.drawn.get(run.record.run_id)
        data = f"plots-problem-{slug}" if slug else ""
        site.write(
            Page(f"{run.record.solver} on {run.variant}", site.url(run)), "run.html",
            scripts=[meanings, *([f"data/{data}.js", *PLOTTING] if data else [])], run=run,
            variant=variants[run.record.run_id], numbers=_list_numbers(run),
            command=write_command(run.record, results.plugins), plots_data=data,
        )  # fmt: skip
    label = broadest(results)
    main = {c.record.run_id for p in themselves(results, label) for c in p.runs}
    ordered = sorted(results.runs, key=lambda c: (c.record.label != label, c.record.run_id not in main))
    scripts = [site.bundle("runs", _table(results, site, ordered)), "assets/runs.js"]
    return site.write(Page("All runs", "runs.html"), "runs.html", scripts=scripts)


def _list_numbers(run: Run) -> list[tuple[str, str]]:
    """Heading and value; only what exists for this run, and what the solver counted beside the columns."""
    out = [(c.heading, text) for c in COLUMNS if c.key not in LEFT_OUT and (text := c.text(run)) != NONE]
    own = {k: float(v) for k, v in run.counters.items() if isinstance(v, int | float)}
    known = {k: getattr(run.record, RECORDED.get(k, k), None) for k in own}
    return out + [(f"counted: {k.replace('_', ' ')}", number(v)) for k, v in own.items() if v != known[k]]


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
        error = measure.of(c) if measure else None
        values = [r.t_reached_s, r.energy_drift_max_J, error, r.phi_max, r.evaluations, r.cpu_median_s]
        rows.append([
            r.run_id, m.kind, f"{m.symbol} {m.word}", solvers[r.solver], variants[c.variant], labels[r.label],
            c.settings(), "" if c.is_success else " ".join(c.reasons[0].split())[:160],
            *(None if v is None or v != v else float(f"{v:.{DIGITS}g}") for v in values), energy_kind(c),
        ])  # fmt: skip
    return {
        "rows": rows,
        "solvers": [[s, site.url(s), site.looks[s].colour] for s in results.solvers],
        "problems": [[p.title, site.url(p)] for p in results.variants],
        "labels": list(results.labels()),
    }
