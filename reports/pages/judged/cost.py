"""The page of cost: work against precision on every problem, the cheapest solver for an error, growth with size."""

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

from ....harness.results.judgements.files import WORK
from ....harness.results.judgements.runs import WorkPoint, WorkProfile
from ...model.accuracy import measure_for
from ...model.frontier import Frontier, broad, engines_first, of_most_problems
from ...model.results import Results, by_solver, group_by
from ...model.words import decade, mark, plural
from ...plots.growth import growth, growths_of
from ...plots.spec import Plot
from ...plots.work import ERRORS, WORKS, list_points, profile_plot, work_plots
from ..base import Page, Site, page_of, read_judged

FEW = ("index1", "evaluations", "cpu")  # works that energy and joints are drawn over
WORKED = "CPU time of the integration alone, on one machine: read the ratios, not the times."


def write(results: Results, site: Site) -> Page | None:
    """``cost.html``."""
    work = read_judged(results.folder, WORK)
    best = profiles(work.found.profile if work.found else ())
    default = profiles(work.found.profile_default if work.found else ())
    found = [(f, plots_of(f)) for f in fields(results, work.found.points if work.found else ())]
    works = list(dict.fromkeys(p.work for p in best))
    kinds = [(w, *WORKS[w]) for w in WORKS if any(key.endswith(f"-{w}") for _, own in found for key in own)]
    profile_plots = [profile_plot(best, default, w) for w in works]
    cheapest, grown = broad(results, site.frontiers), growths_of(results)
    sizes = [growth(problem, grown, site.url) for problem in dict.fromkeys(g.problem for g in grown)]
    site.work = {f["variant"]: own["error-cpu"] for f, own in found if "error-cpu" in own}
    return site.write(
        Page("Cost", "cost.html", nav=True, order=30), "cost.html", scripts=["assets/judgement.js"],
        plots=[*profile_plots, *(p for _, own in found for p in own.values()), *sizes], why=work.why,
        errors=[(k, *e) for k, e in ERRORS.items()], works=kinds, fields=found,
        profiles={"best of all": best, "default": default}, profile_plots=profile_plots, profile_works=works,
        named=WORKS, work_at=work_at, title=title(cheapest), worked=WORKED,
        cheapest=group_by(engines_first(cheapest), lambda f: f.variant), grown=grown, sizes=sizes,
    )  # fmt: skip


def title(found: Sequence[Frontier]) -> str:
    """Who is the cheapest most often, at the error where most problems can be compared."""
    own = of_most_problems(found)
    if not own:
        return "What accuracy costs"
    firsts = [f.places[0].run.record.solver for f in own]
    best = max(sorted(set(firsts)), key=firsts.count)
    unit = own[0].unit if len({f.unit for f in own}) == 1 else "m or rad"
    error = f"{decade(own[0].target)} {unit}"
    on = plural(len(own), "problem")
    if len({f.variant.partition("[")[0] for f in own}) < len(own):
        on += ", each set of parameters counted"
    return f"At {error}, {best} is cheapest on {firsts.count(best)} of {on}"


def fields(results: Results, judged: Sequence[WorkPoint]) -> list[dict[str, Any]]:
    """The points of every variant that has one, of the judged runs alone where there are any; most solvers first.

    ``absent`` are solvers without a point, with how their runs ended that no plot can show.
    """
    known, best = {p.settings_id for p in judged}, {p.settings_id for p in judged if p.best}
    out = []
    for variant in results.variants:
        points = list_points(variant, page_of, best)
        points = [p for p in points if p.run.record.settings_id in known] if known else points
        drawn = {p.solver for p in points if any(p.drawable(error, work) for error in ERRORS for work in WORKS)}
        if drawn:
            runs = by_solver(variant.runs)
            ends = {s: Counter(mark(c.status).word for c in runs.get(s, ())) for s in results.solvers if s not in drawn}
            absent = [f"{s} ({', '.join(words) or 'not run'})" for s, words in ends.items()]
            out.append({"variant": variant.title, "slug": variant.slug, "points": points, "absent": absent,
                        "measure": measure_for(variant.runs)})  # fmt: skip
    return sorted(out, key=lambda f: len(f["absent"]))


def plots_of(f: dict[str, Any]) -> dict[str, Plot]:
    """By ``<error>-<work>``; energy and joints over fewer works, and of default and best settings alone."""
    slug, points, measure = f["slug"], f["points"], f["measure"]
    errors = work_plots(slug, points, measure, [("error", work) for work in WORKS], folded=True, front=True)
    laws = [(error, work) for error in ("energy", "phi") for work in WORKS if work in FEW]
    return errors | work_plots(slug, [p for p in points if p.default or p.best], measure, laws, folded=True)


def profiles(found: Sequence[WorkProfile]) -> list[WorkProfile]:
    """As judged, by kind of work, those that no machine changes first, and by solver."""
    return sorted(found, key=lambda p: (list(WORKS).index(p.work), p.solver))


def work_at(p: WorkProfile, share: float) -> float:
    """The work at which a share of all targets is reached; NaN if it never is."""
    needed = math.ceil(share * p.total)
    return p.target_work[needed - 1] if 0 < needed <= len(p.target_work) else math.nan
