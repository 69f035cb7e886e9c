"""``peers``: engines and our solver on the same problem, in turns, and the ratio of their CPU times."""

import argparse
import dataclasses
import json
import math
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..harness.catalogue import registry
from ..harness.execution.pool import PoolError
from ..harness.races.in_turns import Result, race
from ..harness.results.naming import named
from ..harness.sandbox.apart import Apart
from ..harness.suites.spec import step_control
from ..harness.types import Problem, Solver, StepControl
from .screen import Column, lines, number, print_json, print_table
from .terms import UsageError, add_set, assignments, subcommand, whole

PROBLEMS = ("chain", "four_bar_grid")  # of Sects. 5.3 and 5.5
MEMORY = 8000.0  # [MB]
LIMIT = 3600.0  # [s] of CPU for a problem
COLUMNS = (
    Column("", fold=True), Column("CPU [s]"), Column("from", rank=2), Column("to", rank=2),
    Column("runs", rank=3), Column("ratio"), Column("|dE| [J]"), Column("dE at end [J]", rank=4),
    Column("|phi'| [m/s]", rank=1), Column("error [m]"),
)  # fmt: skip


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    words = "compare the CPU time of engines with that of our solver, on the same problems"
    p = subcommand(commands, "peers", run, words, "one object per problem")
    p.add_argument("problem", nargs="*", metavar="PROBLEM", help=f"default: {' and '.join(PROBLEMS)}")
    ours = "our solver (default: gc_weak_form, or gc_augmented_lagrangian where it refuses)"
    p.add_argument("--solver", metavar="NAME", help=ours)
    add_set(p, "--set", "solver option")
    add_set(p, "--problem-set", "problem parameter")
    theirs = "an engine, e.g. exudyn or mujoco:integrator=Euler (may be repeated; default: all that take the problem)"
    p.add_argument("--engine", metavar="NAME[:OPTION=VALUE,...]", action="append", help=theirs)
    p.add_argument("--dt", metavar="DT", help="step of all [s] (default: the problem's)")
    p.add_argument("--repeats", default="5", metavar="N", help="timed runs of each, in turns (default: 5)")
    budget = "CPU time [s] that repeating a run must not exceed (default: 60)"
    p.add_argument("--budget", default="60", metavar="S", help=budget)


def run(arguments: argparse.Namespace) -> int:
    """0 if all succeed, 1 if one does not, 2 if an engine asked for, or every engine, refuses."""
    repeats, budget = whole(arguments.repeats, "--repeats"), float(whole(arguments.budget, "--budget"))
    options = assignments(arguments.set, "--set")
    parameters = assignments(arguments.problem_set, "--problem-set")
    names = arguments.problem or PROBLEMS
    engines = _engines(arguments.engine)
    problems = [registry.make_problem(name, parameters) for name in names]  # all wrong calls are found before a run
    ours = [_ours(problem, arguments.solver, options, arguments.dt) for problem in problems]
    if not arguments.json:
        lines().print("CPU time of the integration, one thread")
    good = True
    for problem, (solver, control) in zip(problems, ours, strict=True):
        results = _apart(problem, {solver.name: solver, **engines}, control, repeats, budget)
        refused = [r for r in results if r.status == "refused"]
        if refused and (arguments.engine or len(refused) == len(engines)):
            raise UsageError(f"{refused[0].name}: {refused[0].message}")
        raced = [r for r in results if r not in refused]
        if arguments.json:
            ratios = ({"cpu_median_s": r.median_s, "ratio": _ratio(r, results[0])} for r in raced)
            plain = [{**dataclasses.asdict(r), **ratio} for r, ratio in zip(raced, ratios, strict=True)]
            left_out = {r.name: r.message for r in refused}
            print_json({"problem": problem.name, "dt_s": control.dt, "results": plain, "refused": left_out})
        else:
            _print(problem, control, raced, refused)
        good = good and all(r.status == "success" for r in raced)
    return 0 if good else 1


def _engines(asked: list[str] | None) -> dict[str, Solver]:
    """By name with options."""
    out = {}
    for words in asked or [n for n, e in registry.engines().items() if e.control == "dt"]:
        name, _, given = words.partition(":")
        entry = registry.entry_of("engine", name, registry.engines())
        made = entry.made(assignments(given.split(",") if given else [], "--engine"))
        if entry.control != "dt":
            raise UsageError(f"engine {name} is controlled by {entry.control}; peers compares solvers of fixed step")
        out[named(name, entry.changed(made))] = made
    return out


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


def _apart(
    problem: Problem, solvers: dict[str, Solver], control: StepControl, repeats: int, budget: float
) -> list[Result]:
    """The race in a process of its own: an engine may crash, and prints to standard output."""
    with tempfile.TemporaryDirectory() as place:
        said = Path(place) / "stderr"

        def target(send: Callable[[str], None]) -> None:
            os.chdir(place)  # engines leave files
            send(json.dumps([dataclasses.asdict(r) for r in race(problem, control, solvers, repeats, budget)]))

        ended = Apart(target, limit=LIMIT, memory=MEMORY, wall=math.inf, stderr=said).wait()
        if ended.code != 0 or not ended.sent:
            last = said.read_text(encoding="utf-8", errors="replace").strip().splitlines()[-1:]
            raise PoolError(f"the process of {problem.name} {ended.words}: {' '.join(last)}")
        return [Result(**{**r, "cpu_s": tuple(r["cpu_s"])}) for r in json.loads(ended.sent)]


def _ratio(one: Result, other: Result) -> float:
    """NaN where the clock of the process did not move: it may have ticks of 10 ms."""
    return one.median_s / other.median_s if other.median_s > 0.0 else math.nan


def _print(problem: Problem, control: StepControl, results: list[Result], refused: list[Result]) -> None:
    judged = max((r.judged_to_s for r in results if not math.isnan(r.judged_to_s)), default=math.nan)
    rows = []
    for r in results:
        times = (number(r.median_s), number(min(r.cpu_s)), number(max(r.cpu_s)), str(len(r.cpu_s)))
        errors = (r.energy_drift_max_J, r.energy_drift_end_J, r.phi_dot_max, r.position_error_m)
        rows.append((r.name, *times, f"{_ratio(r, results[0]):.2f}", *map(number, errors)))
    lines().print(f"\n{problem.name}, {problem.t_end:g} s at dt = {control.dt:g} s; error to {number(judged)} s")
    failed = [f"{r.name}: {r.status}: {r.message}" for r in (*results, *refused) if r.status != "success"]
    print_table(COLUMNS, rows, *failed)
