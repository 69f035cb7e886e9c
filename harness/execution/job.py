"""A job: a run, its address, and the run folder its result belongs to. What a worker is handed, as JSON."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from ..catalogue import registry
from ..results import environment
from ..results.records import RunRecord
from ..suites.spec import RunSpec
from ..types import Status


@dataclass(frozen=True)
class Job:
    """One run to run for ``folder``."""

    spec: RunSpec
    folder: Path
    suite: str = ""
    code: str = ""
    commit: str = ""
    plugins: tuple[str, ...] = ()

    @property
    def id(self) -> str:
        """The run's address."""
        return self.spec.address(self.code)

    @property
    def stderr(self) -> Path:
        """Where the process writes its standard error."""
        return self.folder / "stderr" / f"{self.id}.txt"

    @property
    def spool(self) -> Path:
        """Where the process keeps accepted steps while it runs."""
        return self.folder / ".spool" / f"{self.id}.rows"

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
    files: Mapping[str, Any] = {}
    if job.stderr.exists() and job.stderr.stat().st_size > 0:
        files = {"stderr": f"stderr/{job.stderr.name}"}
    return RunRecord(
        run_id=job.id,
        settings_id=spec.settings_id,
        case=spec.case,
        suite=job.suite,
        label=spec.label,
        problem=spec.problem,
        problem_parameters=_json(spec.parameters),
        solver=spec.solver,
        paper_label=_label(spec.solver),
        declared_order=_order(spec.solver),
        solver_options=_json(spec.options),
        control="rtol" if control.dt is None else "dt",
        dt_s=_or_nan(control.dt),
        rtol=_or_nan(control.rtol),
        max_step_s=_or_nan(control.max_step),
        max_steps=control.max_steps,
        wall_limit_s=spec.wall_limit,
        memory_limit_MB=spec.memory,
        status=str(status),
        code=job.code,
        commit=job.commit,
        finished=environment.now(),
        **{"t_end_s": spec.parameters.get("t_end", math.nan), **files, **columns},
    )


def _label(solver: str) -> str:
    entry = registry.solvers().get(solver)
    return entry.paper_label if entry else ""


def _order(solver: str) -> float:
    entry = registry.solvers().get(solver)
    return entry.order if entry else math.nan


def _json(values: Mapping[str, Any]) -> str:
    return json.dumps(dict(values), sort_keys=True, default=list)


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value
