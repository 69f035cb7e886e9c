"""Turn the solver's output into a record and a series file: the step of a run that follows the solve."""

import dataclasses
import math
import time
import traceback
from dataclasses import dataclass
from typing import Any

from ..base.confined_paths import ConfinedPath
from ..base.files import FileError
from ..base.isolation import is_disk_full_error
from ..catalogue import registry
from ..columns.measured import MeasuredSeries
from ..judge.distance import find_inaccuracy
from ..judge.law import list_broken_laws
from ..judge.metrics.measure import measure
from ..judge.metrics.summary import make_columns
from ..mechanics.types import EndCause, Problem, Reason, Status, Trajectory
from ..results.records import RunRecord, format_reasons
from ..results.series import name_series_file, write_series
from .handover import Handover, SolverReport, read_handover
from .job import Job, format_first_line, make_cut_short_record, make_job_record
from .kept_series import build_series
from .spool import read_spool

# fraction of the CPU limit that a solver must have used to claim that this limit ended it (asked to stop at 0.9)
USED = 0.5


@dataclass(frozen=True)
class Outcome:
    """The outcome of a run: its record and, where it has a motion, the motion and its measurements."""

    record: RunRecord
    problem: Problem | None = None
    trajectory: Trajectory | None = None
    measured: MeasuredSeries | None = None


def measure_run(job: Job, bare: RunRecord, problem: Problem | None = None, spent: float = math.inf) -> Outcome:
    """Measure and judge what the solver left or, if it left nothing, the steps that it had kept; return the outcome.

    ``bare`` is a record of how the solver's process ended, ``spent`` [s] the CPU time it took. An exception, also one
    in measuring, gives the record of a crashed run; only that of a full disk is raised.
    """
    try:
        if problem is None:
            problem = make_problem(job)
        bare = dataclasses.replace(bare, section=problem.section, t_end_s=problem.t_end)
        handover = _read_handover(job, problem, spent)
        if handover is None:
            return _measure_partial(job, problem, bare)
        about: dict[str, Any] = {"peak_memory_MB": bare.peak_memory_MB, "cpu_process_s": bare.cpu_process_s}
        if not math.isnan(bare.code_s):  # the meter of its parent takes precedence over the solver's report
            about["code_s"] = bare.code_s
        if handover.report.claimed is None:
            known = {**handover.columns, **about}
            failed = make_cut_short_record(job, handover.report.by, message=handover.report.message, **known)
            return _measure_partial(
                job, problem, dataclasses.replace(failed, section=problem.section, t_end_s=problem.t_end)
            )
        if bare.ended_by == EndCause.SUSPENDED and handover.report.claimed is Status.STALLED:
            about["ended_by"] = bare.ended_by  # its limit expired while the machine was suspended
        return judge_handover(job, problem, handover, spent, **about)
    except Exception as error:  # a solver's motion or a plugin's problem may cause anything
        if is_disk_full_error(error):
            raise
        traceback.print_exc()
        by, message = str(EndCause.EXCEPTION), format_first_line(error)
        return Outcome(dataclasses.replace(bare, status=str(Status.CRASHED), ended_by=by, message=message))


def make_problem(job: Job) -> Problem:
    """Return the problem of a run; for a plugin's problem, load the job's plugins in this process (docs/trust.md)."""
    if not registry.is_own_problem(job.spec.problem):
        for plugin in job.plugins:
            registry.load_plugin(plugin)
    return registry.make_problem(job.spec.problem, job.spec.parameters)


def _read_handover(job: Job, problem: Problem, spent: float) -> Handover | None:
    """Return report and motion that the solver's process left in ``job.handover``; None without that file.

    If the file cannot be used, the report says so, as if the solver had raised an exception.
    """
    try:
        return read_handover(job.handover, problem.system, spent)
    except FileError as error:
        return Handover(SolverReport(by=EndCause.EXCEPTION, message=str(error)), None)


def judge_handover(job: Job, problem: Problem, handover: Handover, spent: float = math.inf, **about: Any) -> Outcome:
    """Measure and judge the motion that a solver returned, or record its refusal; return the outcome.

    ``spent`` is the CPU time [s] of its process; infinite if unknown. ``about`` are columns of the record that take
    precedence over the solver's report.
    """
    known = {**handover.columns, **about}
    if handover.trajectory is None:
        said = {
            "claimed": str(handover.report.claimed),
            "ended_by": str(EndCause.SOLVER),
            "message": handover.report.message,
            "missing_package": handover.report.missing_package,
        }
        record = make_job_record(job, Status.REFUSED, section=problem.section, t_end_s=problem.t_end, **said, **known)
        return Outcome(record, problem)
    began = time.monotonic()
    record, measured = judge_motion(job, problem, handover.trajectory, spent=spent, **known)
    record = dataclasses.replace(record, measure_s=time.monotonic() - began)
    return Outcome(record, problem, handover.trajectory, measured)


def _measure_partial(job: Job, problem: Problem, bare: RunRecord) -> Outcome:
    """Measure and judge the steps kept by a run that was cut short; return the outcome.

    ``bare`` is the record of how the run ended. It alone is the outcome if no steps were kept; otherwise its cause of
    the end, limits and costs go into the new record.
    """
    trajectory = read_spool(job.spool, problem, Status(bare.status), bare.message)
    if trajectory is None:
        return Outcome(bare, problem)
    names = (
        "claimed",
        "ended_by",
        "ended_limit_s",
        "exit_code",
        "signal",
        "setup_s",
        "cpu_min_s",
        "cpu_q1_s",
        "cpu_median_s",
        "cpu_q3_s",
        "cpu_max_s",
        "cpu_call_s",
        "code_s",
        "cpu_process_s",
        "wall_s",
        "peak_memory_MB",
        "paper_label",
        "declared_order",
    )
    record, measured = judge_motion(job, problem, trajectory, **{name: getattr(bare, name) for name in names})
    return Outcome(record, problem, trajectory, measured)


def judge_motion(
    job: Job, problem: Problem, trajectory: Trajectory, *, spent: float = 0.0, **known: Any
) -> tuple[RunRecord, MeasuredSeries]:
    """Measure and judge a motion; return its record and its measured series.

    A claimed success that breaks a law becomes ``wrong``, one that is too far from the reference ``inaccurate``. A run
    that stalled before its limit on steps is ``unfinished`` if it has used the fraction ``USED`` of its limit on CPU
    time, by ``spent`` [s], which includes code generation. ``known`` are columns of the record that take precedence.
    """
    measured = measure(problem, trajectory)
    numbers = make_columns(problem, trajectory, measured)
    status, because = Status(trajectory.status), list[Reason]()
    if status is Status.SUCCESS:
        because = list_broken_laws(problem, trajectory, measured, numbers)
        status = Status.WRONG if because else status
    if status is Status.SUCCESS and (because := find_inaccuracy(measured, numbers)):
        status = Status.INACCURATE
    by = EndCause.SOLVER
    limit, steps_left = job.spec.cpu_limit, len(trajectory.t) <= job.spec.control.max_steps
    used = spent - float(known.get("code_s", 0.0))
    if status is Status.STALLED and steps_left and math.isfinite(limit) and used >= USED * limit:
        status, by = Status.UNFINISHED, EndCause.CPU_LIMIT
    said = {"claimed": str(trajectory.status), "ended_by": str(by), "message": str(trajectory.message)}
    found = {"section": problem.section, "t_end_s": problem.t_end, "wrong_because": format_reasons(because)}
    return make_job_record(job, status, **{**said, **found, **numbers, **known}), measured


def write_outcome(job: Job, outcome: Outcome) -> RunRecord:
    """Write the series of an outcome into the results folder; return the record with path, digest and rows of the file.

    For an outcome without a motion no file is written, and its record is returned unchanged.
    """
    if outcome.problem is None or outcome.trajectory is None or outcome.measured is None:
        return outcome.record
    series = build_series(outcome.problem, outcome.trajectory, outcome.measured, lossless=job.lossless, keep=job.keep)
    place = name_series_file(job.id, brief=series.is_brief)
    digest = write_series(ConfinedPath(job.folder) / place, series)
    return dataclasses.replace(outcome.record, series=place, series_sha256=digest, series_rows=len(series["t"]))
