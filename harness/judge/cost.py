"""Judge at what cost: search the setting that meets an error at the least cost, and say how a step's cost grows.

The least cost of an error is found by ``results.least_cost``, which pages call, too.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..catalogue import registry
from ..catalogue.suites.spec import RunSpec, make_spec
from ..mechanics.types import Problem, Status
from ..results.findings import Finding, state_finding
from ..results.least_cost import find_cheapest, fit_growth
from ..results.records import RunRecord
from ..results.words import list_reasons
from ..results.work import count_index_1_evaluations
from .order import measure_slopes

# "Half" and "twice": tried on 97 published ladders, interpolated, whose smooth errors meet each of 389 required ones. A
# search has 1.90 runs, and the cheapest takes 1.32 times the steps of a setting with the required error itself.
# fraction of the required error below which a coarser setting is tried. Half: 1.83 runs, 1.37 times the steps; twice:
# 1.98 runs, 1.29 times.
NEAR = 0.1
# fraction of the required error that is aimed at: errors that are less smooth miss more often nearer 1. Half: 1.87
# runs, 1.48 times the steps; twice: 2.01 runs, 1.16 times.
AIM = 0.4
# range of the ratio of one setting to the next; at half of its ends 1.94 runs, at twice 1.89, with the same steps
SPAN = {"dt": (1.0 / 16.0, 8.0), "rtol": (1e-3, 1e2)}
# steps of the finest setting: more let a low order meet its error at any price, fewer give up on it
MOST_STEPS = 2_000_000
# below the first, roundings decide about steps; above the second, a tolerance is no accuracy any more
TIGHTEST, LOOSEST = 1e-13, 1e-2
CLOCK = 1e-3  # [s] shorter times count as equal
LINEAR = 1.5  # exponent of the cost per step in bodies; above, a chain of a hundred takes too long


def compute_cost(r: RunRecord) -> tuple[float, float]:
    """Return the cost of a run: CPU time [s], at least the clock's resolution, then index-1 evaluations for ties."""
    return max(r.cpu_median_s, CLOCK), count_index_1_evaluations(r)


@dataclass
class Candidate:
    """A solver with its options, the error that it must meet, and its runs so far."""

    solver: str
    problem: Problem
    error: float  # [m] required
    limit: float  # [s] of CPU time a run
    runs: list[RunRecord] = field(default_factory=list)
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def control(self) -> str:
        """The setting that is searched: ``dt`` or ``rtol``."""
        return self.runs[0].control if self.runs else registry.solvers()[self.solver].control

    @property
    def best(self) -> RunRecord | None:
        """The cheapest run that meets the error; None if none does."""
        good = (r for r in self.runs if r.status == Status.SUCCESS)
        return find_cheapest(good, self.error, lambda r: r.motion_error_judged_m, compute_cost)

    @property
    def closest(self) -> RunRecord:
        """The successful run with the least error; the last run if none is successful."""
        known = [r for r in self.runs if r.status == Status.SUCCESS]
        return min(known, key=lambda r: r.motion_error_judged_m) if known else self.runs[-1]

    @property
    def failure(self) -> str:
        """The reason why no run meets the error, in words, with the end of the last run; empty if a run meets it."""
        r, last = self.closest, self.runs[-1]
        if self.best:
            return ""
        if r.status != Status.SUCCESS:
            return f"{r.status}: {'; '.join(list_reasons(r))}"
        further = f"; then {last.status} at {self.control}={self.get_setting(last):g}: {'; '.join(list_reasons(last))}"
        return f"least error of {len(self.runs)} runs{'' if last is r else further}"

    def meets_error(self, r: RunRecord) -> bool:
        """Return whether the run is a success and its motion error is at most the required one."""
        return r.status == Status.SUCCESS and r.motion_error_judged_m <= self.error

    def choose_next_spec(self) -> RunSpec | None:
        """Return the next run to try, by the errors of those so far; None if the search has ended.

        It ends if the last run is near enough to the required error, if no other setting can help, and if the next
        setting is outside the range of settings or within 5 % of one that was tried.
        """
        value = self._next_setting()
        tried = {self.get_setting(r) for r in self.runs}
        least = self.problem.t_end / MOST_STEPS if self.control == "dt" else TIGHTEST
        most = self.problem.t_end / 4.0 if self.control == "dt" else LOOSEST
        if value is None or not least <= value <= most or any(abs(value / v - 1.0) < 0.05 for v in tried):
            return None
        return make_spec(
            self.problem, self.solver, self.options, {self.control: float(f"{value:.3g}")}, cpu_limit=self.limit
        )

    def get_setting(self, r: RunRecord) -> float:
        """Return the value of the setting that is searched, dt [s] or rtol, of a run."""
        return r.dt_s if self.control == "dt" else r.rtol

    def _next_setting(self) -> float | None:
        """Return the dt [s] or rtol to try next; None if the last one is near enough or nothing else could help.

        After a success it is the setting at which the observed order predicts ``AIM`` of the required error.
        """
        if not self.runs:
            return self.problem.dt if self.control == "dt" else 1e-6
        last = self.runs[-1]
        if last.status in (Status.REFUSED, Status.CRASHED, Status.MEMORY):
            return None
        least, most = SPAN[self.control]
        if last.status in (Status.STALLED, Status.UNFINISHED):  # too fine for its time limit: coarsen, once
            coarser = any(self.get_setting(r) > self.get_setting(last) for r in self.runs)
            return None if coarser else self.get_setting(last) * most
        if last.status != Status.SUCCESS:  # a finer setting may help
            return self.get_setting(last) * least
        met = self.meets_error(last)
        if met and last.motion_error_judged_m > NEAR * self.error:
            return None
        power = 1.0 / self._observe_order()
        change = (AIM * self.error / max(last.motion_error_judged_m, 1e-300)) ** power
        value = self.get_setting(last) * min(max(change, least), most)
        missed = [self.get_setting(r) for r in self.runs if not self.meets_error(r)]
        return None if met and missed and value >= min(missed) else value

    def _observe_order(self) -> float:
        """Return the order of the error in dt or rtol, measured on the last two successful runs.

        If they show no order, it is the declared one for dt (2 if none is declared), and 1 for rtol.
        """
        good = [r for r in self.runs if r.status == Status.SUCCESS and r.motion_error_judged_m > 0.0][-2:]
        if len(good) == 2:
            (order,) = measure_slopes([self.get_setting(r) for r in good], [r.motion_error_judged_m for r in good])
            if 0.3 < order < 12.0:
                return float(order)
        declared = self.runs[-1].declared_order
        return (2.0 if math.isnan(declared) else declared) if self.control == "dt" else 1.0


def rank_candidates(candidates: Iterable[Candidate]) -> list[Candidate]:
    """Return the candidates that were run: those that meet the error, the cheapest first, then the others."""
    return sorted(
        (c for c in candidates if c.runs), key=lambda c: compute_cost(c.best) if c.best else (math.inf, math.inf)
    )


def judge_growth(quantity: str, bodies: Sequence[int], seconds: Sequence[float]) -> Finding:
    """Return the finding on how the CPU time of a step grows with the number n of bodies: the exponent p of n^p.

    ``seconds`` [s] is the time of a step for each number in ``bodies``, which increases; p is fitted to the last three.
    An exponent above ``LINEAR`` is a property of the solver, not a fault, and leaves the finding open.
    """
    power, _ = fit_growth(bodies[-3:], [max(x, 1e-9) for x in seconds[-3:]])
    each = ", ".join(f"{1e3 * x:.2g} ms at {n}" for n, x in zip(bodies, seconds, strict=True))
    return state_finding(quantity, f"{each}: n^{power:.1f}", f"n^{LINEAR:g} or less", True if power <= LINEAR else None)
