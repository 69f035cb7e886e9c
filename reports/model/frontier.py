"""The cheapest solver for an error: from runs at several steps or tolerances, between which work is interpolated."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from .accuracy import Measure, measure_for
from .catalogue import is_engine
from .results import Results, Run, Variant, group_by
from .variants import presentation

TARGETS = tuple(10.0**-k for k in range(1, 12))  # in the unit of the problem's error
SOUND = ("success", "inaccurate")
LEAST = 2  # solvers that reach a target: fewer are no comparison


@dataclass(frozen=True)
class Place:
    """The cost of an error for a solver with its best settings, and over that of the cheapest solver."""

    run: Run
    cpu_s: float
    bound: bool  # at most: that of a run that reaches it, not one between two runs
    factor: float = 1.0

    @property
    def spread(self) -> float:
        """Largest CPU time of the run's repeats over the least."""
        r = self.run.record
        return r.cpu_max_s / r.cpu_min_s if r.cpu_min_s > 0.0 else math.nan


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

    @property
    def next_factor(self) -> float:
        """CPU of the second over that of the first."""
        return self.places[1].factor

    @property
    def is_led_by_engine(self) -> bool:
        """Whether the cheapest is other people's code."""
        return is_engine(self.places[0].run.record.solver)


def frontiers(results: Results) -> list[Frontier]:
    """Frontiers of every variant with a reference at targets that two solvers reach; presentations are left out."""
    out = []
    for variant in results.variants:
        measure = measure_for(variant.runs)
        if measure is None or presentation(variant):
            continue
        for target in TARGETS:
            found = _frontier(variant, measure, target)
            if len(found.places) >= LEAST:
                out.append(found)
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
    by_solver = group_by(variant.runs, lambda c: c.record.solver)
    best, missed, refused = list[Place](), list[str](), list[Run]()
    for solver, own in by_solver.items():
        reaches = [r for same in group_by(own, lambda c: c.method).values() if (r := reach(same, measure, target))]
        if reaches:
            best.append(min(reaches, key=lambda r: r.cpu_s))
        elif all(c.status == "refused" for c in own):
            refused.append(own[0])
        elif not any(c.unfinished for c in own):
            missed.append(solver)
    best.sort(key=lambda r: r.cpu_s)
    places = tuple(replace(r, factor=r.cpu_s / best[0].cpu_s) for r in best)
    return Frontier(variant.title, measure.what, measure.unit, target, places, tuple(missed), tuple(refused))


def reach(runs: Sequence[Run], measure: Measure, target: float) -> Place | None:
    """Least CPU of one method's runs for ``target``."""
    timed = [c for c in runs if c.record.status in SOUND and c.record.cpu_median_s > 0.0]
    coarse_first = sorted(timed, key=lambda c: -c.step_or_tolerance)
    found = least([(measure.of(c), c.record.cpu_median_s) for c in coarse_first], target)
    return Place(coarse_first[found[2]], found[0], bound=found[1]) if found else None


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
