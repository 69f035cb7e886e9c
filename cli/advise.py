"""``advise``: the cheapest solver and setting that meet an error on a problem, from runs made now or earlier."""

import argparse
import json
import math
import tempfile
from pathlib import Path

from rich.text import Text

from ..harness.catalogue import registry
from ..harness.execution.runner import Request
from ..harness.races.cheapest import Candidate, cost_of, rank
from ..harness.reference.computation import Source, is_computable, source_of
from ..harness.results import store
from ..harness.results.records import RunRecord
from ..harness.sandbox.trial import make_problem
from ..harness.suites.suite import Suite
from ..harness.types import Problem
from .arguments import UsageError, count_jobs, load_problem
from .progress import run_watched
from .terminal import Column, number, print_json, print_table, status_style

ROUNDS = 6
OWN = 3.0  # times the stated error of the reference: nothing is judged below
COLUMNS = (
    Column("solver", right=False), Column("setting", right=False), Column("motion error [m]"), Column("CPU [s]"),
    Column("factor"), Column("steps", rank=1), Column("why not", fold=True, rank=2),
)  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    """Print the solvers, the cheapest first; return 0 if one meets the error, else 1."""
    name, parameters, plugins = load_problem(arguments)
    error, budget = arguments.error, arguments.budget
    problem = make_problem(name, parameters)
    for solver in arguments.solver:
        registry.entry_of("solver", solver, registry.solvers())
    if arguments.results:
        candidates = _read_candidates(arguments.results, problem, error, arguments.solver)
    else:
        names = arguments.solver or list(registry.solvers())
        candidates = [Candidate(n, problem, error, min(max(budget / 6.0, 1.0), 60.0)) for n in names]
        _search(candidates, plugins, budget, count_jobs(arguments.jobs), quiet=arguments.json)
    return _report(rank(candidates), error, as_json=arguments.json)


def _search(candidates: list[Candidate], plugins: tuple[str, ...], budget: float, size: int, *, quiet: bool) -> None:
    """Run settings, a round of all solvers at a time."""
    problem = candidates[0].problem
    source = source_of(problem)
    if source in (Source.OWN, Source.CERTIFIED) and problem.reference() is None:
        source = Source.COMPUTED if is_computable(problem.system) else Source.NONE
    if source is Source.NONE:
        raise UsageError(f"{problem.name} has no reference: no error is known; compare solvers with mbsbench run")
    with tempfile.TemporaryDirectory() as place:
        for k in range(ROUNDS):
            asked = {s.settings_id: (c, s) for c in candidates if (s := c.next_spec()) is not None}
            if not asked:
                break
            suite = Suite("advise", "", tuple(s for _, s in asked.values()), "", plugins)
            loaded, _ = run_watched(Request(suite, Path(place) / f"round{k}", size), quiet=quiet, resumable=False)
            for r in loaded.records:
                asked[r.settings_id][0].runs.append(r)
            if sum(_cpu_without_code(r) for c in candidates for r in c.runs) / size > budget:
                break


def _cpu_without_code(r: RunRecord) -> float:
    """CPU time [s] of a run's process, which no machine's empty cache makes longer."""
    return r.cpu_process_s - (0.0 if math.isnan(r.code_s) else r.code_s)


def _read_candidates(folder: Path, problem: Problem, error: float, solvers: list[str]) -> list[Candidate]:
    """A candidate for each solver with its options that ran the problem in ``folder``."""
    parameters = json.loads(json.dumps(dict(problem.parameters), default=list))
    found: dict[tuple[str, str], list[RunRecord]] = {}
    for r in store.newest(store.load(folder, check_series=False).records):
        same = r.problem == problem.name and json.loads(r.problem_parameters) == parameters
        if same and (not solvers or r.solver in solvers):
            found.setdefault((r.solver, r.solver_options), []).append(r)
    if not found:
        raise UsageError(f"{folder} holds no run of {problem.name} with these parameters")
    return [Candidate(solver, problem, error, math.inf, runs) for (solver, _), runs in found.items()]


def _report(candidates: list[Candidate], error: float, *, as_json: bool) -> int:
    own = max((r.reference_own_error_judged_m for c in candidates for r in c.runs if r.reference), default=0.0)
    if OWN * own > error:
        raise UsageError(f"--error must be at least {OWN * own:.2g} m: the reference's own is {own:.2g} m")
    best = candidates[0].best if candidates else None
    rows = []
    for c in candidates:
        r = c.best or c.closest
        plain = {"solver": c.solver, "case": r.case, "meets": bool(c.best), "status": r.status, "dt_s": r.dt_s,
                 "rtol": r.rtol, "motion_error_m": r.motion_error_judged_m, "cpu_s": r.cpu_median_s,
                 "steps": r.steps, "why_not": c.why_not}  # fmt: skip
        if as_json:
            print_json(plain)
        setting = f"{c.control}={c.setting(r):g}"
        factor = number(cost_of(r)[0] / cost_of(best)[0], 2) if c.best and best else ""
        cells = (setting, number(r.motion_error_judged_m), number(r.cpu_median_s, 2), factor, str(r.steps), c.why_not)
        rows.append((Text(c.solver, "" if c.best else status_style(r.status)), *cells))
    if not as_json:
        below = f"cheapest: {best.case}" if best else "no solver meets it"
        print_table(COLUMNS, rows, below, "factors of CPU time below 1.5 say little")
    return 0 if best else 1
