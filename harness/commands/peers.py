"""``peers``: another engine and our solver on the same problem, in turns, and the ratio of their CPU times."""

import argparse
import dataclasses
import json
import math
import os
import tempfile
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ..catalogue import registry
from ..execution.pool import PoolError
from ..peers import exudyn_engine
from ..peers.race import Result, Runner, race
from ..sandbox.apart import Apart
from ..suites.spec import step_control
from ..types import Problem, Solver, StepControl
from .screen import Column, lines, number, print_json, print_table
from .terms import UsageError, add_assignments, assignments, subcommand, whole

PROBLEMS = ("chain", "four_bar_grid")  # of Sects. 5.3 and 5.5
MEMORY = 8000.0  # [MB]
LIMIT = 3600.0  # [s] of CPU for a problem
WARM_STEPS = 3
COLUMNS = (
    Column("", fold=True), Column("CPU [s]"), Column("from", rank=2), Column("to", rank=2),
    Column("runs", rank=3), Column("ratio"), Column("|dE| [J]"), Column("dE at end [J]", rank=4),
    Column("|phi'| [m/s]", rank=1), Column("error [m]"),
)  # fmt: skip


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    words = "compare the CPU time of another engine (Exudyn) with ours on the same problems"
    p = subcommand(commands, "peers", run, words, "one object per problem")
    p.add_argument("problem", nargs="*", metavar="PROBLEM", help=f"default: {' and '.join(PROBLEMS)}")
    ours = "our solver (default: gc_weak_form, or gc_augmented_lagrangian where it refuses)"
    p.add_argument("--solver", metavar="NAME", help=ours)
    add_assignments(p, "solver option")
    p.add_argument("--dt", metavar="DT", help="step of both [s] (default: the problem's)")
    p.add_argument("--repeats", default="5", metavar="N", help="timed runs of each, in turns (default: 5)")
    budget = "CPU time [s] that repeating a run must not exceed (default: 60)"
    p.add_argument("--budget", default="60", metavar="S", help=budget)


def run(arguments: argparse.Namespace) -> int:
    """0 if all succeed, 1 if one does not, 2 if the engine is not installed."""
    exudyn_engine.engine()
    repeats, budget = whole(arguments.repeats, "--repeats"), float(whole(arguments.budget, "--budget"))
    options = assignments(arguments.set, "--set")
    parameters = assignments(arguments.problem_set, "--problem-set")
    names = arguments.problem or PROBLEMS
    problems = [registry.make_problem(name, parameters) for name in names]  # all wrong calls are found before a run
    ours = [_ours(problem, arguments.solver, options, arguments.dt) for problem in problems]
    engine = f"{exudyn_engine.NAME} {version(exudyn_engine.NAME)}"
    if not arguments.json:
        lines().print(f"{engine}, index-2 trapezoidal integrator; CPU time, one thread")
    good = True
    for problem, (solver, control) in zip(problems, ours, strict=True):
        results = _apart(problem, solver, control, repeats, budget)
        if arguments.json:
            ratios = ({"cpu_median_s": r.median_s, "ratio": r.median_s / results[0].median_s} for r in results)
            plain = [{**dataclasses.asdict(r), **ratio} for r, ratio in zip(results, ratios, strict=True)]
            print_json({"problem": problem.name, "engine": engine, "dt_s": control.dt, "results": plain})
        else:
            _print(problem, control, results)
        good = good and all(r.status == "success" for r in results)
    return 0 if good else 1


def _ours(problem: Problem, name: str | None, options: dict[str, str], dt: str | None) -> tuple[Solver, StepControl]:
    """Our solver and the step of both."""
    control = step_control(name or "gc_weak_form", "dt", problem, {} if dt is None else {"dt": dt})
    for candidate in [name] if name else ["gc_weak_form", "gc_augmented_lagrangian"]:
        solver = registry.make_solver(candidate, options)
        if solver.control != "dt":
            words = f"is controlled by {solver.control}; peers compares solvers of fixed step"
            raise UsageError(f"solver {candidate} {words}")
        reason = solver.refuses(problem, control)
        if reason is None:
            return solver, control
    raise UsageError(f"{solver.name}: {reason}")


def _apart(problem: Problem, solver: Solver, control: StepControl, repeats: int, budget: float) -> list[Result]:
    """The race in a process of its own: an engine may crash, and prints to standard output."""
    with tempfile.TemporaryDirectory() as place:
        said = Path(place) / "stderr"

        def target(send: Callable[[str], None]) -> None:
            os.chdir(place)  # engines leave files
            results = race(problem, _runners(problem, solver, control), repeats, budget)
            send(json.dumps([dataclasses.asdict(r) for r in results]))

        ended = Apart(target, limit=math.inf, memory=MEMORY, cpu=LIMIT, stderr=said).wait()
        if ended.code != 0 or not ended.sent:
            last = said.read_text(encoding="utf-8", errors="replace").strip().splitlines()[-1:]
            raise PoolError(f"the process of {problem.name} {ended.words}: {' '.join(last)}")
        return [Result(**{**r, "cpu_s": tuple(r["cpu_s"])}) for r in json.loads(ended.sent)]


def _runners(problem: Problem, solver: Solver, control: StepControl) -> list[Runner]:
    dt = control.dt
    assert dt is not None  # by step_control
    short = dataclasses.replace(problem, t_end=WARM_STEPS * dt)
    ours = Runner(solver.name, lambda: solver.solve(short, control), lambda: solver.solve(problem, control), shown=None)
    return [ours, *(_theirs(problem, short, dt, v) for v in exudyn_engine.variants(problem))]


def _theirs(problem: Problem, short: Problem, dt: float, variant: exudyn_engine.Variant) -> Runner:
    return Runner(
        ", ".join(filter(None, (exudyn_engine.NAME, variant.words))),
        lambda: exudyn_engine.solve(short, dt, variant, record=False),
        lambda: exudyn_engine.solve(problem, dt, variant, record=False),
        lambda: exudyn_engine.solve(problem, dt, variant, record=True),
    )


def _print(problem: Problem, control: StepControl, results: list[Result]) -> None:
    judged = max((r.judged_to_s for r in results if not math.isnan(r.judged_to_s)), default=math.nan)
    rows = []
    for r in results:
        times = (number(r.median_s), number(min(r.cpu_s)), number(max(r.cpu_s)), str(len(r.cpu_s)))
        errors = (r.energy_drift_max_J, r.energy_drift_end_J, r.phi_dot_max, r.position_error_m)
        rows.append((r.name, *times, f"{r.median_s / results[0].median_s:.2f}", *map(number, errors)))
    lines().print(f"\n{problem.name}, {problem.t_end:g} s at dt = {control.dt:g} s; error to {number(judged)} s")
    failed = [f"{r.name}: {r.status}: {r.message}" for r in results if r.status != "success"]
    print_table(COLUMNS, rows, *failed)
