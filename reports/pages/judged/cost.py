"""The page of cost: work against precision on every problem, the cheapest solver for an error, growth with size."""

import math
from collections.abc import Sequence

from ....harness.results.judgements.files import WORK
from ....harness.results.judgements.runs import WorkProfile
from ...model.frontier import Frontier, broad, engines_first, of_most_problems
from ...model.growth import growths_of
from ...model.results import Results, group_by
from ...model.words import decade, plural
from ...plots.growth import growth
from ...plots.spec import Plot
from ...plots.work import ERRORS, WORKS, describe_work, profile_plot, work_plots
from ..base import Page, Site
from ..judgement import links_of, read_judged
from .work_points import Field, fields, profiles

FEW = ("index1", "evaluations", "cpu")  # works that energy and joints are drawn over
WORKED = "CPU time of the integration alone, on one machine: read the ratios, not the times."


def write(results: Results, site: Site) -> Page | None:
    """``cost.html``."""
    work = read_judged(results.folder, WORK)
    best = profiles(work.found.profile if work.found else ())
    default = profiles(work.found.profile_default if work.found else ())
    points = work.found.points if work.found else ()
    found = [(f, plots_of(f)) for f in fields(results, points, links_of(results.runs))]
    works = list(dict.fromkeys(p.work for p in best))
    kinds = [(w, *WORKS[w]) for w in WORKS if any(key.endswith(f"-{w}") for _, own in found for key in own)]
    profile_plots = [profile_plot(best, default, w) for w in works]
    cheapest, grown = broad(results, site.frontiers), growths_of(results)
    sizes = [growth(problem, grown, site.url) for problem in dict.fromkeys(g.problem for g in grown)]
    site.work = {f.variant: own["error-cpu"] for f, own in found if "error-cpu" in own}
    return site.write(
        Page("Cost", "cost.html", nav=True, order=30), "cost.html", scripts=["assets/judgement.js"],
        plots=[*profile_plots, *(p for _, own in found for p in own.values()), *sizes], why=work.why,
        errors=[(k, *e) for k, e in ERRORS.items()], works=kinds, fields=found,
        profiles={"best of all": best, "default": default}, profile_plots=profile_plots, profile_works=works,
        named=describe_work, work_at=work_at, title=title(cheapest), worked=WORKED,
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
    return f"At {error}, {best} is cheapest on {firsts.count(best)} of {plural(len(own), 'variant')}"


def plots_of(f: Field) -> dict[str, Plot]:
    """By ``<error>-<work>``; energy and joints over fewer works, and of default and best settings alone."""
    errors = work_plots(f.slug, f.points, [("error", work) for work in WORKS], folded=True, front=True)
    laws = [(error, work) for error in ("energy", "phi") for work in WORKS if work in FEW]
    return errors | work_plots(f.slug, [p for p in f.points if p.default or p.best], laws, folded=True)


def work_at(p: WorkProfile, share: float) -> float:
    """The work at which a share of all targets is reached; NaN if it never is."""
    needed = math.ceil(share * p.total)
    return p.target_work[needed - 1] if 0 < needed <= len(p.target_work) else math.nan
