"""Prepare runs before the clock starts: compute references that are not cached, and compile kernels.

Each solver takes a few steps of one of its runs, whose result is discarded. This happens first in a forked process,
which fills the compiler's cache on disk and may crash; if that succeeds, then in the parent of all runs, so that every
fork finds the compiled code in memory. Plugins are never run in the parent.
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

from ..base.code_meter import CODE_LIMIT
from ..base.forked_process import TICK, ForkedProcess
from ..base.naming import format_name
from ..catalogue import registry
from ..catalogue.codes import package_sources
from ..catalogue.suites.spec import RunSpec
from ..mechanics.types import Problem
from ..mechanics.types.presentations import PRESENTATIONS
from ..reference.computation import LARGEST, find_reference
from .job import Job

LIMIT = 600.0  # [s] of CPU to warm up a solver, without code generation; counted in no run
MEMORY = 4000.0  # [MB] for each task of the preparation
STEPS = 2  # steps of a warm-up run with a fixed step
ABREAST = 1 + (os.cpu_count() or 1)  # tasks in parallel: one may wait for kernels that another is compiling
SHORT = 1e-3  # [s] simulated time of a warm-up run with error control
STAND_INS = ("heavy_top", "spring_pendulum")  # in place of problems of plugins, which are not created here


def list_runs_to_warm(specs: Sequence[RunSpec], problem: Problem | None = None) -> list[RunSpec]:
    """Return the shortened runs that must be solved to compile all kernels that ``specs`` need.

    There is one for each combination of own solver, options, and with or without springs: a kernel is compiled once for
    all systems, and which kernels a run enters depends on these alone, not on the value of a tolerance, a penalty or a
    gain that is not zero. ``problem`` is used in place of creating the problem of its name again.
    """
    first: dict[str, RunSpec] = {}
    sprung: dict[str, bool] = {}
    own = [s for s in specs if registry.is_own_solver(s.solver)]
    for spec in (s for given in own for s in _list_stand_ins(given)):
        if spec.problem not in sprung:
            sprung[spec.problem] = _has_springs(spec, problem)
        t_end = SHORT if spec.control.dt is None else STEPS * spec.control.dt
        options = {k: v != 0.0 if isinstance(v, float) else v for k, v in spec.options.items()}
        # runs with equal keys enter the same kernels
        key = json.dumps([spec.solver, options, sprung[spec.problem]], sort_keys=True, default=list)
        first.setdefault(key, dataclasses.replace(spec, parameters={**spec.parameters, "t_end": t_end}))
    return _interleave_solvers(list(first.values()))


def _interleave_solvers(specs: list[RunSpec]) -> list[RunSpec]:
    """Return the specs reordered so that each solver comes once before any comes again.

    Runs of one solver with different options share kernels: if the later ones come later, they find them compiled.
    """
    counted = Counter[str]()
    turns = []
    for spec in specs:
        turns.append(counted[spec.solver])
        counted[spec.solver] += 1
    return [spec for _, spec in sorted(zip(turns, specs, strict=True), key=lambda pair: pair[0])]


def _list_stand_ins(spec: RunSpec) -> list[RunSpec]:
    """Return the run itself or, as a plugin's problem is not created here, the same run of each of ``STAND_INS``."""
    if registry.is_own_problem(spec.problem):
        return [spec]
    return [dataclasses.replace(spec, problem=name, parameters={}) for name in STAND_INS]


def _has_springs(spec: RunSpec, problem: Problem | None) -> bool:
    """Return whether a run's problem has springs; False if it cannot be created.

    ``problem`` is used, instead of creating one, if it has the name of the run's problem.
    """
    try:
        made = problem if problem and problem.name == spec.problem else None
        return len((made or registry.share_problem(spec.problem, spec.parameters)).system.spring_i) > 0
    except Exception:  # its runs will report it
        return False


def warm_up(specs: Sequence[RunSpec], made: Problem | None = None) -> dict[str, float]:
    """Solve each spec in this process, so that all code it needs is compiled and loaded here; ignore failures.

    ``made`` is a problem that exists already; specs of its name use it, with their own ``t_end``. Return the wall times
    [s] by solver, without those that failed.
    """
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
        except Exception:  # its runs will report it
            continue
        out[spec.solver] = time.monotonic() - began
    return out


def select_job_per_motion(jobs: Sequence[Job]) -> list[Job]:
    """Return the first job of each motion, as ``select_run_per_motion`` does; the others share its reference."""
    first = {spec.settings_id for spec in select_run_per_motion([job.spec for job in jobs])}
    return [job for job in jobs if job.spec.settings_id in first]


def select_run_per_motion(specs: Sequence[RunSpec]) -> list[RunSpec]:
    """Return the first run of each exact motion: of all runs whose problem and parameters are equal.

    Parameters that only present a problem in another way, and that are undone before a motion is measured, are ignored.
    """
    first: dict[str, RunSpec] = {}
    for spec in specs:
        ignored = [p.name for p in PRESENTATIONS if p.undone]
        parameters = {k: v for k, v in spec.parameters.items() if k not in ignored}
        first.setdefault(json.dumps([spec.problem, parameters], sort_keys=True, default=list), spec)
    return list(first.values())


@dataclass(frozen=True)
class Task:
    """Define a part of the preparation: ``run_forked`` runs in a forked process, then ``run_here`` in this one.

    ``run_here`` is called for each line that the forked process sent, hence not if that failed.
    """

    run_forked: Callable[[Callable[[str], None]], object]  # sends the times [s] of solvers and of references, by name
    limit: float = LIMIT  # [s]
    run_here: Callable[[], object] = lambda: None


def fill_caches(
    specs: Sequence[RunSpec],
    jobs: Sequence[Job],
    unwanted: Callable[[], bool] = lambda: False,
    report: Callable[[dict[str, float], dict[str, float]], object] = lambda times, references: None,
) -> None:
    """Compile the measuring code and solvers of ``specs``, compute references of ``jobs``, and load the code here.

    Each task runs in a forked process, ``ABREAST`` of them in parallel, which fills the caches and may crash. As each
    ends, ``report`` is called with the wall times [s] that it took, by solver and by reference. All are killed once
    ``unwanted()`` returns True. The first solver compiles kernels that all share, and references follow it, so that the
    other solvers find these compiled.
    """
    solvers, laws = [_make_compile_task(spec) for spec in specs], Task(_load_laws, run_here=_load_passes)
    waiting = [*solvers[:1], laws, *map(_make_reference_task, jobs), *solvers[1:]][::-1]
    going = dict[ForkedProcess, Task]()  # a task that hangs must not delay others
    try:
        while (waiting or going) and not unwanted():
            while waiting and len(going) < ABREAST:
                task = waiting.pop()
                going[ForkedProcess(task.run_forked, limit=task.limit, memory=MEMORY, code=CODE_LIMIT)] = task
            select.select([p.pipe for p in going if not p.closed_at], [], [], TICK)
            for process in list(going):
                if (ended := process.check_end()) is not None:
                    task = going.pop(process)
                    for line in ended.sent.splitlines():
                        report(*json.loads(line))
                        task.run_here()
    finally:
        for process in going:
            process.kill()
            process.wait()


def _make_compile_task(spec: RunSpec) -> Task:
    """Return the task that compiles a solver by solving ``spec``; a failure is left to its runs to report."""

    def work(send: Callable[[str], None]) -> None:
        """Compile the solver in a forked process, and send how long it took, unless it failed."""
        if times := warm_up([spec]):
            send(json.dumps([times, {}]))

    return Task(work, run_here=lambda: warm_up([spec]))


def _load_passes() -> None:
    """Load the compiled measuring code; imported here, so that commands that compile nothing do not import numba."""
    from ..judge.metrics import passes

    passes.load()


def _load_laws(send: Callable[[str], None]) -> None:
    """Load the compiled measuring code in a forked process, which fills the cache on disk, and send that it is done."""
    _load_passes()
    send(json.dumps([{}, {}]))


def _make_reference_task(job: Job) -> Task:
    """Return the task that computes a job's reference unless it is cached; a failure is left to the runs to report."""

    def work(send: Callable[[str], None]) -> None:
        """Compute the reference in a forked process, and send how long it took."""
        began = time.monotonic()
        with contextlib.suppress(Exception):
            for plugin in job.plugins:
                registry.load_plugin(plugin)
            find_reference(registry.make_problem(job.spec.problem, job.spec.parameters))
        name = format_name(job.spec.problem, job.spec.parameters)
        send(json.dumps([{}, {name: time.monotonic() - began}]))

    return Task(work, 6.0 * LARGEST, run_here=lambda: _hold_exact_motion(job))


def _hold_exact_motion(job: Job) -> None:
    """Evaluate the exact motion of a job's problem and hold it in this process, so that forked runs inherit it.

    Nothing is done for a problem of a plugin, whose code must not run here, and for one with user forces: a solver
    compiles these in its set-up, where it must not find them compiled.
    """
    from .kept_series import hold_exact_motion

    spec = job.spec
    if job.plugins or not registry.is_own_problem(spec.problem):
        return
    with contextlib.suppress(Exception):  # its runs will report it
        problem = registry.share_problem(spec.problem, spec.parameters)
        if not len(problem.system.user_i):
            hold_exact_motion(problem, package_sources().measuring, brief=job.keep is not None and not job.lossless)
