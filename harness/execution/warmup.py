"""Preparation before the clock starts: references not kept yet are computed, and kernels are compiled.

Each solver takes a few steps of one of its runs, whose result is thrown away. First in a forked process, which fills
the compiler's cache on disk and may crash; then, if that went well, in the parent of all runs, so that every fork finds
the compiled code in memory. Plugins are never run in the parent.
"""

import contextlib
import dataclasses
import json
import os
import select
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ..catalogue import registry
from ..code_meter import CODE_LIMIT
from ..metrics import passes
from ..reference.computation import LARGEST, reference_of
from ..results.naming import format_name
from ..sandbox.apart import TICK, Apart
from ..suites.spec import RunSpec
from ..types import Problem
from .job import Job

LIMIT = 600.0  # [s] for a solver, counted in no run, without making code
MEMORY = 4000.0  # [MB]
STEPS = 2  # of fixed size
ABREAST = 1 + (os.cpu_count() or 1)  # processes: one may wait for kernels that another is compiling
SHORT = 1e-3  # [s] of simulated time for error-controlled solvers
STAND_INS = ("heavy_top", "spring_pendulum")  # for problems of plugins, which are not made here


def runs_to_warm(specs: Sequence[RunSpec], problem: Problem | None = None) -> list[RunSpec]:
    """The first run of each solver of ``solvers/`` with the same options, in short, with and without springs.

    A kernel is compiled once for all systems; which kernels a run enters depends on its options and on springs, but not
    on the value of a tolerance, a penalty or a gain that is not zero.
    """
    first: dict[str, RunSpec] = {}
    sprung: dict[str, bool] = {}
    own = [s for s in specs if registry.is_own_solver(s.solver)]
    for spec in (s for given in own for s in _made_here(given)):
        if spec.problem not in sprung:
            sprung[spec.problem] = _has_springs(spec, problem)
        t_end = SHORT if spec.control.dt is None else STEPS * spec.control.dt
        options = {k: v != 0.0 if isinstance(v, float) else v for k, v in spec.options.items()}
        key = json.dumps([spec.solver, options, sprung[spec.problem]], sort_keys=True, default=list)
        first.setdefault(key, dataclasses.replace(spec, parameters={**spec.parameters, "t_end": t_end}))
    return _solvers_in_turn(list(first.values()))


def _solvers_in_turn(specs: list[RunSpec]) -> list[RunSpec]:
    """Each solver once, then each that is left once again: the options of one wait for the same kernels."""
    counted = Counter[str]()
    turns = []
    for spec in specs:
        turns.append(counted[spec.solver])
        counted[spec.solver] += 1
    return [spec for _, spec in sorted(zip(turns, specs, strict=True), key=lambda pair: pair[0])]


def _made_here(spec: RunSpec) -> list[RunSpec]:
    if registry.is_own_problem(spec.problem):
        return [spec]
    return [dataclasses.replace(spec, problem=name, parameters={}) for name in STAND_INS]


def _has_springs(spec: RunSpec, problem: Problem | None) -> bool:
    try:
        made = problem if problem and problem.name == spec.problem else None
        return len((made or registry.make_problem(spec.problem, spec.parameters)).system.spring_i) > 0
    except Exception:  # its runs will show it
        return False


def warm(specs: Sequence[RunSpec], made: Problem | None = None) -> dict[str, float]:
    """Run each, on ``made`` if it is that problem; wall time [s] by solver, those that failed left out."""
    out = {}
    for spec in specs:
        began = time.monotonic()
        try:
            if made and made.name == spec.problem:
                problem = dataclasses.replace(made, t_end=spec.parameters["t_end"])
            else:
                problem = registry.make_problem(spec.problem, spec.parameters)
            solver = registry.make_solver(spec.solver, spec.options)
            control = dataclasses.replace(spec.control, cpu_limit=LIMIT)
            if solver.refuses(problem, control) is None:
                solver.solve(problem, control)
        except Exception:  # its runs will show it
            continue
        out[spec.solver] = time.monotonic() - began
    return out


def jobs_by_motion(jobs: Sequence[Job]) -> list[Job]:
    """The first job of each motion."""
    first = {spec.settings_id for spec in list_motions([job.spec for job in jobs])}
    return [job for job in jobs if job.spec.settings_id in first]


def list_motions(specs: Sequence[RunSpec]) -> list[RunSpec]:
    """The first run of each motion: of problems with equal parameters, those of the presentation aside."""
    first: dict[str, RunSpec] = {}
    for spec in specs:
        aside = (*registry.PRESENTED, "retrace")
        parameters = {k: v for k, v in spec.parameters.items() if k not in aside}
        first.setdefault(json.dumps([spec.problem, parameters], sort_keys=True, default=list), spec)
    return list(first.values())


@dataclass(frozen=True)
class Task:
    """A part of the preparation: ``apart`` in a process of its own; ``here`` once that has sent what times it took."""

    apart: Callable[[Callable[[str], None]], object]  # sends the times [s] of solvers and of references, by name
    limit: float = LIMIT  # [s]
    here: Callable[[], object] = lambda: None


def prepare(
    specs: Sequence[RunSpec], jobs: Sequence[Job], unwanted: Callable[[], bool] = lambda: False,
    told: Callable[[dict[str, float], dict[str, float]], object] = lambda times, references: None,
) -> None:  # fmt: skip
    """Compile what measures and the solvers of ``specs``, and compute the references of ``jobs``; load the code here.

    Some at a time, each in a forked process, which fills the caches and may crash; ends when ``unwanted``. ``told`` is
    called with the times [s] that solvers and references took, as soon as they are known. The first solver compiles the
    kernels that others share, while references keep the others from compiling them too.
    """
    solvers, laws = [_compile(spec) for spec in specs], Task(_load_laws, here=passes.load)
    waiting = [*solvers[:1], laws, *map(_compute, jobs), *solvers[1:]][::-1]
    going = dict[Apart, Task]()  # one that hangs takes no other's time
    try:
        while (waiting or going) and not unwanted():
            while waiting and len(going) < ABREAST:
                task = waiting.pop()
                going[Apart(task.apart, limit=task.limit, memory=MEMORY, code=CODE_LIMIT)] = task
            select.select([p.pipe for p in going if not p.closed_at], [], [], TICK)
            for process in list(going):
                if (ended := process.look()) is not None:
                    task = going.pop(process)
                    for line in ended.sent.splitlines():
                        told(*json.loads(line))
                        task.here()
    finally:
        for process in going:
            process.kill()
            process.wait()


def _compile(spec: RunSpec) -> Task:
    """Compile a solver; one that fails is left to its runs."""

    def apart(send: Callable[[str], None]) -> None:
        if times := warm([spec]):
            send(json.dumps([times, {}]))

    return Task(apart, here=lambda: warm([spec]))


def _load_laws(send: Callable[[str], None]) -> None:
    passes.load()
    send(json.dumps([{}, {}]))


def _compute(job: Job) -> Task:
    """Compute the reference of a run that is not kept yet; one that fails is left to its runs."""

    def apart(send: Callable[[str], None]) -> None:
        began = time.monotonic()
        with contextlib.suppress(Exception):
            for plugin in job.plugins:
                registry.load_plugin(plugin)
            reference_of(registry.make_problem(job.spec.problem, job.spec.parameters))
        name = format_name(job.spec.problem, job.spec.parameters)
        send(json.dumps([{}, {name: time.monotonic() - began}]))

    return Task(apart, 6.0 * LARGEST)
