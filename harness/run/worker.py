"""Perform the solver's side of a run: create the solver, let it refuse or solve, time it. Exceptions become results."""

import dataclasses
import math
import sys
import time
import traceback
from typing import Any

import numpy as np
import scipy.linalg  # mechanics imports these late; imported here, no run is charged for them
import scipy.sparse.linalg
import scipy.spatial.transform  # noqa: F401  before a solver is timed

from ..base.clock import cpu_seconds, cpu_seconds_of_others, cpu_seconds_of_tree
from ..base.code_meter import code_seconds_of_tree, collect_garbage, listen_to_numba, solver_seconds
from ..base.files import encode_nonfinite
from ..base.isolation import is_disk_full_error
from ..catalogue import registry
from ..mechanics.motion import constraint_rate
from ..mechanics.state import States
from ..mechanics.types import EndCause, NotInstalled, Problem, Solver, Status, StepControl, Trajectory
from . import handover
from .contract import (
    FEWEST,
    SHORT,
    Cost,
    average_loop_times,
    check_trajectory,
    find_refusal,
    locate_error,
    make_cost_columns,
    select_repeat_times,
    split_cost,
)
from .handover import Handover, SolverReport
from .job import Job, format_first_line
from .presenting import PresentedSolver, present_solver
from .spool import FileSpool

SOFT = 0.9  # fraction of the limit on CPU time at which a solver is asked to stop and return what it has

MOST = 1000  # solves of a loop at most: their median is known to 4 % of a standard deviation
WAITED = 5.0  # largest ratio of wall time to CPU time of a loop: a solver may wait for other processes
READINGS = 1000  # readings of the clock by which one is timed

# note of a run whose repeats are not counted
FIRST = "repeats after the first took less than half its CPU time, as if prepared by it: the first alone counts"


def solve_job(job: Job, soft: float = SOFT, problem: Problem | None = None) -> None:
    """Solve the job and write the outcome to ``job.handover``: a motion, a refusal, or the exception that was raised.

    The solver is asked to stop at the fraction ``soft`` of its limit on CPU time. ``problem`` is that of the job, if it
    exists already. The traceback of an exception goes to standard error. Raise OSError on a full disk, which is no
    result of the run.
    """
    made: list[Solver] = []
    job.handover.remove_file(missing_ok=True)
    try:
        handover.write_handover(job.handover, _attempt_solve(job, soft, made, problem))
        return
    except (Exception, SystemExit, KeyboardInterrupt) as error:  # the failure of the run is its result
        if is_disk_full_error(error):
            raise
        if not isinstance(error, MemoryError):
            traceback.print_exc()
            sys.stderr.flush()
        memory = isinstance(error, MemoryError) or "bad_alloc" in str(error)
        by = EndCause.MEMORY_LIMIT if memory else EndCause.EXCEPTION
        message = format_first_line(error) + "".join(locate_error(error, s) for s in made)
    report = SolverReport(by=by, message=message)  # the frames that filled the memory are released by now
    handover.write_handover(job.handover, Handover(report, None))


def _attempt_solve(job: Job, soft: float, made: list[Solver], problem: Problem | None) -> Handover:
    """Load plugins, create the solver and, unless given, the problem of a job, and solve; return the outcome.

    The solver is also appended to ``made``, which the caller needs for its message if solving raises. It is asked to
    stop at the fraction ``soft`` of its limit on CPU time.
    """
    listen_to_numba()
    for plugin in job.plugins:
        registry.load_plugin(plugin)
    spec = job.spec
    problem = problem or registry.make_problem(spec.problem, spec.parameters)
    limit = None if math.isinf(spec.cpu_limit) else soft * spec.cpu_limit
    control = dataclasses.replace(spec.control, cpu_limit=limit, spool=FileSpool(job.spool))
    made.append(solver := registry.make_solver(spec.solver, spec.options))
    return solve(problem, solver, control, spec.repeats, spec.min_time)


def solve(problem: Problem, solver: Solver, control: StepControl, repeats: int = 1, min_time: float = 0.0) -> Handover:
    """Let the solver refuse or solve the problem; return its report and, unless it refused, its motion.

    The first solve gives the motion. To measure the CPU time, the problem is solved ``repeats`` times in all; a solve
    shorter than ``SHORT`` is repeated for ``min_time`` [s].
    """
    listen_to_numba()  # before any reading of the clock: it may import numba
    began, code_began = cpu_seconds_of_tree(), code_seconds_of_tree()
    called = present_solver(solver, problem)
    label, order = registry.read_declaration(solver)
    about: dict[str, Any] = {"paper_label": label, "declared_order": encode_nonfinite(order)}
    reason = find_refusal(called, problem, control)
    imported, code = registry.import_seconds(getattr(type(solver), "name", ""))
    in_refuses = code_seconds_of_tree() - code_began
    asked = max(cpu_seconds_of_tree() - began - in_refuses, 0.0)
    before = {"cpu_import_s": imported, "cpu_refuses_s": asked}
    code += in_refuses
    if reason:
        about["missing_package"] = reason.package if isinstance(reason, NotInstalled) else ""
        cost = {**before, "code_s": min(code, code_seconds_of_tree())}
        return Handover(
            SolverReport(claimed=Status.REFUSED, message=str(reason), cost=_format_costs(cost), **about), None
        )
    collect_garbage()  # imports and ``refuses`` of plugins must not affect the timing
    trajectory, cost = solve_repeatedly(called, problem, control, repeats, min_time)
    cost["setup_s"] += sum(before.values()) + code
    # a fork inherits the modules that its parent has imported
    cost["code_s"] = min(cost["code_s"] + code, code_seconds_of_tree())
    if cost.pop("left_out"):
        trajectory = dataclasses.replace(trajectory, notes=(*trajectory.notes, FIRST))
    if problem.literal_start:
        phi_dot = float(np.max(np.abs(constraint_rate(problem.system, States.one(problem.initial))), initial=0.0))
        words = f"literal start: max |phi_dot| = {phi_dot:.3g} at t = 0, not made consistent"
        trajectory = dataclasses.replace(trajectory, notes=(*trajectory.notes, words))
    return Handover(
        SolverReport(claimed=trajectory.status, cost=_format_costs({**cost, **before}), **about), trajectory
    )


def _format_costs(cost: dict[str, float]) -> dict[str, float | str]:
    """Return costs by name with NaN and infinity as texts, which JSON can hold."""
    return {k: encode_nonfinite(v) for k, v in cost.items()}


def solve_repeatedly(
    solver: Solver | PresentedSolver, problem: Problem, control: StepControl, repeats: int, min_time: float = 0.0
) -> tuple[Trajectory, dict[str, float]]:
    """Return the first trajectory and the cost columns, with ``left_out``: whether only the first of several counts.

    The problem is solved ``repeats`` times, as long as solves succeed and another fits into the limit on CPU time. If
    integration takes less than ``SHORT``, it is solved until all calls together have taken ``min_time`` [s], which
    includes code that engines generate in each call. The times that count are then those of ``average_loop_times``,
    otherwise those of ``select_repeat_times``. Code generation of the first call counts in ``code_s`` and ``setup_s``
    only.
    """
    listen_to_numba()
    first, cost = _solve_timed(solver, problem, control)
    control = dataclasses.replace(control, spool=None)
    times, longest = [cost.integration], cost.call
    used, began, cpu_began = longest, time.monotonic(), cpu_seconds() - longest
    loops = min_time > 0.0 and cost.integration < SHORT
    fewest = max(repeats, 1 + FEWEST) if loops else repeats
    while first.status is Status.SUCCESS:
        over = cpu_seconds() - cpu_began >= min_time or time.monotonic() - began >= WAITED * min_time
        if len(times) >= fewest and (not loops or over or len(times) >= MOST):
            break
        if control.cpu_limit is not None and used + longest > control.cpu_limit:
            break
        times.append((again := _solve_timed(solver, problem, control)[1]).integration)
        used += again.call
    looped = loops and len(times) > FEWEST
    counted = average_loop_times(times, solver, _measure_reading_time()) if looped else select_repeat_times(times)
    alone = len(counted) == 1 < len(times)
    return first, {
        **make_cost_columns(counted, 1 if alone else len(times) - looped),
        "cpu_call_s": cost.call,
        "setup_s": cost.set_up,
        "code_s": cost.code,
        "cpu_inside_s": cpu_seconds_of_tree(),
        "left_out": alone,
    }


def _measure_reading_time() -> float:
    """Measure the CPU time [s] of one reading of the solvers' clock, which the difference of two readings includes."""
    began = cpu_seconds()
    for _ in range(READINGS):
        solver_seconds()
    return (cpu_seconds() - began) / READINGS


def _solve_timed(solver: Solver | PresentedSolver, problem: Problem, control: StepControl) -> tuple[Trajectory, Cost]:
    """Solve once; return the checked trajectory and the cost of the call in all processes that took part."""
    others, code, began, before = cpu_seconds_of_others(), code_seconds_of_tree(), time.monotonic(), cpu_seconds()
    found = solver.solve(problem, control)
    spent, wall = cpu_seconds() - before, time.monotonic() - began
    code, spent = code_seconds_of_tree() - code, spent + cpu_seconds_of_others() - others
    return (trajectory := check_trajectory(found, solver, problem)), split_cost(trajectory, spent, code, wall, solver)
