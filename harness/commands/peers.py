"""``peers``: another engine on the same problem beside our solver, in one go, and the ratio of their times."""

import argparse
import dataclasses
import json
import math
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from ..catalogue import registry
from ..execution.pool import PoolError
from ..peers import exudyn_engine
from ..peers.race import Result, Runner, race, read, write
from ..sandbox.apart import Apart
from ..suites.spec import step_control
from ..types import Problem, Solver, StepControl
from .run import whole
from .screen import lines, screen
from .terms import UsageError, assignments

PROBLEMS = ("chain", "four_bar_grid")  # of Sects. 5.3 and 5.5
MEMORY = 8000.0  # [MB]
LIMIT = 3600.0  # [s] of CPU for a problem
WARM_STEPS = 3


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    p = commands.add_parser("peers", help="another engine (exudyn) beside ours on the same problem, and the ratio")
    p.add_argument("problem", nargs="*", help=f"default: {' and '.join(PROBLEMS)}")
    p.add_argument("--solver", help="ours (default: gc_weak_form, or gc_augmented_lagrangian where it refuses)")
    p.add_argument("--set", action="append", default=[], metavar="K=V", help="a solver option")
    p.add_argument("--problem-set", action="append", default=[], metavar="K=V", help="a problem parameter")
    p.add_argument("--dt", metavar="DT", help="step of both [s] (default: the problem's)")
    p.add_argument("--repeats", default="5", metavar="N", help="timed runs of each, in turns (default: 5)")
    p.add_argument(
        "--budget", default="60", metavar="S", help="CPU time [s] beyond which a run is not repeated (default: 60)"
    )
    p.add_argument("--json", action="store_true", help="one JSON object a problem and line, for machines")
    p.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """0 if all ended well, 1 if one did not, 2 without the engine."""
    exudyn_engine.engine()
    repeats, budget = whole(arguments.repeats, "--repeats"), float(whole(arguments.budget, "--budget"))
    options = assignments(arguments.set, "--set")
    parameters = assignments(arguments.problem_set, "--problem-set")
    names = arguments.problem or PROBLEMS
    presented = [registry.make_problem(name, parameters) for name in names]  # all that may be a wrong call comes first
    ours = [_ours(problem, arguments.solver, options, arguments.dt) for problem in presented]
    out = screen()
    engine = f"{exudyn_engine.NAME} {exudyn_engine.version()}"
    if not arguments.json:
        out.print(f"{engine}, index-2 trapezoidal integrator; CPU time, one thread")
    good = True
    for problem, (solver, control) in zip(presented, ours, strict=True):
        results = _apart(problem, solver, control, repeats, budget)
        if arguments.json:
            plain = {"problem": problem.name, "engine": engine, "dt_s": control.dt, "results": _plain(results)}
            lines().print(json.dumps(plain, ensure_ascii=False, allow_nan=False))
        else:
            _print(out, problem, control, results)
        good = good and all(r.status == "success" for r in results)
    return 0 if good else 1


def _plain(results: list[Result]) -> list[dict[str, Any]]:
    """JSON-able: None for a number that does not exist."""
    out = []
    for r in results:
        plain = {**dataclasses.asdict(r), "cpu_median_s": r.median_s, "ratio": r.median_s / results[0].median_s}
        out.append({k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in plain.items()})
    return out


def _ours(problem: Problem, name: str | None, options: dict[str, str], dt: str | None) -> tuple[Solver, StepControl]:
    """Our solver and the step of both."""
    control = step_control(name or "gc_weak_form", "dt", problem, {} if dt is None else {"dt": dt})
    for candidate in [name] if name else ["gc_weak_form", "gc_augmented_lagrangian"]:
        solver = registry.make_solver(candidate, options)
        if solver.control != "dt":
            raise UsageError(f"solver {candidate} is controlled by {solver.control}; peers compares fixed steps")
        reason = solver.refuses(problem, control)
        if reason is None:
            return solver, control
    raise UsageError(f"{solver.name}: {reason}")


def _apart(problem: Problem, solver: Solver, control: StepControl, repeats: int, budget: float) -> list[Result]:
    """The race in a process of its own: an engine may crash, and prints where it likes."""
    with tempfile.TemporaryDirectory() as place:
        note, said = Path(place) / "results.json", Path(place) / "stderr"

        def target(tell: Callable[[str], None]) -> None:
            os.chdir(place)  # engines leave files
            write(note, race(problem, _runners(problem, solver, control), repeats, budget))

        ended = Apart(target, limit=math.inf, memory=MEMORY, cpu=LIMIT, stderr=said).wait()
        if ended.code != 0 or not note.exists():
            last = said.read_text(encoding="utf-8", errors="replace").strip().splitlines()[-1:]
            raise PoolError(f"the process of {problem.name} {ended.words}: {' '.join(last)}")
        return read(note)


def _runners(problem: Problem, solver: Solver, control: StepControl) -> list[Runner]:
    dt = control.dt
    assert dt is not None  # step_control has seen to it
    short = dataclasses.replace(problem, t_end=WARM_STEPS * dt)
    ours = Runner(solver.name, lambda: solver.solve(short, control), lambda: solver.solve(problem, control), shown=None)
    return [ours, *(_theirs(problem, short, dt, v) for v in _variants(problem))]


def _theirs(problem: Problem, short: Problem, dt: float, variant: exudyn_engine.Variant) -> Runner:
    return Runner(
        ", ".join(filter(None, (exudyn_engine.NAME, variant.words))),
        lambda: exudyn_engine.solve(short, dt, variant, record=False),
        lambda: exudyn_engine.solve(problem, dt, variant, record=False),
        lambda: exudyn_engine.solve(problem, dt, variant, record=True),
    )


def _variants(problem: Problem) -> tuple[exudyn_engine.Variant, ...]:
    if exudyn_engine.redundant(problem):
        return (exudyn_engine.DROPPED, exudyn_engine.KEPT)
    return (exudyn_engine.INDEPENDENT,)


def _print(out: Console, problem: Problem, control: StepControl, results: list[Result]) -> None:
    ours = results[0].median_s
    judged = max((r.judged_to_s for r in results if not math.isnan(r.judged_to_s)), default=math.nan)
    table = Table(box=None, padding=(0, 2, 0, 0))
    names = ("", "CPU [s]", "from", "to", "runs", "ratio", "|dE| [J]", "dE at end [J]", "|phi'| [m/s]", "error [m]")
    for name in names:
        table.add_column(Text(name), justify="right" if name else "left")
    for r in results:
        numbers = (r.energy_drift_max_J, r.energy_drift_end_J, r.phi_dot_max, r.position_error_m)
        times = (_short(r.median_s), _short(min(r.cpu_s)), _short(max(r.cpu_s)), str(len(r.cpu_s)))
        table.add_row(Text(r.name), *times, f"{r.median_s / ours:.2f}", *map(_short, numbers))
    out.print(f"\n{problem.name}, {problem.t_end:g} s at dt = {control.dt:g} s; error to {_short(judged)} s")
    out.print(table)
    for r in results:
        if r.status != "success":
            out.print(Text(f"{r.name}: {r.status}: {r.message}", "yellow"))


def _short(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.3g}"
