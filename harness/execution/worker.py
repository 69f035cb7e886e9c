"""One run in two processes: one makes, asks and solves and hands over arrays; the other, which never loaded the
solver's code if that is a plugin's, measures and judges them. Whatever a solver raises becomes a record.
"""

import contextlib
import dataclasses
import math
import sys
import time
import traceback
from typing import Any

import numpy as np
import scipy.linalg  # here what mechanics imports late: no run pays for it
import scipy.sparse.linalg
import scipy.spatial.transform  # noqa: F401

from ..catalogue import registry
from ..clock import cpu_seconds_of_tree
from ..files import exact
from ..mechanics.motion import constraint_rate
from ..mechanics.state import States
from ..results import store
from ..results.records import RunRecord
from ..sandbox.isolation import DISK_FULL
from ..sandbox.spool import FileSpool, kept
from ..types import EndedBy, Problem, Solver, Status, StepControl, Trajectory
from . import handed
from .contract import checked, raised_at, refusal, repeated_cost, split_cost
from .handed import BadHandover, Handed, Said
from .job import Job, cut_short, record_of
from .measuring import Keep, judged
from .presented import Presented, presented

SOFT = 0.9  # of the limit on CPU time: there a solver is asked to stop itself and to hand back what it has

FIRST = "repeats after the first took less than half its CPU time, as if prepared by it: the first alone counts"


def run(job: Job) -> RunRecord:
    """Run ``job`` in this process and store its record."""
    hand_over(job)
    return store_measured(job, cut_short(job, EndedBy.EXIT))


def hand_over(job: Job, soft: float = SOFT) -> None:
    """Solve, and write what came of it to ``job.handed``. The solver is asked to stop at ``soft`` of its limit."""
    made: list[Solver] = []
    job.handed.remove_file(missing_ok=True)
    try:
        said, trajectory = _attempt(job, soft, made)
        handed.write(job.handed, said, trajectory)
        return
    except Exception as error:  # the run's own failure, kept as its result
        if isinstance(error, OSError) and error.errno in DISK_FULL:
            raise
        if not isinstance(error, MemoryError):
            traceback.print_exc()
            sys.stderr.flush()
        memory = isinstance(error, MemoryError) or "bad_alloc" in str(error)
        by = EndedBy.MEMORY_LIMIT if memory else EndedBy.EXCEPTION
        said = Said(by=by, message=_words(error) + "".join(raised_at(error, s) for s in made))
    handed.write(job.handed, said)  # here the frames that filled the memory are gone


def store_measured(job: Job, bare: RunRecord, waited: float = 0.0, spent: float = math.inf) -> RunRecord:
    """``measured``, and stored; until here the run took ``waited`` [s], and ``spent`` [s] of CPU."""
    began = time.monotonic()
    record = measured(job, bare, spent=spent)
    record = dataclasses.replace(record, wall_s=waited + time.monotonic() - began)
    store.write_record(job.folder, record)
    for rest in (job.handed, job.spool):
        rest.remove_file(missing_ok=True)
    return record


def measured(job: Job, bare: RunRecord, keep: Keep | None = None, spent: float = math.inf) -> RunRecord:
    """The record of what was handed over, or of the steps kept until then.

    ``bare`` says how the solver's process ended, ``spent`` [s] how much CPU time it took.
    """
    try:
        if not registry.is_own_problem(job.spec.problem):  # a plugin's problem has to be made here too: docs/trust.md
            for plugin in job.plugins:
                registry.load_plugin(plugin)
        problem = registry.make_problem(job.spec.problem, job.spec.parameters)
        bare = dataclasses.replace(bare, section=problem.section, t_end_s=problem.t_end)
        found = _found(job, problem, spent)
        if found is None:
            return _salvaged(job, problem, bare, keep)
        about: dict[str, Any] = {"peak_memory_MB": bare.peak_memory_MB, "cpu_process_s": bare.cpu_process_s}
        if found.said.claimed is None:
            failed = cut_short(job, found.said.by, message=found.said.message, **found.columns, **about)
            known = dataclasses.replace(failed, section=problem.section, t_end_s=problem.t_end)
            return _salvaged(job, problem, known, keep)
        if bare.ended_by == EndedBy.SUSPENDED and found.said.claimed is Status.STALLED:
            about["ended_by"] = bare.ended_by  # its limit passed while nothing ran
        return recorded(job, problem, found, keep, spent, **about)
    except Exception as error:
        if isinstance(error, OSError) and error.errno in DISK_FULL:
            raise
        traceback.print_exc()
        return dataclasses.replace(
            bare, status=str(Status.CRASHED), ended_by=str(EndedBy.EXCEPTION), message=_words(error)
        )


def recorded(
    job: Job, problem: Problem, found: Handed, keep: Keep | None = None, spent: float = math.inf, **about: Any
) -> RunRecord:
    """The record of what a solver returned, measured and judged here; ``spent`` [s] of CPU in all, if known."""
    known = {**found.columns, **about}
    if found.trajectory is None:
        said = {"claimed": str(found.said.claimed), "ended_by": str(EndedBy.SOLVER), "message": found.said.message}
        return record_of(job, Status.REFUSED, section=problem.section, t_end_s=problem.t_end, **said, **known)
    began = time.monotonic()
    record = judged(job, problem, found.trajectory, keep, spent=spent, **known)
    return dataclasses.replace(record, measure_s=time.monotonic() - began)


def _found(job: Job, problem: Problem, spent: float) -> Handed | None:
    try:
        return handed.read(job.handed, problem.system, spent)
    except BadHandover as error:
        return Handed(Said(by=EndedBy.EXCEPTION, message=str(error)), None)


def _salvaged(job: Job, problem: Problem, bare: RunRecord, keep: Keep | None) -> RunRecord:
    """``bare``, the record of a run cut short, with the metrics and series of the steps it had kept, if it had any."""
    trajectory = kept(job.spool, problem, Status(bare.status), bare.message)
    if trajectory is None:
        return bare
    names = ("claimed", "ended_by", "ended_limit_s", "exit_code", "signal", "setup_s", "cpu_min_s", "cpu_median_s",
             "cpu_max_s", "cpu_call_s", "cpu_process_s", "wall_s", "peak_memory_MB", "paper_label",
             "declared_order")  # fmt: skip
    return judged(job, problem, trajectory, keep, **{name: getattr(bare, name) for name in names})


def _attempt(job: Job, soft: float, made: list[Solver]) -> tuple[Said, Trajectory | None]:
    for plugin in job.plugins:
        registry.load_plugin(plugin)
    spec = job.spec
    problem = registry.make_problem(spec.problem, spec.parameters)
    limit = None if math.isinf(spec.cpu_limit) else soft * spec.cpu_limit
    control = dataclasses.replace(spec.control, cpu_limit=limit, spool=FileSpool(job.spool))
    made.append(solver := registry.make_solver(spec.solver, spec.options))
    return solve(problem, solver, control, spec.repeats)


def solve(problem: Problem, solver: Solver, control: StepControl, repeats: int = 1) -> tuple[Said, Trajectory | None]:
    """Ask the solver, solve; no trajectory where it refuses."""
    began = cpu_seconds_of_tree()
    called = presented(solver, problem)
    label, order = registry.read_declaration(solver)
    about: dict[str, Any] = {"paper_label": label, "declared_order": exact(order)}
    reason = refusal(called, problem, control)
    before = {
        "cpu_import_s": registry.import_seconds(getattr(type(solver), "name", "")),
        "cpu_refuses_s": cpu_seconds_of_tree() - began,
    }
    if reason:
        return Said(claimed=Status.REFUSED, message=reason, cost=_exact(before), **about), None
    trajectory, cost = solve_repeatedly(called, problem, control, repeats)
    cost["setup_s"] += sum(before.values())
    if cost.pop("left_out"):
        trajectory = dataclasses.replace(trajectory, notes=(*trajectory.notes, FIRST))
    if problem.literal_start:
        phi_dot = float(np.max(np.abs(constraint_rate(problem.system, States.one(problem.initial))), initial=0.0))
        words = f"literal start: max |phi_dot| = {phi_dot:.3g} at t = 0, not made consistent"
        trajectory = dataclasses.replace(trajectory, notes=(*trajectory.notes, words))
    return Said(claimed=trajectory.status, cost=_exact({**cost, **before}), **about), trajectory


def _exact(cost: dict[str, float]) -> dict[str, float | str]:
    return {k: exact(v) for k, v in cost.items()}


def solve_repeatedly(
    solver: Solver | Presented, problem: Problem, control: StepControl, repeats: int
) -> tuple[Trajectory, dict[str, float]]:
    """The first trajectory and the cost columns. Repeats stop when the next would pass the limit on CPU time.

    The first one counts. Later ones that take less than half of its time were prepared by it, and do not.
    """
    began = cpu_seconds_of_tree()
    first, (spent, set_up) = _timed(solver, problem, control)
    control = dataclasses.replace(control, spool=None)
    times = [spent]
    longest = cpu_seconds_of_tree() - began
    while len(times) < repeats and first.status is Status.SUCCESS:
        if control.cpu_limit is not None and cpu_seconds_of_tree() - began + longest > control.cpu_limit:
            break
        times.append(_timed(solver, problem, control)[1][0])
    counted = repeated_cost(times)
    cpu = {"cpu_min_s": min(counted), "cpu_median_s": float(np.median(counted)), "cpu_max_s": max(counted)}
    return first, {
        "repeats": len(counted), **cpu, "cpu_call_s": spent + set_up, "setup_s": set_up,
        "cpu_inside_s": cpu_seconds_of_tree(), "left_out": len(times) - len(counted),
    }  # fmt: skip


def _timed(
    solver: Solver | Presented, problem: Problem, control: StepControl
) -> tuple[Trajectory, tuple[float, float]]:
    """A trajectory, and the CPU time of its integration and of the rest of the call, of all that took part."""
    before, began = cpu_seconds_of_tree(), time.monotonic()
    found = solver.solve(problem, control)
    spent, wall = cpu_seconds_of_tree() - before, time.monotonic() - began
    return (trajectory := checked(found, solver, problem)), split_cost(trajectory, spent, wall, solver)


def _words(error: BaseException) -> str:
    with contextlib.suppress(Exception):  # str() of a foreign exception may itself raise
        return f"{type(error).__name__}: {error}".strip(": ").split("\n")[0][:500]
    return type(error).__name__
