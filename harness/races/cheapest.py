"""The search for the setting of a solver that meets an error at the least cost, by the observed order."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ..catalogue import registry
from ..results.records import RunRecord
from ..results.words import why
from ..results.work import index_1_evaluations
from ..suites.spec import RunSpec, make_spec
from ..types import Problem, Status

NEAR = 0.1  # of the error asked for: a run below can be made cheaper
AIM = 0.4  # of the error asked for: the next setting by the observed order
SPAN = {"dt": (1.0 / 16.0, 8.0), "rtol": (1e-3, 1e2)}  # of one setting to the next
MOST_STEPS = 2_000_000
TIGHTEST, LOOSEST = 1e-13, 1e-2
CLOCK = 1e-3  # [s] times below are equal


def cost_of(r: RunRecord) -> tuple[float, float]:
    """CPU time, rounded up to the resolution of clocks [s], then index-1 evaluations."""
    return max(r.cpu_median_s, CLOCK), index_1_evaluations(r)


@dataclass
class Candidate:
    """A solver with its options, and its runs so far."""

    solver: str
    problem: Problem
    error: float  # [m] asked for
    limit: float  # [s] of CPU time a run
    runs: list[RunRecord] = field(default_factory=list)
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def control(self) -> str:
        """The setting that is searched: dt or rtol."""
        return self.runs[0].control if self.runs else registry.solvers()[self.solver].control

    @property
    def best(self) -> RunRecord | None:
        """The cheapest run that meets the error."""
        return min((r for r in self.runs if self.meets(r)), key=cost_of, default=None)

    @property
    def closest(self) -> RunRecord:
        """The run with the least error, else the last one."""
        known = [r for r in self.runs if r.status == Status.SUCCESS]
        return min(known, key=lambda r: r.motion_error_judged_m) if known else self.runs[-1]

    @property
    def why_not(self) -> str:
        """Why no run meets the error; empty if one does."""
        r, last = self.closest, self.runs[-1]
        if self.best:
            return ""
        if r.status != Status.SUCCESS:
            return f"{r.status}: {'; '.join(why(r))}"
        further = f"; then {last.status} at {self.control}={self.setting(last):g}: {'; '.join(why(last))}"
        return f"least error of {len(self.runs)} runs{'' if last is r else further}"

    def meets(self, r: RunRecord) -> bool:
        """Whether the run is a success within the error."""
        return r.status == Status.SUCCESS and r.motion_error_judged_m <= self.error

    def next_spec(self) -> RunSpec | None:
        """The setting to try next; None if there is no point."""
        value = self._next_setting()
        tried = {self.setting(r) for r in self.runs}
        least = self.problem.t_end / MOST_STEPS if self.control == "dt" else TIGHTEST
        most = self.problem.t_end / 4.0 if self.control == "dt" else LOOSEST
        if value is None or not least <= value <= most or any(abs(value / v - 1.0) < 0.05 for v in tried):
            return None
        return make_spec(
            self.problem, self.solver, self.options, {self.control: float(f"{value:.3g}")}, cpu_limit=self.limit
        )

    def setting(self, r: RunRecord) -> float:
        """dt [s] or rtol of a run."""
        return r.dt_s if self.control == "dt" else r.rtol

    def _next_setting(self) -> float | None:
        if not self.runs:
            return self.problem.dt if self.control == "dt" else 1e-6
        last = self.runs[-1]
        if last.status in (Status.REFUSED, Status.CRASHED, Status.MEMORY):
            return None
        least, most = SPAN[self.control]
        if last.status in (Status.STALLED, Status.UNFINISHED):  # too fine for the time it has, unless a coarser was not
            coarser = any(self.setting(r) > self.setting(last) for r in self.runs)
            return None if coarser else self.setting(last) * most
        if last.status != Status.SUCCESS:  # too coarse, if anything
            return self.setting(last) * least
        met = self.meets(last)
        if met and last.motion_error_judged_m > NEAR * self.error:
            return None
        power = 1.0 / self._observe_order()
        change = (AIM * self.error / max(last.motion_error_judged_m, 1e-300)) ** power
        value = self.setting(last) * min(max(change, least), most)
        missed = [self.setting(r) for r in self.runs if not self.meets(r)]
        return None if met and missed and value >= min(missed) else value

    def _observe_order(self) -> float:
        """Order of the error in the setting: from the last two runs, else as declared, else 2 in dt and 1 in rtol."""
        good = [r for r in self.runs if r.status == Status.SUCCESS and r.motion_error_judged_m > 0.0][-2:]
        if len(good) == 2:
            a, b = (math.log(r.motion_error_judged_m) for r in good)
            order = (a - b) / (math.log(self.setting(good[0])) - math.log(self.setting(good[1])))
            if 0.3 < order < 12.0:
                return order
        declared = self.runs[-1].declared_order
        return (2.0 if math.isnan(declared) else declared) if self.control == "dt" else 1.0


def rank(candidates: Iterable[Candidate]) -> list[Candidate]:
    """Candidates that were run: first those that meet the error, the cheapest first."""
    return sorted((c for c in candidates if c.runs), key=lambda c: cost_of(c.best) if c.best else (math.inf, math.inf))
