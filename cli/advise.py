"""``advise``: the cheapest solver and setting that meet an error on a problem, found by running the candidates."""

import argparse
import math
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich.text import Text

from ..harness.catalogue import registry
from ..harness.execution.runner import Request, run_suite
from ..harness.reference.computed import Source, is_computable, source_of
from ..harness.results.records import RunRecord
from ..harness.results.words import why
from ..harness.results.work import index_1_evaluations
from ..harness.sandbox.trial import made
from ..harness.suites.spec import RunSpec, make_spec
from ..harness.suites.suite import Suite
from ..harness.types import Problem, Status
from .progress import progress
from .screen import Column, number, print_json, print_table, status_style
from .terms import UsageError, above, add_jobs, add_plugin, add_problem, jobs, load_problem, subcommand

ROUNDS = 6
NEAR = 0.1  # of the error asked for: a run below can be made cheaper
AIM = 0.4  # of the error asked for: the next setting by the observed order
SPAN = {"dt": (1.0 / 16.0, 8.0), "rtol": (1e-3, 1e2)}  # of one setting to the next
MOST_STEPS = 2_000_000
TIGHTEST, LOOSEST = 1e-13, 1e-2
CLOCK = 1e-3  # [s] times below are equal
OWN = 3.0  # times the stated error of the reference: nothing is judged below
COLUMNS = (
    Column("solver", right=False), Column("setting", right=False), Column("motion error [m]"), Column("CPU [s]"),
    Column("factor"), Column("steps", rank=1), Column("why not", fold=True, rank=2),
)  # fmt: skip


def cost(r: RunRecord) -> tuple[float, float]:
    """CPU time as far as clocks tell [s], then index-1 evaluations."""
    return max(r.cpu_median_s, CLOCK), index_1_evaluations(r)


@dataclass
class Candidate:
    """A solver with its default options, and its runs so far."""

    solver: str
    problem: Problem
    error: float  # [m] asked for
    limit: float  # [s] of CPU time a run
    runs: list[RunRecord] = field(default_factory=list)

    @property
    def control(self) -> str:
        """What it is set by: dt or rtol."""
        return registry.solvers()[self.solver].control

    @property
    def best(self) -> RunRecord | None:
        """The cheapest run that meets the error."""
        return min((r for r in self.runs if self.meets(r)), key=cost, default=None)

    @property
    def closest(self) -> RunRecord:
        """The run with the least error, else the last one."""
        known = [r for r in self.runs if r.status == Status.SUCCESS]
        return min(known, key=lambda r: r.motion_error_judged_m) if known else self.runs[-1]

    def meets(self, r: RunRecord) -> bool:
        """Whether the run is a success within the error."""
        return r.status == Status.SUCCESS and r.motion_error_judged_m <= self.error

    def next(self) -> RunSpec | None:
        """The setting to try next; None if there is no point."""
        value = self._value()
        tried = {self.setting(r) for r in self.runs}
        least = self.problem.t_end / MOST_STEPS if self.control == "dt" else TIGHTEST
        most = self.problem.t_end / 4.0 if self.control == "dt" else LOOSEST
        if value is None or not least <= value <= most or any(abs(value / v - 1.0) < 0.05 for v in tried):
            return None
        return make_spec(self.problem, self.solver, None, {self.control: float(f"{value:.3g}")}, cpu_limit=self.limit)

    def setting(self, r: RunRecord) -> float:
        """dt [s] or rtol of a run."""
        return r.dt_s if self.control == "dt" else r.rtol

    def _value(self) -> float | None:
        if not self.runs:
            return self.problem.dt if self.control == "dt" else 1e-6
        last = self.runs[-1]
        if last.status in (Status.REFUSED, Status.CRASHED, Status.MEMORY):
            return None
        least, most = SPAN[self.control]
        if last.status in (
            Status.STALLED,
            Status.UNFINISHED,
        ):  # too fine for the time it has, unless a coarser one was not
            coarser = any(self.setting(r) > self.setting(last) for r in self.runs)
            return None if coarser else self.setting(last) * most
        if last.status != Status.SUCCESS:  # too coarse, if anything
            return self.setting(last) * least
        met = self.meets(last)
        if met and last.motion_error_judged_m > NEAR * self.error:
            return None
        power = 1.0 / self._order()
        change = (AIM * self.error / max(last.motion_error_judged_m, 1e-300)) ** power
        value = self.setting(last) * min(max(change, least), most)
        missed = [self.setting(r) for r in self.runs if not self.meets(r)]
        return None if met and missed and value >= min(missed) else value

    def _order(self) -> float:
        """Of the error in the setting: from the last two runs, else the declared one, else 2 in dt and 1 in rtol."""
        good = [r for r in self.runs if r.status == Status.SUCCESS and r.motion_error_judged_m > 0.0][-2:]
        if len(good) == 2:
            a, b = (math.log(r.motion_error_judged_m) for r in good)
            order = (a - b) / (math.log(self.setting(good[0])) - math.log(self.setting(good[1])))
            if 0.3 < order < 12.0:
                return order
        declared = self.runs[-1].declared_order
        return (2.0 if math.isnan(declared) else declared) if self.control == "dt" else 1.0


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    words = "find the cheapest solver and setting that meet an error on a problem; exit code 1 if none does"
    p = subcommand(commands, "advise", run, words, "one object a solver, the cheapest first")
    add_problem(p)
    p.add_argument("--error", required=True, metavar="X", help="largest motion error allowed [m]")
    p.add_argument(
        "--budget",
        default="120",
        metavar="S",
        help="CPU time of all runs, for each at a time, about [s] (default: 120)",
    )
    p.add_argument("--solver", action="append", default=[], metavar="NAME", help="only this one; may be repeated")
    add_plugin(p)
    add_jobs(p)


def run(arguments: argparse.Namespace) -> int:
    """0 if a solver meets the error."""
    name, parameters, plugins = load_problem(arguments)
    error = above(arguments.error, "--error", unit=" [m]")
    budget = above(arguments.budget, "--budget", unit=" [s]")
    problem = made(name, parameters)
    source = source_of(problem)
    if source in (Source.OWN, Source.CERTIFIED) and problem.reference() is None:
        source = Source.COMPUTED if is_computable(problem.system) else Source.NONE
    if source is Source.NONE:
        raise UsageError(f"{problem.name} has no reference: no error is known; compare solvers with mbsbench run")
    names = arguments.solver or list(registry.solvers())
    for name in names:
        registry.entry_of("solver", name, registry.solvers())
    candidates = [Candidate(name, problem, error, min(max(budget / 6.0, 1.0), 60.0)) for name in names]
    size = jobs(arguments.jobs)
    with tempfile.TemporaryDirectory() as place:
        for k in range(ROUNDS):
            asked = {s.settings_id: (c, s) for c in candidates if (s := c.next()) is not None}
            if not asked:
                break
            suite = Suite("advise", "", tuple(s for _, s in asked.values()), "", plugins)
            with progress(quiet=arguments.json, size=size, resumable=False) as watcher:
                records = run_suite(Request(suite, Path(place) / f"round{k}", size), watcher).records
            for r in records:
                asked[r.settings_id][0].runs.append(r)
            if sum(r.cpu_process_s for c in candidates for r in c.runs) / size > budget:
                break
    return _report(candidates, error, as_json=arguments.json)


def _report(candidates: list[Candidate], error: float, *, as_json: bool) -> int:
    met = sorted((c for c in candidates if c.best), key=lambda c: cost(c.best) if c.best else (math.inf, math.inf))
    others = [c for c in candidates if not c.best and c.runs]
    own = max((r.reference_own_error_judged_m for c in met + others for r in c.runs if r.reference), default=0.0)
    if OWN * own > error:
        raise UsageError(f"--error must be at least {OWN * own:.2g} m: the reference's own is {own:.2g} m")
    least = cost(met[0].best)[0] if met and met[0].best else math.nan
    rows = []
    for c in met + others:
        r = c.best or c.closest
        because = "" if c.best else _why_not(c)
        plain = {"solver": c.solver, "case": r.case, "meets": bool(c.best), "status": r.status, "dt_s": r.dt_s,
                 "rtol": r.rtol, "motion_error_m": r.motion_error_judged_m, "cpu_s": r.cpu_median_s,
                 "steps": r.steps, "why_not": because}  # fmt: skip
        if as_json:
            print_json(plain)
        setting = f"{c.control}={c.setting(r):g}"
        factor = number(cost(r)[0] / least, 2) if c.best else ""
        cells = (setting, number(r.motion_error_judged_m), number(r.cpu_median_s, 2), factor, str(r.steps), because)
        rows.append((Text(c.solver, "" if c.best else status_style(r.status)), *cells))
    if not as_json:
        below = "no solver meets it" if not met else f"cheapest: {met[0].best.case}" if met[0].best else ""
        print_table(COLUMNS, rows, below, "one CPU time a run: differences below a factor of 1.5 say little")
    return 0 if met else 1


def _why_not(c: Candidate) -> str:
    r = c.closest
    if r.status == Status.SUCCESS:
        last = c.runs[-1]
        further = (
            "" if last is r else f"; then {last.status} at {c.control}={c.setting(last):g}: {'; '.join(why(last))}"
        )
        return f"least error of {len(c.runs)} runs{further}"
    return f"{r.status}: {'; '.join(why(r))}"
