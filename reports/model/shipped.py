"""Contestants at the settings that their users get and at the best of one tuning budget, problem by problem."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from .accuracy import Measure, measure_for
from .results import Results, Run, Variant, group_by

SHIPPED, TUNED = "as shipped", "tuned"  # labels of their runs
TARGET = 1e-3  # in the unit of the problem's error: what tuning aims at
SOUND = ("success", "inaccurate", "wrong")  # it reached the end


@dataclass(frozen=True)
class Pair:
    """A contestant on a problem; ``best`` is its cheapest run within the target, else its most accurate one."""

    who: str
    shipped: Run | None
    best: Run
    tried: int  # tuned settings


@dataclass(frozen=True)
class Contest:
    """A problem's pairs, the most accurate as shipped first."""

    variant: Variant
    measure: Measure
    pairs: tuple[Pair, ...]

    def error(self, run: Run | None) -> float:
        """Its error; NaN for a run that is missing or did not reach the end."""
        return self.measure.of(run) if run is not None and run.status in SOUND else math.nan

    def reached(self, runs: Sequence[Run | None]) -> tuple[int, int]:
        """How many are within the target, of how many that were run and not refused."""
        made = [run for run in runs if run is not None and run.status != "refused"]
        return sum(self.error(run) <= TARGET for run in made), len(made)


def contests(results: Results) -> list[Contest]:
    """Contests on problems with runs of both labels."""
    out = []
    for variant in results.variants:
        runs = [c for label in (SHIPPED, TUNED) for c in variant.labels().get(label, ())]
        measure = measure_for(runs)
        if measure is None or not variant.labels().get(SHIPPED):
            continue
        contest = Contest(variant, measure, ())
        pairs = [_pair(contest, who, own) for who, own in group_by(runs, contestant).items()]
        order = sorted(pairs, key=lambda p: (_last(contest.error(p.shipped)), _last(contest.error(p.best)), p.who))
        out.append(Contest(variant, measure, tuple(order)))
    return out


def describe_budget(found: Sequence[Contest]) -> str:
    """The budget of every contestant on every problem, read from the runs."""
    tuned = [c.record for contest in found for c in contest.variant.labels().get(TUNED, ())]
    if not tuned:
        return "nothing has been tuned yet"
    tried, limit = _span([p.tried for c in found for p in c.pairs]), _span([r.cpu_limit_s for r in tuned])
    steps, tolerances = ([getattr(r, name) for r in tuned if getattr(r, name) > 0.0] for name in ("dt_s", "rtol"))
    spans = [f"{what} {_span(values)}{unit}" for what, values, unit in
             (("steps of", steps, " s"), ("tolerances of", tolerances, "")) if values]  # fmt: skip
    return f"{tried} settings of each, {' or '.join(spans)}, {limit} s of CPU a run"


def _span(values: Sequence[float]) -> str:
    least, most = min(values), max(values)
    return f"{least:g}" if least == most else f"{least:g} to {most:g}"


def contestant(run: Run) -> str:
    """The solver, with the one of its own that an engine has several of."""
    return " ".join([run.record.solver, *([str(run.options["solver"])] if "solver" in run.options else [])])


def _pair(contest: Contest, who: str, runs: Sequence[Run]) -> Pair:
    shipped = next((c for c in runs if c.record.label == SHIPPED), None)
    within = [c for c in runs if contest.error(c) <= TARGET]
    best = min(within, key=lambda c: c.record.cpu_median_s, default=None)
    return Pair(who, shipped, best or min(runs, key=lambda c: _last(contest.error(c))),
                sum(c.record.label == TUNED for c in runs))  # fmt: skip


def _last(error: float) -> float:
    return math.inf if math.isnan(error) else error
