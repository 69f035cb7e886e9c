"""Write the page of cost: work against precision, the cheapest solver for an error, growth with size."""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ....harness.results.judgements.files import WORK
from ....harness.results.judgements.runs import WorkPoint, WorkProfile
from ....harness.results.least_cost import fit_growth
from ...model.accuracy import choose_measure
from ...model.frontier import Frontier, select_at_shared_target, select_broad, sort_engines_first
from ...model.motion import count_bodies
from ...model.results import StoredResults, StoredRun, group_by, group_by_solver
from ...model.words import format_decade, join_words, mark_status, number, plural, seconds, time
from ...plots.spec import Axis, Plot, Trace
from ...plots.work import ERRORS, WORKS, list_points, plot_pairs, plot_profile
from ..base import Page, Site, address_run, read_judged

FEW = ("index1", "evaluations", "cpu")  # kinds of work that errors of energy and joints are plotted against
WORKED = (
    "Each solver with the best of the settings that were run. CPU time of the integration alone, on one machine: read "
    "the ratios, not the times."
)
SIZES = 3  # least number of sizes: a slope through two would be no evidence


def write(results: StoredResults, site: Site) -> Page | None:
    """Add ``cost.html`` to the site and return the page; keep the plots of error over CPU time for other pages."""
    work = read_judged(results.folder, WORK)
    best = sort_profiles(work.found.profile if work.found else ())
    default = sort_profiles(work.found.profile_default if work.found else ())
    found = [(f, make_cost_plots(f)) for f in list_fields(results, work.found.points if work.found else ())]
    works = list(dict.fromkeys(p.work for p in best))
    kinds = [(w, *WORKS[w]) for w in WORKS if any(key.endswith(f"-{w}") for _, own in found for key in own)]
    profile_plots = [plot_profile(best, default, w) for w in works]
    cheapest, grown = select_broad(results, site.frontiers), list_growths(results)
    sizes = [plot_growth(problem, grown, site.url) for problem in dict.fromkeys(g.problem for g in grown)]
    site.work = {f["variant"]: own["error-cpu"] for f, own in found if "error-cpu" in own}
    return site.write(
        Page("Cost", "cost.html", nav=True, order=30),
        "cost.html",
        scripts=["assets/judgement.js"],
        plots=[*profile_plots, *(p for _, own in found for p in own.values()), *sizes],
        why=work.why,
        errors=[(k, *e) for k, e in ERRORS.items()],
        works=kinds,
        fields=found,
        profiles={"best of all": best, "default": default},
        profile_plots=profile_plots,
        profile_works=works,
        named=WORKS,
        work_at=find_work,
        title=state_cheapest(cheapest),
        worked=WORKED,
        cheapest=group_by(sort_engines_first(cheapest), lambda f: f.variant),
        grown=grown,
        sizes=sizes,
    )


def state_cheapest(found: Sequence[Frontier]) -> str:
    """State which solver is the cheapest most often, at the error where most problems compare, and the median cost.

    Only problems with a decided cheapest solver count; solvers that lead on equally many are all named.
    """
    if not (own := select_at_shared_target(found)):
        return "What accuracy costs"
    firsts = Counter(f.places[0].run.record.solver for f in own if not f.doubt)
    most = max(firsts.values(), default=0)
    best = sorted(s for s, n in firsts.items() if n == most)
    unit = own[0].unit if len({f.unit for f in own}) == 1 else "m or rad"
    on = plural(len(own), "problem")
    if len({f.variant.partition("[")[0] for f in own}) < len(own):
        on += ", each set of parameters counted"
    factors = sorted(p.factor for f in own for p in f.places)
    median = f"the median of those that get there costs {number(factors[len(factors) // 2], 2)} times the cheapest"
    lead = (
        f"{join_words(best)} {'is' if len(best) == 1 else 'are each'} cheapest on {most} of {on}"
        if best
        else (f"the cheapest is decided on none of {on}")
    )
    open_ = len(own) - sum(firsts.values())
    undecided = f", {open_} not decided" if open_ and best else ""
    return f"At {format_decade(own[0].target)} {unit}, {lead}{undecided}; {median}"


def list_fields(results: StoredResults, judged: Sequence[WorkPoint]) -> list[dict[str, Any]]:
    """Return the fields of the page, the work-precision points of each variant, those with fewest solvers absent first.

    Only the runs of ``judged`` are points, or all if it is empty. ``absent`` lists solvers without a point, and how
    their runs ended.
    """
    known, best = {p.settings_id for p in judged}, {p.settings_id for p in judged if p.best}
    out = []
    for variant in results.variants:
        points = list_points(variant, address_run, best)
        points = [p for p in points if p.run.record.settings_id in known] if known else points
        drawn = {p.solver for p in points if any(p.is_drawable(error, work) for error in ERRORS for work in WORKS)}
        if drawn:
            runs = group_by_solver(variant.runs)
            ends = {
                s: Counter(mark_status(c.status).word for c in runs.get(s, ()))
                for s in results.solvers
                if s not in drawn
            }
            absent = [f"{s} ({', '.join(words) or 'not run'})" for s, words in ends.items()]
            out.append(
                {
                    "variant": variant.title,
                    "slug": variant.slug,
                    "points": points,
                    "absent": absent,
                    "measure": choose_measure(variant.runs),
                }
            )
    return sorted(out, key=lambda f: len(f["absent"]))


def make_cost_plots(f: dict[str, Any]) -> dict[str, Plot]:
    """Return the plots of one field, see ``list_fields``, by their names ``<error>-<work>``.

    Energy and joints are plotted against fewer kinds of work, and for default and best settings only.
    """
    slug, points, measure = f["slug"], f["points"], f["measure"]
    errors = plot_pairs(slug, points, measure, [("error", work) for work in WORKS], folded=True, front=True)
    laws = [(error, work) for error in ("energy", "phi") for work in WORKS if work in FEW]
    return errors | plot_pairs(slug, [p for p in points if p.default or p.best], measure, laws, folded=True)


def sort_profiles(found: Sequence[WorkProfile]) -> list[WorkProfile]:
    """Sort the profiles by kind of work, machine-independent ones first, then by solver."""
    return sorted(found, key=lambda p: (list(WORKS).index(p.work), p.solver))


def find_work(p: WorkProfile, share: float) -> float:
    """Return the work at which a fraction ``share`` of all targets is reached; NaN if it never is."""
    needed = math.ceil(share * p.total)
    return p.target_work[needed - 1] if 0 < needed <= len(p.target_work) else math.nan


@dataclass(frozen=True)
class Growth:
    """The cost per step of one solver's settings on one problem at several sizes, smallest first."""

    problem: str
    method: str
    solver: str
    step: str
    t_end: float  # [s] simulated time: a longer motion has other steps
    bodies: tuple[int, ...]
    cpu_per_step: tuple[float, ...]
    runs: tuple[StoredRun, ...]  # one per size

    @cached_property
    def fit(self) -> tuple[float, float]:
        """The exponent and the logarithm of the factor of the least-squares power law through all sizes."""
        return fit_growth(self.bodies, self.cpu_per_step)

    @property
    def words(self) -> str:
        """The method, step and simulated time in words."""
        return f"{self.method}, {self.step}, {time(self.t_end)} s simulated"


def measure_growths(runs: Sequence[StoredRun], bodies: Mapping[str, int]) -> list[Growth]:
    """Return the cost per step by number of bodies, for each method on each problem run at ``SIZES`` sizes or more.

    ``bodies`` gives the number of bodies by run_id. Only successful runs with a CPU time count; of several runs of the
    same size the median is taken.
    """
    timed = [c for c in runs if c.is_success and c.record.steps > 0 and c.record.cpu_median_s > 0.0]
    sized = [c for c in timed if bodies.get(c.record.run_id, 0) > 0]
    found = group_by(sized, lambda c: (c.record.problem, c.method, c.record.solver, c.step_words, c.record.t_end_s))
    out = []
    for key, own in sorted(found.items()):
        sizes = dict(sorted(group_by(own, lambda c: bodies[c.record.run_id]).items()))
        if len(sizes) >= SIZES:
            cost = [float(np.median([c.record.cpu_median_s / c.record.steps for c in same])) for same in sizes.values()]
            out.append(Growth(*key, tuple(sizes), tuple(cost), tuple(same[0] for same in sizes.values())))
    return out


def list_growths(results: StoredResults) -> list[Growth]:
    """Return how costs grow with the number of bodies in these results; empty if no problem has three sizes."""
    variants = Counter(p.problem for p in results.variants)
    bodies: dict[str, int] = {}
    for variant in results.variants:
        if variants[variant.problem] > 1:  # all its runs have the same bodies, so one series file suffices
            some = next((s for c in variant.runs if c.is_success and (s := results.series(c)) is not None), None)
            bodies |= {c.record.run_id: count_bodies(some) for c in variant.runs} if some is not None else {}
    return measure_growths(results.runs, bodies)


def plot_growth(problem: str, found: Sequence[Growth], url: Callable[[StoredRun], str]) -> Plot:
    """Plot CPU time per step against the number of bodies, for all methods on one problem, with fitted power laws."""
    seen: Counter[str] = Counter()
    traces, own = [], [g for g in found if g.problem == problem]
    for g in own:
        slope, factor = g.fit
        name = f"{g.words}: slope {slope:.2f}"
        ends = np.array([g.bodies[0], g.bodies[-1]], dtype=float)
        fitted = 1e3 * (np.exp(factor) * ends**slope)
        traces.append(Trace(f"{name}, fitted", ends, fitted, solver=g.solver, dash=seen[g.solver]))
        traces.append(
            Trace(
                name,
                np.array(g.bodies),
                1e3 * np.array(g.cpu_per_step),
                solver=g.solver,
                mode="markers",
                urls=[url(c) for c in g.runs],
                words=[f"{c.variant}, {c.record.steps} steps, CPU {seconds(c.record.cpu_median_s)}" for c in g.runs],
            )
        )
        seen[g.solver] += 1
    steepest, flattest = (f(own, key=lambda g: g.fit[0]) for f in (max, min))
    title = f"{problem}: a step of {flattest.solver} grows with the number of bodies to the power {flattest.fit[0]:.2f}"
    if steepest.solver != flattest.solver:
        title += f", one of {steepest.solver} to {steepest.fit[0]:.2f}"
    caption = "Lines are power laws fitted to all sizes; their exponents are in the table: 1 is linear."
    axes = Axis("bodies", "", log=True), Axis("CPU per step", "ms", log=True)
    return Plot(f"growth-{problem}", title, caption, *axes, traces, wide=True)
