"""Show each run: its settings, how it ended, every number with its meaning; and the table of all runs."""

from collections.abc import Sequence
from typing import Any

from ....harness.results.reproduce import write_command
from ...model.accuracy import choose_measure
from ...model.columns import COLUMNS, list_page_columns
from ...model.results import StoredResults, StoredRun
from ...model.variants import find_plain_label, select_variants
from ...model.words import NONE, mark_status, number
from ..base import PLOTTING, Page, Site

RANK = 10  # after the problems, whose data files hold the curves
RECORDED = {"newton": "newton_iterations"}  # counters that are columns under another name
LEFT_OUT = ("label", "settings", "status", "energy_kind")  # shown elsewhere on the page
DIGITS = 6  # digits in the table's data file: twice those shown


def write(results: StoredResults, site: Site) -> Page | None:
    """Add ``runs/<run>.html`` of every run and ``runs.html`` to the site, none in the navigation; None without runs."""
    if not results.runs:
        return None
    meanings = site.write_data("meanings", {c.heading: c.meaning for c in COLUMNS})
    variants = {c.record.run_id: p for p in results.variants for c in p.runs}
    for run in results.runs:
        slug = site.drawn.get(run.record.run_id)
        data = f"plots-problem-{slug}" if slug else ""
        site.write(
            Page(f"{run.record.solver} on {run.variant}", site.url(run)),
            "run.html",
            scripts=[meanings, *([f"data/{data}.js", *PLOTTING] if data else [])],
            run=run,
            variant=variants[run.record.run_id],
            numbers=_list_numbers(run),
            command=write_command(run.record, results.plugins),
            plots_data=data,
        )
    label = find_plain_label(results)
    main = {c.record.run_id for p in select_variants(results, label) for c in p.runs}
    ordered = sorted(results.runs, key=lambda c: (c.record.label != label, c.record.run_id not in main))
    scripts = [site.write_bundle("runs", _tabulate_runs(results, site, ordered)), "assets/runs.js"]
    return site.write(Page("All runs", "runs.html"), "runs.html", scripts=scripts)


def _list_numbers(run: StoredRun) -> list[tuple[str, str]]:
    """List heading and value of every number that this run has, with its limit, if any, in parentheses.

    The solver's counters that are not columns, or differ from them, come last.
    """
    found = ((c, c.text(run)) for c in COLUMNS if c.key not in LEFT_OUT)
    out = [
        (c.heading, f"{text} (limit {limit})" if (limit := c.limit(run)) else text) for c, text in found if text != NONE
    ]
    own = {k: float(v) for k, v in run.record.counts.items()}
    known = {k: getattr(run.record, RECORDED.get(k, k), None) for k in own}
    return out + [(f"counted: {k.replace('_', ' ')}", number(v)) for k, v in own.items() if v != known[k]]


def _tabulate_runs(results: StoredResults, site: Site, runs: Sequence[StoredRun]) -> dict[str, Any]:
    """Return the data of the table of all runs: ``rows``, and the lists that they refer to by index.

    The lists are those of solvers, problems and labels. A row ends with the values of the columns declared for this
    table, None for NaN; ``shows`` names their formats.
    """
    titles = [p.title for p in results.variants]
    variants, labels, solvers = (
        {name: k for k, name in enumerate(names)} for names in (titles, results.labels(), results.solvers)
    )
    columns = [list_page_columns("runs", choose_measure(p.runs)) for p in results.variants]
    rows = []
    for c in runs:
        r, m = c.record, mark_status(c.status)
        values = [k.of(c) for k in columns[variants[c.variant]]]
        rows.append(
            [
                r.run_id,
                m.kind,
                f"{m.symbol} {m.word}",
                solvers[r.solver],
                variants[c.variant],
                labels[r.label],
                c.settings(),
                "" if c.is_success else " ".join(c.reasons[0].split())[:160],
                *(v if isinstance(v, str) else None if v != v else float(f"{v:.{DIGITS}g}") for v in values),
            ]
        )
    return {
        "rows": rows,
        "solvers": [[s, site.url(s), site.looks[s].colour] for s in results.solvers],
        "problems": [[p.title, site.url(p)] for p in results.variants],
        "labels": list(results.labels()),
        "shows": [k.show for k in list_page_columns("runs")],
    }
