"""The first page: a picture of who stays within which limits, the mechanism; then numbers, and all runs to filter."""

from collections.abc import Sequence
from typing import Any

from ...mechanism.glimpse import glimpse
from ...model.accuracy import energy_kind, measure_for
from ...model.findings import findings
from ...model.heat import heat
from ...model.margin import LEVELS
from ...model.overview import matrix, tally
from ...model.results import Results, Run
from ...model.scores import score, standings, unpredictable
from ...model.tables import COLUMNS
from ...model.variants import broadest, themselves, variant_groups
from ...model.words import mark
from ..base import Page, Site

DIGITS = 6  # of numbers in the table's data file: twice what is shown


def write(results: Results, site: Site) -> Page | None:
    """``index.html``."""
    found, label = standings(results), broadest(results)
    apart = variant_groups(results, label)
    main = {c.record.run_id for p in themselves(results, label) for c in p.runs}
    ordered = sorted(results.runs, key=lambda c: (c.record.label != label, c.record.run_id not in main))
    picture = heat(results)
    seen = picture.extremes() if picture else []
    moving = glimpse(results, [b.run for b in seen], site.looks)
    scripts = [site.bundle("glimpse", moving), "assets/glimpse.js"] if moving else []
    return site.write(
        Page("Overview", "index.html", nav=True, order=0), "overview.html",
        scripts=[*scripts, site.bundle("runs", _table(results, site, ordered)), "assets/overview.js"],
        heat=picture, seen=seen, moving=moving, levels=LEVELS, unpredictable=unpredictable(results),
        findings=findings(results), matrix=matrix(results), standings=found, label=label,
        score=score(results.runs),
        variant_groups=[(v, score(v.runs), tally(results, v)) for v in apart], columns=COLUMNS,
        apart=score(c for v in apart for c in v.runs), loud=ordered,
        problems=list(dict.fromkeys(p.problem for p in results.variants)),
    )  # fmt: skip


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
