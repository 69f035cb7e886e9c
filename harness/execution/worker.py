"""One run, in this process: make, ask, solve, measure, write. Whatever a solver raises becomes a record."""

import contextlib
import dataclasses
import math
import resource
import sys
import time
import traceback
from collections.abc import Callable
from typing import Any

import numpy as np

from ..catalogue import registry
from ..mechanics.motion import constraint_rate
from ..mechanics.state import States
from ..results import store
from ..results.records import RunRecord
from ..sandbox.isolation import DISK_FULL
from ..sandbox.spool import FileSpool, kept
from ..types import EndedBy, Problem, Solver, Status, StepControl, Trajectory
from .job import Job, cut_short, record_of
from .measuring import Keep, judged
from .presented import Presented, presented

SOFT = 0.9  # of the wall limit: there a solver is asked to stop itself and to hand back what it has
MEASURING = "measuring"  # what is sent when the solver is done


def run(job: Job, send: Callable[[str], None] = lambda line: None) -> RunRecord:
    """Run ``job`` and store its record."""
    record = solved(job, send)
    store.write_record(job.folder, record)
    job.spool.unlink(missing_ok=True)
    return record


def solved(job: Job, send: Callable[[str], None], keep: Keep | None = None, soft: float = SOFT) -> RunRecord:
    """Run ``job``; ``keep`` writes the series. ``MEASURING`` is sent when the solver is done.

    The solver is asked to stop at ``soft`` of the wall limit.
    """
    began = time.monotonic()
    known: dict[str, Any] = {}
    failed: dict[str, Any] = {}
    try:
        record = _attempt(job, send, keep, soft, known)
    except Exception as error:  # the run's own failure, kept as its result
        if isinstance(error, OSError) and error.errno in DISK_FULL:
            raise
        if not isinstance(error, MemoryError):
            traceback.print_exc()
            sys.stderr.flush()
        memory = isinstance(error, MemoryError) or "bad_alloc" in str(error)
        by = EndedBy.MEMORY_LIMIT if memory else EndedBy.EXCEPTION
        failed = {"by": by, "message": _words(error)}
    if failed:  # here the frames that filled the memory are gone
        send(MEASURING)
        record = salvaged(job, cut_short(job, **failed, **known), keep)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)
    return dataclasses.replace(record, peak_memory_MB=peak, wall_s=time.monotonic() - began)


def salvaged(job: Job, bare: RunRecord, keep: Keep | None = None) -> RunRecord:
    """``bare``, the record of a run cut short, with the metrics and series of the steps it had kept, if it had any."""
    try:
        problem = registry.make_problem(job.spec.problem, job.spec.parameters)
        trajectory = kept(job.spool, problem, Status(bare.status), bare.message)
        if trajectory is None:
            return bare
        names = ("claimed", "ended_by", "ended_limit_s", "exit_code", "signal", "setup_s", "cpu_min_s", "cpu_median_s",
                 "cpu_max_s", "wall_s", "peak_memory_MB")  # fmt: skip
        return judged(job, problem, trajectory, keep, **{name: getattr(bare, name) for name in names})
    except Exception as error:  # the bare record says all that must be said
        if isinstance(error, OSError) and error.errno in DISK_FULL:
            raise
        traceback.print_exc()
        return bare


def _attempt(job: Job, send: Callable[[str], None], keep: Keep | None, soft: float, known: dict[str, Any]) -> RunRecord:
    for plugin in job.plugins:
        registry.load_plugin(plugin)
    spec = job.spec
    problem = registry.make_problem(spec.problem, spec.parameters)
    known.update(section=problem.section, t_end_s=problem.t_end)
    limit = None if math.isinf(spec.wall_limit) else soft * spec.wall_limit
    control = dataclasses.replace(spec.control, wall_limit=limit, spool=FileSpool(job.spool))
    return attempt(job, problem, registry.make_solver(spec.solver, spec.options), control, known, send, keep)


def attempt(
    job: Job, problem: Problem, solver: Solver, control: StepControl, known: dict[str, Any],
    send: Callable[[str], None], keep: Keep | None,
) -> RunRecord:  # fmt: skip
    """Ask the solver, solve, measure. ``known`` takes the columns known so far, for a run that ends in an exception."""
    called = presented(solver, problem)
    reason = called.refuses(problem, control)
    if reason:
        said = {"claimed": str(Status.REFUSED), "ended_by": str(EndedBy.SOLVER), "message": reason}
        return record_of(job, Status.REFUSED, **said, **known)
    trajectory, cost = solve_repeatedly(called, problem, control, job.spec.repeats)
    known.update(claimed=str(trajectory.status), **cost)
    if problem.literal_start:
        phi_dot = float(np.max(np.abs(constraint_rate(problem.system, States.one(problem.initial))), initial=0.0))
        words = f"literal start: max |phi_dot| = {phi_dot:.3g} at t = 0, not made consistent"
        trajectory = dataclasses.replace(trajectory, notes=(*trajectory.notes, words))
    send(MEASURING)
    began = time.monotonic()
    record = judged(job, problem, trajectory, keep, **cost)
    return dataclasses.replace(record, measure_s=time.monotonic() - began)


def solve_repeatedly(
    solver: Solver | Presented, problem: Problem, control: StepControl, repeats: int
) -> tuple[Trajectory, dict[str, Any]]:
    """The first trajectory and the cost columns. Repeats stop when the next would pass the wall limit."""
    began = time.monotonic()
    first, spent = _timed(solver, problem, control)
    control = dataclasses.replace(control, spool=None)
    times = [spent]
    longest = time.monotonic() - began
    while len(times) < repeats and first.status is Status.SUCCESS:
        if control.wall_limit is not None and time.monotonic() - began + longest > control.wall_limit:
            break
        times.append(_timed(solver, problem, control)[1])
    cpu = {"cpu_min_s": min(times), "cpu_median_s": float(np.median(times)), "cpu_max_s": max(times)}
    return first, {"repeats": len(times), **cpu, "setup_s": float(first.setup_time)}


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


def _words(error: BaseException) -> str:
    with contextlib.suppress(Exception):  # str() of a foreign exception may itself raise
        return f"{type(error).__name__}: {error}".strip(": ").split("\n")[0][:500]
    return type(error).__name__
