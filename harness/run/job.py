"""Define a job: a run, its address, and the results folder for its record; workers receive it as JSON."""

import contextlib
import json
import math
import signal
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from ..base.code_meter import CODE_LIMIT
from ..base.confined_paths import ConfinedPath
from ..base.forked_process import SLACK, ProcessEnd
from ..base.text import escape_text
from ..catalogue import registry
from ..catalogue.suites.spec import RunSpec
from ..mechanics.types import EndCause, Status
from ..results import environment
from ..results.records import RunRecord


@dataclass(frozen=True)
class Job:
    """A run to be executed, and the results folder for its record."""

    spec: RunSpec
    folder: Path
    suite: str = ""
    code: str = ""
    commit: str = ""
    plugins: tuple[str, ...] = ()
    environment: str = ""  # machine and packages
    total_limit: float | None = None  # [s] of its suite
    lossless: bool = False  # whether the series keeps the states of every step
    keep: tuple[str, ...] | None = None  # series that keep their rows in a brief file; None for a file of every step
    alone: bool = False  # must run without others in parallel: a signal from outside ended it before
    measured_by: str = ""  # digest of the code that measures

    @property
    def id(self) -> str:
        """The run's run_id, its address in results."""
        return self.spec.address(self.code)

    @property
    def stderr(self) -> ConfinedPath:
        """File to which the process writes its standard error."""
        return ConfinedPath(self.folder) / "stderr" / f"{self.id}.txt"

    @property
    def spool(self) -> ConfinedPath:
        """File in which the process keeps accepted steps while it runs."""
        return ConfinedPath(self.folder) / ".spool" / f"{self.id}.rows"

    @property
    def handover(self) -> ConfinedPath:
        """File that the solver's process leaves for the one that measures."""
        return ConfinedPath(self.folder) / ".spool" / f"{self.id}.npz"

    def to_json(self) -> str:
        """Return the job as one line."""
        return msgspec.json.encode(self, enc_hook=str).decode()

    @staticmethod
    def from_json(text: str) -> "Job":
        """Parse the line of ``to_json``; the job's plugins are not loaded."""
        return msgspec.json.decode(text, type=Job, dec_hook=lambda kind, given: kind(given))


def make_job_record(job: Job, status: Status, **columns: Any) -> RunRecord:
    """Return the record of a job: what was requested, its ``status``, and the values of further ``columns``.

    It names the file of standard error unless that is empty; ``finished`` is the present time.
    """
    spec, control = job.spec, job.spec.control
    entry = registry.solvers().get(spec.solver)
    label, order = registry.read_declaration(entry.make_solver(spec.options)) if entry else ("", math.nan)
    about = {"paper_label": label, "declared_order": order}
    if "message" in columns:
        columns["message"] = escape_text(columns["message"])
    files: Mapping[str, Any] = {}
    with contextlib.suppress(OSError):  # a solver's process may have left anything at that path
        if job.stderr.is_own_file() and job.stderr.size() > 0:
            files = {"stderr": f"stderr/{job.stderr.name}"}
    return RunRecord(
        run_id=job.id,
        settings_id=spec.settings_id,
        case=spec.case,
        suite=job.suite,
        label=spec.label,
        problem=spec.problem,
        problem_parameters=_format_settings(spec.parameters),
        solver=spec.solver,
        solver_options=_format_settings(spec.options),
        control="rtol" if control.dt is None else "dt",
        dt_s=_replace_none(control.dt),
        rtol=_replace_none(control.rtol),
        max_step_s=_replace_none(control.max_step),
        max_steps=control.max_steps,
        cpu_limit_s=spec.cpu_limit,
        wall_limit_s=SLACK * (spec.cpu_limit + GRACE),
        memory_limit_MB=spec.memory,
        status=str(status),
        code=job.code,
        measured_by=job.measured_by,
        commit=job.commit,
        environment=job.environment,
        finished=environment.read_utc_time(fine=True),
        **{"t_end_s": spec.parameters.get("t_end", math.nan), **about, **files, **columns},
    )


# [s] beyond the limit on CPU time after which a solver is killed: it was asked to stop at 0.9, and must write its steps
GRACE = 2.0
STATUS_OF = {
    EndCause.WALL_LIMIT: Status.UNFINISHED,
    EndCause.CPU_LIMIT: Status.UNFINISHED,
    EndCause.CODE_LIMIT: Status.UNFINISHED,
    EndCause.TOTAL_LIMIT: Status.UNFINISHED,
    EndCause.MEASURE_LIMIT: Status.UNFINISHED,
    EndCause.SUSPENDED: Status.UNFINISHED,
    EndCause.MEMORY_LIMIT: Status.MEMORY,
}  # of a run that was cut short; all others crashed
CUT_SHORT = {*STATUS_OF.values(), Status.CRASHED}  # statuses of runs that did not end by themselves
# no error of a solver raises these signals
FROM_OUTSIDE = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
NEAR = 0.9  # fraction of the memory limit beyond which a signal is attributed to lack of memory


def make_cut_short_record(job: Job, by: EndCause, **columns: Any) -> RunRecord:
    """Return the record of a run that did not end by itself; its status follows from the cause of its end, ``by``.

    ``columns`` are the values of further columns of the record.
    """
    return make_job_record(job, STATUS_OF.get(by, Status.CRASHED), ended_by=str(by), **columns)


def record_unfinished(job: Job, ended: ProcessEnd, wall: float, by: EndCause, limit: float) -> RunRecord:
    """Return the record of a run whose process sent none, after ``wall`` [s] of wall time.

    ``ended`` is how the process ended. If it was killed, ``by`` and ``limit`` [s] are the cause and the limit in the
    record, unless ``ended`` names a limit on memory, CPU time or code generation. If it ended by itself or by a signal,
    the cause follows from its exit code.
    """
    said = {}
    if ended.over == "memory" and by is EndCause.WALL_LIMIT:
        by, limit = EndCause.MEMORY_LIMIT, math.nan
        allowed = f"more than its limit of {job.spec.memory:g} MB beyond what was loaded"
        said = {"message": f"took {ended.peak:.0f} MB with all that it started, {allowed}"}
    elif ended.over in ("cpu", "code") and by is EndCause.WALL_LIMIT:
        by, limit = (EndCause.CPU_LIMIT, math.nan) if ended.over == "cpu" else (EndCause.CODE_LIMIT, CODE_LIMIT)
    if not ended.killed:
        limit = math.nan
        by = EndCause.EXIT if ended.code >= 0 else EndCause.SIGNAL
        if ended.code == -signal.SIGXCPU:
            by, limit = (EndCause.CODE_LIMIT, CODE_LIMIT) if ended.over == "code" else (EndCause.CPU_LIMIT, math.nan)
        elif by is EndCause.SIGNAL and ended.peak > NEAR * job.spec.memory:
            by = EndCause.MEMORY_LIMIT
        elif -ended.code in FROM_OUTSIDE:
            by = EndCause.KILLED
    elif ended.suspended and by in (EndCause.WALL_LIMIT, EndCause.MEASURE_LIMIT):
        by = EndCause.SUSPENDED
    ending = {
        "cpu_process_s": ended.cpu,
        "code_s": ended.code_s,
        "exit_code": max(ended.code, 0),
        "signal": max(-ended.code, 0),
        "ended_limit_s": limit,
    }
    return make_cut_short_record(job, by, wall_s=wall, peak_memory_MB=ended.peak, **ending, **said)


def format_first_line(error: BaseException) -> str:
    """Return the type and the first line of an exception's message, at most 500 characters."""
    with contextlib.suppress(Exception):  # str() of a foreign exception may itself raise
        return f"{type(error).__name__}: {error}".strip(": ").split("\n")[0][:500]
    return type(error).__name__


def _format_settings(values: Mapping[str, Any]) -> str:
    """Return options or parameters as JSON with sorted keys, so that equal ones give equal text."""
    return json.dumps(dict(values), sort_keys=True, default=list)


def _replace_none(value: float | None) -> float:
    """Return a number, or NaN for None, as columns of a record hold only numbers."""
    return math.nan if value is None else value
