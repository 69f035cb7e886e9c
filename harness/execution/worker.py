"""One run in a process of its own: make, ask, solve, measure, write. Whatever a solver raises becomes a record.

``mbsbench.worker JOB.json`` runs one in a fresh interpreter; ``harness.supervisor`` forks one a run.
"""

import contextlib
import dataclasses
import math
import resource
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..catalogue import registry
from ..results import store
from ..results.records import RunRecord
from ..sandbox.isolation import DISK_FULL
from ..sandbox.spool import FileSpool, kept
from ..types import EndedBy, Problem, Solver, Status, StepControl, Trajectory
from .job import Job, record_of
from .measuring import judged
from .presented import Presented, presented

SOFT = 0.9  # of the wall limit: there a solver is asked to stop itself and to hand back what it has


def run(job: Job, tell: Callable[[str], None] = lambda phase: None) -> RunRecord:
    """Run ``job`` and store its record. ``tell`` is called with ``"measure"`` when the solver is done."""
    began = time.monotonic()
    columns: dict[str, Any] = {}
    record, failed = None, (Status.CRASHED, EndedBy.EXCEPTION, "")
    try:
        record = _attempt(job, tell, columns)
    except MemoryError as error:
        failed = Status.MEMORY, EndedBy.MEMORY_LIMIT, _words(error)
    except Exception as error:  # the run's own failure, kept as its result
        if isinstance(error, OSError) and error.errno in DISK_FULL:
            raise
        traceback.print_exc()
        sys.stderr.flush()
        if "bad_alloc" in str(error):
            failed = Status.MEMORY, EndedBy.MEMORY_LIMIT, _words(error)
        else:
            failed = Status.CRASHED, EndedBy.EXCEPTION, _words(error)
    if record is None:  # here the frames that filled the memory are gone
        tell("measure")
        status, by, message = failed
        record = salvaged(job, record_of(job, status, ended_by=str(by), message=message, **columns))
    record = _with_cost(record, wall_s=time.monotonic() - began)
    store.write_record(job.folder, record)
    job.spool.unlink(missing_ok=True)
    return record


def salvaged(job: Job, bare: RunRecord) -> RunRecord:
    """``bare``, the record of a run cut short, with the metrics and series of the steps it had kept, if it had any."""
    try:
        problem = registry.make_problem(job.spec.problem, job.spec.parameters)
        trajectory = kept(job.spool, problem, Status(bare.status), bare.message)
        if trajectory is None:
            return bare
        known = {"setup_s", "cpu_min_s", "cpu_median_s", "cpu_max_s", "exit_code", "signal", "wall_s", "peak_memory_MB",
                 "claimed", "ended_by", "ended_limit_s"}  # fmt: skip
        record = judged(job, problem, trajectory)
        return dataclasses.replace(record, **{name: getattr(bare, name) for name in known})
    except Exception as error:  # the bare record says all that must be said
        if isinstance(error, OSError) and error.errno in DISK_FULL:
            raise
        traceback.print_exc()
        return bare


def _attempt(job: Job, tell: Callable[[str], None], columns: dict[str, Any]) -> RunRecord:
    for plugin in job.plugins:
        registry.load_plugin(plugin)
    spec = job.spec
    problem = registry.make_problem(spec.problem, spec.parameters)
    columns.update(section=problem.section, t_end_s=problem.t_end)
    solver = presented(registry.make_solver(spec.solver, spec.options), problem)
    control = dataclasses.replace(spec.control, wall_limit=SOFT * spec.wall_limit, spool=FileSpool(job.spool))
    reason = solver.refuses(problem, control)
    if reason:
        return record_of(
            job, Status.REFUSED, claimed=str(Status.REFUSED), ended_by=str(EndedBy.SOLVER), message=reason, **columns
        )
    trajectory, cost = solve_repeatedly(solver, problem, control, spec.repeats)
    columns.update(claimed=str(trajectory.status), **cost)
    tell("measure")
    began = time.monotonic()
    record = judged(job, problem, trajectory, **cost)
    return _with_cost(record, measure_s=time.monotonic() - began)


def solve_repeatedly(
    solver: Solver | Presented, problem: Problem, control: StepControl, repeats: int
) -> tuple[Trajectory, dict[str, Any]]:
    """The first trajectory and the cost columns. Repeats stop when the next would pass the wall limit."""
    began = time.monotonic()
    first, cpu = _timed(solver, problem, control)
    control = dataclasses.replace(control, spool=None)
    times = [cpu]
    longest = time.monotonic() - began
    while len(times) < repeats and first.status is Status.SUCCESS:
        if control.wall_limit is not None and time.monotonic() - began + longest > control.wall_limit:
            break
        times.append(_timed(solver, problem, control)[1])
    cost = {
        "repeats": len(times),
        "cpu_min_s": float(np.min(times)),
        "cpu_median_s": float(np.median(times)),
        "cpu_max_s": float(np.max(times)),
        "setup_s": float(first.setup_time),
    }
    return first, cost


def _timed(solver: Solver | Presented, problem: Problem, control: StepControl) -> tuple[Trajectory, float]:
    """A trajectory and its CPU time: the solver's own figure if it has one, else that of the whole call."""
    began = time.process_time()
    trajectory = solver.solve(problem, control)
    spent = time.process_time() - began
    if not isinstance(trajectory, Trajectory):
        raise TypeError(f"solve must return a Trajectory (got {type(trajectory).__name__})")
    if trajectory.states.nb != problem.system.nb:
        raise ValueError(f"solve must return {problem.system.nb} bodies (got {trajectory.states.nb})")
    own = float(trajectory.cpu_time)
    return trajectory, spent if math.isnan(own) else own


def peak_memory() -> float:
    """Largest resident memory of this process so far [MB], libraries included."""
    kilobytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return kilobytes / (2**20 if sys.platform == "darwin" else 2**10)


def _with_cost(record: RunRecord, **columns: float) -> RunRecord:
    return dataclasses.replace(record, peak_memory_MB=peak_memory(), **columns)  # type: ignore[arg-type]


def _words(error: BaseException) -> str:
    with contextlib.suppress(Exception):  # str() of a foreign exception may itself raise
        return f"{type(error).__name__}: {error}".strip(": ").split("\n")[0][:500]
    return type(error).__name__


if __name__ == "__main__":
    run(Job.from_json(Path(sys.argv[1]).read_text(encoding="utf-8")))
