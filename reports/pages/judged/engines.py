"""The page of engines: error, energy, loop gap and cost as shipped, and at the best settings of one tuning budget."""

import numpy as np

from ...model.results import Results
from ...model.shipped import TARGET, Contest, contests, describe_budget
from ...model.words import decade
from ...plots.spec import Axis, Plot, Trace, end_of
from ..base import Page, Site


def write(results: Results, site: Site) -> Page | None:
    """``engines.html``."""
    found = contests(results)
    if not found:
        return None
    plots = [_plot(c, site) for c in found]
    shipped, tuned = (np.sum([c.reached([getattr(p, which) for p in c.pairs]) for c in found], axis=0)
                      for which in ("shipped", "best"))  # fmt: skip
    within = f"within {decade(TARGET)} m or rad"
    title = f"As shipped, {shipped[0]} of {shipped[1]} come {within}; tuned, {tuned[0]} of {tuned[1]}"
    return site.write(
        Page("Engines", "engines.html", nav=True, order=31), "engines.html", plots=plots, title=title, target=TARGET,
        budget=describe_budget(found),
        hidden=frozenset({"settings", "solver"}),
        contests=list(zip(found, plots, strict=True)),
    )  # fmt: skip


def _plot(contest: Contest, site: Site) -> Plot:
    measure, traces = contest.measure, []
    for pair in contest.pairs:
        runs = [c for c in dict.fromkeys((pair.shipped, pair.best)) if c is not None]
        runs = [c for c in runs if contest.error(c) >= 0.0 and c.record.cpu_median_s > 0.0]
        if not runs:
            continue
        traces.append(Trace(
            pair.who, np.array([c.record.cpu_median_s for c in runs]), np.array([contest.error(c) for c in runs]),
            solver=runs[0].record.solver, mode="lines+markers", ends=[end_of(c.status) for c in runs],
            urls=[site.url(c) for c in runs], words=[f"{pair.who}, {c.record.label}: {c.settings()}" for c in runs],
        ))  # fmt: skip
    shipped = contest.reached([p.shipped for p in contest.pairs])
    tuned = contest.reached([p.best for p in contest.pairs])
    within = f"within {decade(TARGET)} {measure.unit}"
    return Plot(
        f"engines-{contest.variant.slug}", f"{measure.what[0].upper()}{measure.what[1:]} as shipped and tuned",
        "Each line leads from a contestant as shipped to its best settings. Cross: wrong.",
        Axis("CPU time", "s", log=True), Axis(measure.what, measure.unit, log=True), traces,
        finding=f"{contest.variant.title}: {within} as shipped {shipped[0]} of {shipped[1]}, "
        f"tuned {tuned[0]} of {tuned[1]}",
    )  # fmt: skip
