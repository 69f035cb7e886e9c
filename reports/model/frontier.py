"""The cheapest solver for an error: from runs at several steps or tolerances, between which work is interpolated."""

import math
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Literal

from ...harness.results.records import cpu_range
from .accuracy import Measure, measure_for
from .catalogue import is_engine
from .results import Results, Run, Variant, by_solver, group_by, text_of
from .variants import presentation
from .words import claim_success, decade, mark, number, plural, seconds

TARGETS = tuple(10.0**-k for k in range(1, 12))  # in the unit of the problem's error
SOUND = ("success", "inaccurate")
LEAST = 2  # solvers that reach a target: fewer are no comparison
ASKED = "1 mm"
EQUAL = 1.1  # factor below which CPU times are equal: where code lies in memory moves them as far (Mytkowicz 2009)
UNITS = {"m": ((1.0, "m"), (1e-3, "mm"), (1e-6, "µm"), (1e-9, "nm")), "rad": ((1.0, "rad"),)}


Doubt = Literal["", "tie", "spread"]


@dataclass(frozen=True)
class Place:
    """The cost of an error for a solver with its best settings, and over that of the cheapest solver."""

    run: Run
    cpu_s: float
    bound: bool  # at most: that of a run that reaches it, not one between two runs
    factor: float = 1.0

    @property
    def spread(self) -> float:
        """Upper over lower quartile of the CPU times of the run's repeats."""
        low, high = cpu_range(self.run.record)
        return high / low if low > 0.0 else math.nan


@dataclass(frozen=True)
class Frontier:
    """A problem and an error: solvers that reach it, the cheapest first; those tried that do not, and why refused."""

    variant: str
    what: str
    unit: str
    target: float
    places: tuple[Place, ...]
    missed: tuple[str, ...]
    refused: tuple[Run, ...]
    stated: float  # error of the reference, in the unit of the target; NaN if not known

    @property
    def is_below_reference(self) -> bool:
        """Whether the exact motion is known no better than the target: who reaches it is not certain."""
        return self.target < self.stated

    @property
    def is_led_by_engine(self) -> bool:
        """Whether the cheapest is other people's code."""
        return is_engine(self.places[0].run.record.solver)

    @property
    def doubt(self) -> Doubt:
        """Why it is not decided who is the cheapest."""
        return doubt_of(self.places[0].spread, self.places[1].factor)

    @property
    def doubt_words(self) -> str:
        """The same with its numbers; empty where it is decided."""
        best, after = self.places[:2]
        first, second, lead = best.run.record.solver, after.run.record.solver, number(after.factor, 3)
        words = "quartiles" if math.isfinite(best.run.record.cpu_q1_s) else "ends"  # older records have the ends alone
        spread = f"spread by {number(best.spread, 3)} ({words} of {plural(best.run.record.repeats, 'repeat')})"
        match self.doubt:
            case "tie":
                known = f"whose CPU times {spread}" if best.spread > 1.0 else "of which no spread is known"
                return f"a tie: {second} takes {lead} times as long as {first}, {known}"
            case "spread":
                return f"the CPU times of {first} {spread}, more than the {lead} times that {second} takes"
        return ""


def doubt_of(spread: float, lead: float) -> Doubt:
    """Undecided where the cheapest's ``spread`` exceeds its ``lead``; with a lead below ``EQUAL`` it is a tie.

    A single timing has no spread: there a lead below ``EQUAL`` is a tie, too.
    """
    known = spread > 1.0  # not of one timing (1), and not of a median within the clock's grain (NaN)
    if spread > lead or (not known and lead < EQUAL):
        return "tie" if lead < EQUAL else "spread"
    return ""


def frontiers(results: Results) -> list[Frontier]:
    """Frontiers of every variant with a reference at targets that two solvers reach; presentations are left out."""
    out = []
    for variant in results.variants:
        measure = measure_for(variant.runs)
        if measure is not None and not presentation(variant):
            out += [f for target in TARGETS if len((f := _frontier(variant, measure, target)).places) >= LEAST]
    return out


def broad(results: Results, found: Sequence[Frontier]) -> list[Frontier]:
    """Those that at least half of the solvers took part in: a cheapest of two is no cheapest of all."""
    least = 0.5 * len(results.solvers)
    return [f for f in found if len(f.places) + len(f.missed) + len(f.refused) >= least]


def engines_first(found: Sequence[Frontier]) -> list[Frontier]:
    """Variants on which an engine leads at some error, then the others."""
    led = {f.variant for f in found if f.is_led_by_engine}
    return sorted(found, key=lambda f: f.variant not in led)


def of_most_problems(found: Sequence[Frontier]) -> list[Frontier]:
    """Frontiers at the tightest error that half of all solvers on all problems reach; else at the loosest."""
    by_target = {t: [f for f in found if f.target == t] for t in sorted({f.target for f in found})}
    pairs = {f.variant: len(f.places) + len(f.missed) for f in found}
    reached = (own for own in by_target.values() if 2 * sum(len(f.places) for f in own) >= sum(pairs.values()))
    return next(reached, list(by_target.values())[-1] if by_target else [])


def _frontier(variant: Variant, measure: Measure, target: float) -> Frontier:
    best, missed, refused = list[Place](), list[str](), list[Run]()
    for solver, own in by_solver(variant.runs).items():
        reaches = [r for same in group_by(own, lambda c: c.method).values() if (r := reach(same, measure, target))]
        if reaches:
            best.append(min(reaches, key=lambda r: r.cpu_s))
        elif all(c.status == "refused" for c in own):
            refused.append(own[0])
        elif not any(c.is_unfinished for c in own):
            missed.append(solver)
    best.sort(key=lambda r: r.cpu_s)
    places = tuple(replace(r, factor=r.cpu_s / best[0].cpu_s) for r in best)
    return Frontier(variant.title, measure.what, measure.unit, target, places, (*missed,), (*refused,), measure.own)


def reach(runs: Sequence[Run], measure: Measure, target: float) -> Place | None:
    """Least CPU of one method's runs for ``target``."""
    coarse_first = sorted(_pick_timed(runs), key=lambda c: -c.step_or_tolerance)
    found = least([(measure.of(c), c.record.cpu_median_s) for c in coarse_first], target)
    return Place(coarse_first[found[2]], found[0], bound=found[1]) if found else None


def _pick_timed(runs: Sequence[Run]) -> list[Run]:
    return [c for c in runs if c.status in SOUND and c.record.cpu_median_s > 0.0]


def least(ladder: Sequence[tuple[float, float]], target: float) -> tuple[float, bool, int] | None:
    """Least cost of errors and costs, the coarsest first; log-log between the last that misses ``target`` and the next.

    With whether it is a bound, that of a run which reaches it, and the place of the run that reaches it.
    """
    out = [(cost, True, k) for k, (error, cost) in enumerate(ladder) if error <= target]
    for k, ((ea, low), (eb, high)) in enumerate(pairwise(ladder), 1):
        if ea > target >= eb:
            share = math.log(ea / target) / math.log(ea / eb) if eb > 0.0 else 1.0
            out.append((min(high, low * (high / low) ** share), False, k))
    return min(out, key=lambda found: found[:2], default=None)


def length(value: float, unit: str) -> str:
    """``1 mm``, ``610 µm``, ``10⁻⁴ rad``."""
    scale, name = next((u for u in UNITS.get(unit, ((1.0, unit),)) if value >= 0.999 * u[0]), (1.0, unit))
    power = math.isclose(math.log10(value), round(math.log10(value)))
    words = f"{value / scale:.3g}" if scale != 1.0 else decade(value) if power else number(value, 2)
    return f"{words} {name}"


def costs(results: Results, found: Sequence[Frontier], url: Callable[[Run], str]) -> list[dict[str, Any]]:
    """Costs of every problem in ``found``, at the errors that at least two solvers reach."""
    variants = {p.title: p for p in results.variants}
    return [_costs(variants[title], own, url) for title, own in group_by(found, lambda f: f.variant).items()]


def _costs(variant: Variant, found: Sequence[Frontier], url: Callable[[Run], str]) -> dict[str, Any]:
    measure = measure_for(variant.runs)
    unit = found[0].unit
    targets = [f.target for f in found]
    solvers = {}
    for name, runs in sorted(by_solver(variant.runs).items()):
        points = sorted((c.record.cpu_median_s, e) for c in _pick_timed(runs) if measure and (e := measure.of(c)) == e)
        reached = {f.target: p for f in found for p in f.places if p.run.record.solver == name}
        solvers[name] = {
            "cpu": [reached[t].cpu_s if t in reached else None for t in targets],
            "bound": [t in reached and reached[t].bound for t in targets],
            "factor": [reached[t].factor if t in reached else None for t in targets],
            "shown": [seconds(reached[t].cpu_s) if t in reached else "" for t in targets],
            "url": url(next(iter(reached.values())).run if reached else runs[0]),
            "why": _why(runs, min((e for _, e in points), default=None), unit), "points": points,
        }  # fmt: skip
    return {
        "title": variant.title, "slug": variant.slug, "problem": variant.problem.replace("_", " "), "unit": unit,
        "parameters": variant.parameters, "targets": targets, "words": [length(t, unit) for t in targets],
        "command": [advise(variant, t) for t in targets], "solvers": solvers, "answers": [answer(f) for f in found],
    }  # fmt: skip


def answer(f: Frontier) -> str:
    """``rkmk_dop853 needs 9.54 ms of CPU time; 9 of 21 solvers do not get there``."""
    best, missed = f.places[0], len(f.missed) + len(f.refused)
    parts = [f"{best.run.record.solver} needs {'at most ' if best.bound else ''}{seconds(best.cpu_s)} of CPU time"]
    if f.doubt:
        parts.append(f"who is the cheapest is not decided, {f.doubt_words}")
    if missed:
        parts.append(f"{missed} of {len(f.places) + missed} solvers do not get there")
    return "; ".join(parts)


def advise(variant: Variant, target: float) -> str:
    """The command that asks the same on this machine."""
    words = ["mbsbench", "advise", variant.problem]
    for name, value in variant.runs[0].parameters.items():
        words += ["--t-end", text_of(value)] if name == "t_end" else ["--problem-set", f"{name}={text_of(value)}"]
    return shlex.join([*words, "--error", f"{target:.0e}".replace("e-0", "e-")])


def _why(runs: Sequence[Run], best: float | None, unit: str) -> str:
    """Why a solver is not in the race."""
    wrong = sorted((c for c in runs if c.status == "wrong"), key=lambda c: c.finest_first)
    if best is not None:
        return f"best {length(float(f'{best:.1e}'), unit)}" if best > 0.0 else f"best 0 {unit}"
    if wrong:
        words = f"{len(wrong)} of {plural(len(runs), 'run')} {claim_success(len(wrong))}"
        return f"{mark('wrong').symbol} {words}, finest {wrong[0].step_words}"
    return mark(runs[0].status).word


def default_target(problem: dict[str, Any]) -> int:
    """A millimetre where it is compared; else the tightest error that at least half of the solvers reach."""
    if ASKED in problem["words"]:
        return int(problem["words"].index(ASKED))
    costs_by_solver = [s["cpu"] for s in problem["solvers"].values()]
    reached = (sum(cpu is not None for cpu in at_target) for at_target in zip(*costs_by_solver, strict=True))
    enough = [k for k, n in enumerate(reached) if 2 * n >= len(costs_by_solver)]
    return max(enough, default=0)
