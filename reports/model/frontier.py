"""Find the cheapest solver for an error, interpolating the work of runs between steps or tolerances."""

import math
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from ...harness.results.least_cost import find_least_cost
from ...harness.results.records import find_cpu_range
from .accuracy import ErrorMeasure, choose_measure
from .catalogue import is_engine
from .results import StoredResults, StoredRun, Variant, format_exactly, group_by, group_by_solver
from .variants import describe_presentation
from .words import claim_success, format_decade, mark_status, number, plural, seconds

TARGETS = tuple(10.0**-k for k in range(1, 12))  # errors in the unit of the problem's error
SOUND = ("success", "inaccurate")
LEAST = 2  # solvers that reach a target: fewer are no comparison
ASKED = "1 mm"
EQUAL = 1.1  # CPU times within this factor are equal: memory layout alone changes them as much (Mytkowicz 2009)
UNITS = {"m": ((1.0, "m"), (1e-3, "mm"), (1e-6, "µm"), (1e-9, "nm")), "rad": ((1.0, "rad"),)}


Doubt = Literal["", "tie", "spread"]


@dataclass(frozen=True)
class RankedSolver:
    """A solver's cost for an error at its best settings, and the ratio to the cheapest solver's cost."""

    run: StoredRun
    cpu_s: float
    bound: bool  # an upper bound: the cost of a run that reaches the error, not interpolated
    factor: float = 1.0

    @property
    def spread(self) -> float:
        """The ratio of the upper to the lower quartile of the CPU times of the repeats; NaN for a quartile of 0."""
        low, high = find_cpu_range(self.run.record)
        return high / low if low > 0.0 else math.nan


@dataclass(frozen=True)
class Frontier:
    """The solvers that reach a target error on a problem, the cheapest first, those that miss it, and refusals."""

    variant: str
    what: str  # the kind of error, in words
    unit: str
    target: float  # the error, in that unit
    places: tuple[RankedSolver, ...]  # solvers that reach it, the cheapest first
    missed: tuple[str, ...]  # solvers that do not
    refused: tuple[StoredRun, ...]
    stated: float  # error of the reference, in the unit of the target; NaN if not known

    @property
    def is_below_reference(self) -> bool:
        """True if the target is below the reference's stated error, so that reaching it is not certain."""
        return self.target < self.stated

    @property
    def is_led_by_engine(self) -> bool:
        """True if the cheapest solver is an external engine."""
        return is_engine(self.places[0].run.record.solver)

    @property
    def doubt(self) -> Doubt:
        """The reason why the cheapest solver is undecided: "tie" or "spread"; empty if it is decided."""
        return classify_doubt(self.places[0].spread, self.places[1].factor)

    @property
    def doubt_words(self) -> str:
        """The doubt in words with its numbers; empty if the cheapest is decided."""
        best, after = self.places[:2]
        first, second, lead = best.run.record.solver, after.run.record.solver, number(after.factor, 3)
        words = "quartiles" if math.isfinite(best.run.record.cpu_q1_s) else "ends"  # older records have extremes only
        spread = f"spread by {number(best.spread, 3)} ({words} of {plural(best.run.record.repeats, 'repeat')})"
        match self.doubt:
            case "tie":
                known = f"whose CPU times {spread}" if best.spread > 1.0 else "of which no spread is known"
                return f"a tie: {second} takes {lead} times as long as {first}, {known}"
            case "spread":
                return f"the CPU times of {first} {spread}, more than the {lead} times that {second} takes"
        return ""


def classify_doubt(spread: float, lead: float) -> Doubt:
    """Return "tie" or "spread" if the cheapest solver is undecided, else an empty string.

    It is undecided if the ``spread`` of its CPU times (upper over lower quartile) exceeds its ``lead`` (cost of the
    second over its own); a tie if the lead is below ``EQUAL``. A single timing has no spread: then a lead below
    ``EQUAL`` is a tie, too.
    """
    known = spread > 1.0  # unknown for one timing (1) and for a median below the clock's resolution (NaN)
    if spread > lead or (not known and lead < EQUAL):
        return "tie" if lead < EQUAL else "spread"
    return ""


def find_frontiers(results: StoredResults) -> list[Frontier]:
    """Return a frontier for every variant with a reference and each of ``TARGETS`` that two solvers or more reach.

    Presentations are left out.
    """
    out = []
    for variant in results.variants:
        measure = choose_measure(variant.runs)
        if measure is not None and not describe_presentation(variant):
            out += [f for target in TARGETS if len((f := _rank_solvers(variant, measure, target)).places) >= LEAST]
    return out


def select_broad(results: StoredResults, found: Sequence[Frontier]) -> list[Frontier]:
    """Return the frontiers of problems that at least half of the solvers ran: they rank, miss the error or refused."""
    least = 0.5 * len(results.solvers)
    return [f for f in found if len(f.places) + len(f.missed) + len(f.refused) >= least]


def sort_engines_first(found: Sequence[Frontier]) -> list[Frontier]:
    """Sort the frontiers so that variants on which an external engine is the cheapest at some error come first."""
    led = {f.variant for f in found if f.is_led_by_engine}
    return sorted(found, key=lambda f: f.variant not in led)


def select_at_shared_target(found: Sequence[Frontier]) -> list[Frontier]:
    """Return the frontiers of all problems at one error; empty without any.

    It is the tightest that at least half of all pairs of a solver and a problem reach, else the loosest. Pairs whose
    runs were all refused do not count.
    """
    by_target = {t: [f for f in found if f.target == t] for t in sorted({f.target for f in found})}
    pairs = {f.variant: len(f.places) + len(f.missed) for f in found}
    reached = (own for own in by_target.values() if 2 * sum(len(f.places) for f in own) >= sum(pairs.values()))
    return next(reached, list(by_target.values())[-1] if by_target else [])


def _rank_solvers(variant: Variant, measure: ErrorMeasure, target: float) -> Frontier:
    """Rank the solvers of a variant by their least CPU time for an error of ``target``.

    A solver whose runs were all refused counts as refused; one that did not reach the error misses it, or is left out
    if a run of it is unfinished.
    """
    best, missed, refused = list[RankedSolver](), list[str](), list[StoredRun]()
    for solver, own in group_by_solver(variant.runs).items():
        reaches = [
            r for same in group_by(own, lambda c: c.method).values() if (r := find_least_time(same, measure, target))
        ]
        if reaches:
            best.append(min(reaches, key=lambda r: r.cpu_s))
        elif all(c.status == "refused" for c in own):
            refused.append(own[0])
        elif not any(c.is_unfinished for c in own):
            missed.append(solver)
    best.sort(key=lambda r: r.cpu_s)
    places = tuple(replace(r, factor=r.cpu_s / best[0].cpu_s) for r in best)
    return Frontier(variant.title, measure.what, measure.unit, target, places, (*missed,), (*refused,), measure.own)


def find_least_time(runs: Sequence[StoredRun], measure: ErrorMeasure, target: float) -> RankedSolver | None:
    """Return the least CPU time for an error of ``target`` by the runs of one method; None if no run reaches it.

    The time is interpolated between two runs, or a bound: that of a run which reaches the error.
    """
    coarse_first = sorted(_pick_timed(runs), key=lambda c: -c.step_or_tolerance)
    found = find_least_cost([(measure.of(c), c.record.cpu_median_s) for c in coarse_first], target)
    if not found:
        return None
    cost, is_bound, row = found
    return RankedSolver(coarse_first[row], cost, bound=is_bound)


def _pick_timed(runs: Sequence[StoredRun]) -> list[StoredRun]:
    """Return the runs that reached their end with all laws kept and have a CPU time."""
    return [c for c in runs if c.status in SOUND and c.record.cpu_median_s > 0.0]


def format_length(value: float, unit: str) -> str:
    """Format a length or an angle in ``unit`` (m or rad): ``1 mm``, ``610 µm``, ``10⁻⁴ rad``."""
    scale, name = next((u for u in UNITS.get(unit, ((1.0, unit),)) if value >= 0.999 * u[0]), (1.0, unit))
    power = math.isclose(math.log10(value), round(math.log10(value)))
    words = f"{value / scale:.3g}" if scale != 1.0 else format_decade(value) if power else number(value, 2)
    return f"{words} {name}"


def tabulate_costs(
    results: StoredResults, found: Sequence[Frontier], url: Callable[[StoredRun], str]
) -> list[dict[str, Any]]:
    """Return the page's data on the cost of every problem in ``found``, at errors that at least two solvers reach.

    ``url`` gives the address of a run.
    """
    variants = {p.title: p for p in results.variants}
    return [_tabulate_variant(variants[title], own, url) for title, own in group_by(found, lambda f: f.variant).items()]


def _tabulate_variant(variant: Variant, found: Sequence[Frontier], url: Callable[[StoredRun], str]) -> dict[str, Any]:
    """Return the page's data on one problem: its target errors, and by solver the CPU time at each and all runs."""
    measure = choose_measure(variant.runs)
    unit = found[0].unit
    targets = [f.target for f in found]
    solvers = {}
    for name, runs in sorted(group_by_solver(variant.runs).items()):
        points = sorted((c.record.cpu_median_s, e) for c in _pick_timed(runs) if measure and (e := measure.of(c)) == e)
        reached = {f.target: p for f in found for p in f.places if p.run.record.solver == name}
        solvers[name] = {
            "cpu": [reached[t].cpu_s if t in reached else None for t in targets],
            "bound": [t in reached and reached[t].bound for t in targets],
            "factor": [reached[t].factor if t in reached else None for t in targets],
            "shown": [seconds(reached[t].cpu_s) if t in reached else "" for t in targets],
            "url": url(next(iter(reached.values())).run if reached else runs[0]),
            "why": _explain_missing(runs, min((e for _, e in points), default=None), unit),
            "points": points,
        }
    return {
        "title": variant.title,
        "slug": variant.slug,
        "problem": variant.problem.replace("_", " "),
        "unit": unit,
        "parameters": variant.parameters,
        "targets": targets,
        "words": [format_length(t, unit) for t in targets],
        "command": [suggest_command(variant, t) for t in targets],
        "solvers": solvers,
        "answers": [describe_cheapest(f) for f in found],
    }


def describe_cheapest(f: Frontier) -> str:
    """Describe the cheapest solver: ``rkmk_dop853 needs 9.54 ms of CPU time; 9 of 21 solvers do not get there``."""
    best, missed = f.places[0], len(f.missed) + len(f.refused)
    parts = [f"{best.run.record.solver} needs {'at most ' if best.bound else ''}{seconds(best.cpu_s)} of CPU time"]
    if f.doubt:
        parts.append(f"who is the cheapest is not decided, {f.doubt_words}")
    if missed:
        parts.append(f"{missed} of {len(f.places) + missed} solvers do not get there")
    return "; ".join(parts)


def suggest_command(variant: Variant, target: float) -> str:
    """Return the ``mbsbench advise`` command that finds the cheapest solver for this error on the reader's machine."""
    words = ["mbsbench", "advise", variant.problem]
    for name, value in variant.runs[0].parameters.items():
        words += (
            ["--t-end", format_exactly(value)]
            if name == "t_end"
            else ["--problem-set", f"{name}={format_exactly(value)}"]
        )
    return shlex.join([*words, "--error", f"{target:.0e}".replace("e-0", "e-")])


def _explain_missing(runs: Sequence[StoredRun], best: float | None, unit: str) -> str:
    """Explain why a solver has no cost at the errors asked: by its ``best`` error in ``unit``, else its wrong runs.

    Without either, return the status of its first run in words.
    """
    wrong = sorted((c for c in runs if c.status == "wrong"), key=lambda c: c.finest_first)
    if best is not None:
        return f"best {format_length(float(f'{best:.1e}'), unit)}" if best > 0.0 else f"best 0 {unit}"
    if wrong:
        words = f"{len(wrong)} of {plural(len(runs), 'run')} {claim_success(len(wrong))}"
        return f"{mark_status('wrong').symbol} {words}, finest {wrong[0].step_words}"
    return mark_status(runs[0].status).word


def choose_target(problem: dict[str, Any]) -> int:
    """Return the index of the target error that a page shows first.

    It is that of 1 mm if the problem has it, else of the tightest target that at least half of the solvers reach, else
    0. ``problem`` is an entry of ``tabulate_costs``, with targets sorted from loosest to tightest.
    """
    if ASKED in problem["words"]:
        return int(problem["words"].index(ASKED))
    costs_by_solver = [s["cpu"] for s in problem["solvers"].values()]
    reached = (sum(cpu is not None for cpu in at_target) for at_target in zip(*costs_by_solver, strict=True))
    enough = [k for k, n in enumerate(reached) if 2 * n >= len(costs_by_solver)]
    return max(enough, default=0)
