"""From what a solver handed over to a record and a series file: the step of a run that follows the solve."""

import dataclasses
import math
import time
import traceback
from dataclasses import dataclass
from typing import Any

from ..catalogue import registry
from ..files import FileError
from ..metrics.measure import Measured, measure
from ..metrics.summary import columns
from ..metrics.verdict import doubts, inaccuracy
from ..places import Place
from ..results.records import RunRecord, reasons_json
from ..results.series import name_file, write_series
from ..sandbox.isolation import is_full
from ..sandbox.spool import read_spool
from ..types import EndedBy, Problem, Reason, Status, Trajectory
from .handover import Handover, SolverReport, read
from .job import Job, cut_short, first_line, record_of
from .kept_series import series_of

USED = 0.5  # of the limit on CPU time: who says that it ended him has used as much, and was asked to stop at 0.9


@dataclass(frozen=True)
class Outcome:
    """Outcome of a run: its record and, where it has a motion, the motion and its measurements."""

    record: RunRecord
    problem: Problem | None = None
    trajectory: Trajectory | None = None
    measured: Measured | None = None


def measure_run(job: Job, bare: RunRecord, problem: Problem | None = None, spent: float = math.inf) -> Outcome:
    """Measure and judge what the solver handed over, or the steps that were kept until it ended.

    ``bare`` says how the solver's process ended, ``spent`` [s] how much CPU time it took.
    """
    try:
        if problem is None:
            problem = make_problem(job)
        bare = dataclasses.replace(bare, section=problem.section, t_end_s=problem.t_end)
        handover = _read_handover(job, problem, spent)
        if handover is None:
            return _salvage(job, problem, bare)
        about: dict[str, Any] = {"peak_memory_MB": bare.peak_memory_MB, "cpu_process_s": bare.cpu_process_s}
        if not math.isnan(bare.code_s):  # its parent's meter goes before the solver's own words
            about["code_s"] = bare.code_s
        if handover.report.claimed is None:
            known = {**handover.columns, **about}
            failed = cut_short(job, handover.report.by, message=handover.report.message, **known)
            return _salvage(job, problem, dataclasses.replace(failed, section=problem.section, t_end_s=problem.t_end))
        if bare.ended_by == EndedBy.SUSPENDED and handover.report.claimed is Status.STALLED:
            about["ended_by"] = bare.ended_by  # its limit passed while nothing ran
        return judge_handover(job, problem, handover, spent, **about)
    except Exception as error:
        if is_full(error):
            raise
        traceback.print_exc()
        by, message = str(EndedBy.EXCEPTION), first_line(error)
        return Outcome(dataclasses.replace(bare, status=str(Status.CRASHED), ended_by=by, message=message))


def make_problem(job: Job) -> Problem:
    """The problem of a run; one of a plugin is made by the plugin, here too (docs/trust.md)."""
    if not registry.is_own_problem(job.spec.problem):
        for plugin in job.plugins:
            registry.load_plugin(plugin)
    return registry.make_problem(job.spec.problem, job.spec.parameters)


def _read_handover(job: Job, problem: Problem, spent: float) -> Handover | None:
    try:
        return read(job.handover, problem.system, spent)
    except FileError as error:
        return Handover(SolverReport(by=EndedBy.EXCEPTION, message=str(error)), None)


def judge_handover(job: Job, problem: Problem, handover: Handover, spent: float = math.inf, **about: Any) -> Outcome:
    """Measure and judge what a solver returned; ``spent`` [s] of CPU in all, if known."""
    known = {**handover.columns, **about}
    if handover.trajectory is None:
        said = {
            "claimed": str(handover.report.claimed),
            "ended_by": str(EndedBy.SOLVER),
            "message": handover.report.message,
            "missing_package": handover.report.missing_package,
        }
        record = record_of(job, Status.REFUSED, section=problem.section, t_end_s=problem.t_end, **said, **known)
        return Outcome(record, problem)
    began = time.monotonic()
    record, measured = judge_motion(job, problem, handover.trajectory, spent=spent, **known)
    record = dataclasses.replace(record, measure_s=time.monotonic() - began)
    return Outcome(record, problem, handover.trajectory, measured)


def _salvage(job: Job, problem: Problem, bare: RunRecord) -> Outcome:
    """``bare``, the record of a run cut short, with the metrics of the steps it had kept, if it had any."""
    trajectory = read_spool(job.spool, problem, Status(bare.status), bare.message)
    if trajectory is None:
        return Outcome(bare, problem)
    names = ("claimed", "ended_by", "ended_limit_s", "exit_code", "signal", "setup_s", "cpu_min_s", "cpu_q1_s",
             "cpu_median_s", "cpu_q3_s", "cpu_max_s", "cpu_call_s", "code_s", "cpu_process_s", "wall_s",
             "peak_memory_MB", "paper_label", "declared_order")  # fmt: skip
    record, measured = judge_motion(job, problem, trajectory, **{name: getattr(bare, name) for name in names})
    return Outcome(record, problem, trajectory, measured)


def judge_motion(
    job: Job, problem: Problem, trajectory: Trajectory, *, spent: float = 0.0, **known: Any
) -> tuple[RunRecord, Measured]:
    """Measure and judge a motion.

    A solver that stopped before its limit on steps, having used up its CPU time (``spent`` [s]), did not finish here;
    ``spent`` holds the time of making code, which no limit counts.
    """
    measured = measure(problem, trajectory)
    numbers = columns(problem, trajectory, measured)
    status, because = Status(trajectory.status), list[Reason]()
    if status is Status.SUCCESS:
        because = doubts(problem, trajectory, measured, numbers)
        status = Status.WRONG if because else status
    if status is Status.SUCCESS and (because := inaccuracy(measured, numbers)):
        status = Status.INACCURATE
    by = EndedBy.SOLVER
    limit, steps_left = job.spec.cpu_limit, len(trajectory.t) <= job.spec.control.max_steps
    used = spent - float(known.get("code_s", 0.0))
    if status is Status.STALLED and steps_left and math.isfinite(limit) and used >= USED * limit:
        status, by = Status.UNFINISHED, EndedBy.CPU_LIMIT
    said = {"claimed": str(trajectory.status), "ended_by": str(by), "message": str(trajectory.message)}
    found = {"section": problem.section, "t_end_s": problem.t_end, "wrong_because": reasons_json(because)}
    return record_of(job, status, **{**said, **found, **numbers, **known}), measured


def write_outcome(job: Job, outcome: Outcome) -> RunRecord:
    """Write the series of a motion into the results folder; the record with its place."""
    if outcome.problem is None or outcome.trajectory is None or outcome.measured is None:
        return outcome.record
    series = series_of(outcome.problem, outcome.trajectory, outcome.measured, lossless=job.lossless, keep=job.keep)
    place = name_file(job.id, brief=series.is_brief)
    digest = write_series(Place(job.folder) / place, series)
    return dataclasses.replace(outcome.record, series=place, series_sha256=digest, series_rows=len(series["t"]))
