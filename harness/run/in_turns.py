"""Time the finished runs of a problem once more, in turns (A B A B) in one process.

A machine that slows down slows all of them by the same factor, so that ratios of their CPU times can be quoted.
"""

import dataclasses
import json
import math
import os
import tempfile
from collections.abc import Callable, Iterable, Sequence
from itertools import groupby
from pathlib import Path

from ..base.code_meter import CODE_LIMIT
from ..base.forked_process import ForkedProcess
from ..catalogue import registry
from ..mechanics.types import Status, StepControl
from ..results import store
from ..results.records import RunRecord, format_notes
from ..results.reproduce import list_control
from .contract import make_cost_columns
from .presenting import present_solver
from .worker import solve_repeatedly

WARM_STEPS = 3  # of a first, short run of each, which compiles and fills caches
BUDGET = 60.0  # [s] of CPU time of a run over all turns: one that would take longer has fewer turns
MEMORY = 8000.0  # [MB] of the process
LIMIT = 3600.0  # [s] of its CPU time


def time_in_turns(
    folder: Path, records: Iterable[RunRecord], turns: int, plugins: Sequence[str] = (), budget: float = BUDGET
) -> tuple[list[RunRecord], list[str]]:
    """Measure the CPU times of each problem's finished runs in turns, and write them into their records in ``folder``.

    Return the new records, and a line for each problem whose timing failed; its records stay as they are. ``budget``
    [s] is the CPU time of each run over all ``turns``.
    """
    finished = (r for r in records if r.status in (Status.SUCCESS, Status.INACCURATE))
    timed, failures = list[RunRecord](), list[str]()
    for (problem, _), group in groupby(sorted(finished, key=_name_variant), key=_name_variant):
        runs = list(group)
        times, failure = _time_in_process(runs, turns, plugins, budget)
        failures += [f"{problem}: {failure}"] if failure else []
        timed += [_replace_times(r, own, len(runs)) for r, own in zip(runs, times, strict=False)]
    for r in timed:
        store.write_record(folder, r)
    return timed, failures


def take_turns(runs: Sequence[RunRecord], turns: int, budget: float = BUDGET) -> list[list[float]]:
    """Solve the runs of one problem one after the other, ``turns`` times; return the CPU times [s] of each run.

    Each is first solved for a few steps, which do not count. A run that would exceed ``budget`` [s] of CPU time in all
    has fewer turns.
    """
    problem = registry.make_problem(runs[0].problem, runs[0].parameters)
    calls = []
    for r in runs:
        solver = present_solver(registry.make_solver(r.solver, r.options), problem)
        control = StepControl(**{k: v for k, v in list_control(r).items() if k != "cpu_limit"})
        short = dataclasses.replace(problem, t_end=min(problem.t_end, WARM_STEPS * (control.dt or problem.dt)))
        solver.solve(short, control)
        calls.append((solver, control))
    times: list[list[float]] = [[] for _ in runs]
    for _ in range(turns):
        for (solver, control), spent in zip(calls, times, strict=True):
            if not spent or sum(spent) + spent[-1] <= budget:
                spent.append(solve_repeatedly(solver, problem, control, 1)[1]["cpu_min_s"])
    return times


def _name_variant(r: RunRecord) -> tuple[str, str]:
    """Return the problem with its parameters as JSON, by which runs are sorted and grouped."""
    return r.problem, r.problem_parameters


def _time_in_process(
    runs: Sequence[RunRecord], turns: int, plugins: Sequence[str], budget: float
) -> tuple[list[list[float]], str]:
    """Call ``take_turns`` in a separate process; return the CPU times [s] of each run, and "" or why it failed.

    The process is separate because an engine may crash or print. If it fails, there are no times.
    """
    with tempfile.TemporaryDirectory() as place:
        native = Path(place) / "stderr"

        def target(send: Callable[[str], None]) -> None:
            """Load the plugins, take the turns in a temporary folder, and send the times as JSON."""
            for plugin in plugins:
                registry.load_plugin(plugin)
            os.chdir(place)  # engines may write files
            send(json.dumps(take_turns(runs, turns, budget)))

        ended = ForkedProcess(target, limit=LIMIT, memory=MEMORY, wall=math.inf, stderr=native, code=CODE_LIMIT).wait()
        if ended.code == 0 and ended.sent:
            return json.loads(ended.sent), ""
        last = native.read_text(encoding="utf-8", errors="replace").strip().splitlines()[-1:]
        return [], f"the process that timed it {ended.words}: {' '.join(last)}"


def _replace_times(r: RunRecord, times: Sequence[float], runs: int) -> RunRecord:
    """Return the record with these CPU times [s] as its costs, and a note; ``runs`` is the number of runs in turns."""
    note = f"CPU times: {len(times)} turns in one process, {runs} runs of the problem in turns"
    return dataclasses.replace(
        r,
        **make_cost_columns(times, len(times)),
        notes=format_notes([*(n for n in r.note_lines if not n.startswith("CPU times: ")), note]),
    )
