"""Compilation before the clock starts: each solver takes a few steps of one of its runs, whose result is thrown away.

First in a forked process, which fills the compiler's cache on disk and may crash; then, if that went well, in the
parent of all runs, so that every fork finds the compiled code in memory. Plugins are never run in the parent.
"""

import dataclasses
import json
import os
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from ..catalogue import registry
from ..sandbox.isolation import fork, kill_group
from ..suites.spec import RunSpec
from ..types import StepControl

LIMIT = 600.0  # [s] for all solvers together: a cold compiler needs half a minute for the kernels
STEPS = 2  # of fixed size
SHORT = 1e-3  # [s] of simulated time for error-controlled solvers


def runs_to_warm(specs: Sequence[RunSpec]) -> list[RunSpec]:
    """The first run of each solver of ``solvers/``, cut to a few steps."""
    first: dict[str, RunSpec] = {}
    for spec in specs:
        if registry.is_own_solver(spec.solver) and registry.is_own_problem(spec.problem):
            first.setdefault(spec.solver, spec)
    return [_short(spec) for spec in first.values()]


def warm(specs: Sequence[RunSpec]) -> dict[str, float]:
    """Run each; wall time [s] by solver, those that failed left out."""
    out = {}
    for spec in specs:
        began = time.monotonic()
        try:
            problem = registry.make_problem(spec.problem, spec.parameters)
            solver = registry.make_solver(spec.solver, spec.options)
            control = dataclasses.replace(spec.control, wall_limit=LIMIT)
            if solver.refuses(problem, control) is None:
                solver.solve(problem, control)
        except Exception:  # its runs will tell
            continue
        out[spec.solver] = time.monotonic() - began
    return out


def warm_apart_then_here(specs: Sequence[RunSpec], unwanted: Callable[[], bool] = lambda: False) -> dict[str, float]:
    """Warm in a forked process, then here what went well there; the times [s] of the first. Ends when ``unwanted``."""
    with tempfile.TemporaryDirectory() as place:
        note = Path(place) / "times.json"
        times = _apart(specs, note, Path(place) / "stderr", unwanted)
    if not unwanted():
        warm([spec for spec in specs if spec.solver in times])
    return times


def _apart(specs: Sequence[RunSpec], note: Path, stderr: Path, unwanted: Callable[[], bool]) -> dict[str, float]:
    def run(tell: Callable[[str], None]) -> None:
        done: dict[str, float] = {}
        for spec in specs:
            done.update(warm([spec]))
            note.write_text(json.dumps(done), encoding="utf-8")

    child = fork(run, stderr, memory=4000.0, cpu=LIMIT)
    os.close(child.phase)
    until = time.monotonic() + LIMIT
    while True:
        if os.waitpid(child.pid, os.WNOHANG)[0]:
            break
        if time.monotonic() > until or unwanted():
            kill_group(child.pid)
            os.waitpid(child.pid, 0)
            break
        time.sleep(0.01)
    return dict(json.loads(note.read_text(encoding="utf-8"))) if note.exists() else {}


def _short(spec: RunSpec) -> RunSpec:
    c: StepControl = spec.control
    t_end = SHORT if c.dt is None else STEPS * c.dt
    return dataclasses.replace(spec, parameters={**spec.parameters, "t_end": t_end})
