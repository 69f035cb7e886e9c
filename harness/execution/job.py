"""A job: a run, its address, and the results folder its result belongs to. What a worker is handed, as JSON."""

import contextlib
import json
import math
import signal
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from ..catalogue import registry
from ..code_meter import CODE_LIMIT
from ..places import Place
from ..results import environment
from ..results.records import RunRecord
from ..sandbox.apart import SLACK, Ended
from ..suites.spec import RunSpec
from ..text import printable
from ..types import EndedBy, Status


@dataclass(frozen=True)
class Job:
    """One run to run for ``folder``."""

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
    alone: bool = False  # beside no other run: a signal from outside ended it before

    @property
    def id(self) -> str:
        """The run's address."""
        return self.spec.address(self.code)

    @property
    def stderr(self) -> Place:
        """Where the process writes its standard error."""
        return Place(self.folder) / "stderr" / f"{self.id}.txt"

    @property
    def spool(self) -> Place:
        """Where the process keeps accepted steps while it runs."""
        return Place(self.folder) / ".spool" / f"{self.id}.rows"

    @property
    def handover(self) -> Place:
        """File that the solver's process hands over to the one that measures."""
        return Place(self.folder) / ".spool" / f"{self.id}.npz"

    def to_json(self) -> str:
        """One line."""
        return msgspec.json.encode(self, enc_hook=str).decode()

    @staticmethod
    def from_json(text: str) -> "Job":
        """The inverse of ``to_json``; plugins are not loaded by it."""
        return msgspec.json.decode(text, type=Job, dec_hook=lambda kind, given: kind(given))


def record_of(job: Job, status: Status, **columns: Any) -> RunRecord:
    """The record of a job: what was asked, its ``status``, and what else is known."""
    spec, control = job.spec, job.spec.control
    entry = registry.solvers().get(spec.solver)
    label, order = registry.read_declaration(entry.make_solver(spec.options)) if entry else ("", math.nan)
    about = {"paper_label": label, "declared_order": order}
    if "message" in columns:
        columns["message"] = printable(columns["message"])
    files: Mapping[str, Any] = {}
    with contextlib.suppress(OSError):  # a solver's process may have left anything there
        if job.stderr.is_own_file() and job.stderr.size() > 0:
            files = {"stderr": f"stderr/{job.stderr.name}"}
    return RunRecord(
        run_id=job.id, settings_id=spec.settings_id, case=spec.case, suite=job.suite, label=spec.label,
        problem=spec.problem, problem_parameters=_json(spec.parameters),
        solver=spec.solver, solver_options=_json(spec.options),
        control="rtol" if control.dt is None else "dt", dt_s=_or_nan(control.dt), rtol=_or_nan(control.rtol),
        max_step_s=_or_nan(control.max_step), max_steps=control.max_steps,
        cpu_limit_s=spec.cpu_limit, wall_limit_s=SLACK * (spec.cpu_limit + GRACE), memory_limit_MB=spec.memory,
        status=str(status), code=job.code, commit=job.commit, environment=job.environment,
        finished=environment.now(fine=True),
        **{"t_end_s": spec.parameters.get("t_end", math.nan), **about, **files, **columns},
    )  # fmt: skip


GRACE = 2.0  # [s] over the limit on CPU time, then killed: a solver was asked to stop at 0.9 of the limit
STATUS_OF = {
    EndedBy.WALL_LIMIT: Status.UNFINISHED,
    EndedBy.CPU_LIMIT: Status.UNFINISHED,
    EndedBy.CODE_LIMIT: Status.UNFINISHED,
    EndedBy.TOTAL_LIMIT: Status.UNFINISHED,
    EndedBy.MEASURE_LIMIT: Status.UNFINISHED,
    EndedBy.SUSPENDED: Status.UNFINISHED,
    EndedBy.MEMORY_LIMIT: Status.MEMORY,
}  # of a run that was cut short; all others crashed
CUT_SHORT = {*STATUS_OF.values(), Status.CRASHED}
FROM_OUTSIDE = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP)  # no fault of a solver raises them
NEAR = 0.9  # of the memory allowed: a signal then means that it ran out


def cut_short(job: Job, by: EndedBy, **columns: Any) -> RunRecord:
    """The record of a run that was ended ``by`` something other than its solver."""
    return record_of(job, STATUS_OF.get(by, Status.CRASHED), ended_by=str(by), **columns)


def record_unfinished(job: Job, ended: Ended, wall: float, by: EndedBy, limit: float) -> RunRecord:
    """The record of a process that left none; ``by`` and ``limit`` [s] say why it was killed, if it was."""
    said = {}
    if ended.over == "memory" and by is EndedBy.WALL_LIMIT:
        by, limit = EndedBy.MEMORY_LIMIT, math.nan
        allowed = f"more than its limit of {job.spec.memory:g} MB beyond what was loaded"
        said = {"message": f"took {ended.peak:.0f} MB with all that it started, {allowed}"}
    elif ended.over in ("cpu", "code") and by is EndedBy.WALL_LIMIT:
        by, limit = (EndedBy.CPU_LIMIT, math.nan) if ended.over == "cpu" else (EndedBy.CODE_LIMIT, CODE_LIMIT)
    if not ended.killed:
        limit = math.nan
        by = EndedBy.EXIT if ended.code >= 0 else EndedBy.SIGNAL
        if ended.code == -signal.SIGXCPU:
            by, limit = (EndedBy.CODE_LIMIT, CODE_LIMIT) if ended.over == "code" else (EndedBy.CPU_LIMIT, math.nan)
        elif by is EndedBy.SIGNAL and ended.peak > NEAR * job.spec.memory:
            by = EndedBy.MEMORY_LIMIT
        elif -ended.code in FROM_OUTSIDE:
            by = EndedBy.KILLED
    elif ended.suspended and by in (EndedBy.WALL_LIMIT, EndedBy.MEASURE_LIMIT):
        by = EndedBy.SUSPENDED
    ending = {
        "cpu_process_s": ended.cpu,
        "code_s": ended.code_s,
        "exit_code": max(ended.code, 0),
        "signal": max(-ended.code, 0),
        "ended_limit_s": limit,
    }
    return cut_short(job, by, wall_s=wall, peak_memory_MB=ended.peak, **ending, **said)


def first_line(error: BaseException) -> str:
    """The type and first line of an exception."""
    with contextlib.suppress(Exception):  # str() of a foreign exception may itself raise
        return f"{type(error).__name__}: {error}".strip(": ").split("\n")[0][:500]
    return type(error).__name__


def _json(values: Mapping[str, Any]) -> str:
    return json.dumps(dict(values), sort_keys=True, default=list)


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value
