"""A job: a cell, its address, and the run folder its result belongs to. What a worker is handed, as JSON."""

import dataclasses
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..catalogue import registry
from ..results import environment
from ..results.records import RunRecord
from ..suites.cell import Cell
from ..types import Status


@dataclass(frozen=True)
class Job:
    """One cell to run for ``folder``."""

    cell: Cell
    folder: Path
    suite: str = ""
    code: str = ""
    commit: str = ""
    plugins: tuple[str, ...] = ()

    @property
    def id(self) -> str:
        """The cell's address."""
        return self.cell.address(self.code)

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
        plain = {**dataclasses.asdict(self), "cell": self.cell.to_plain(), "folder": str(self.folder)}
        return json.dumps(plain, default=list)

    @staticmethod
    def from_json(text: str) -> "Job":
        """The inverse of ``to_json``; plugins are not loaded by it."""
        plain = json.loads(text)
        plain.update(folder=Path(plain["folder"]), cell=Cell.from_plain(plain["cell"]), plugins=tuple(plain["plugins"]))
        return Job(**plain)


def record_of(job: Job, status: Status, **columns: Any) -> RunRecord:
    """The record of a job: what was asked, its ``status``, and what else is known."""
    cell, control = job.cell, job.cell.control
    files: Mapping[str, Any] = {}
    if job.stderr.exists() and job.stderr.stat().st_size > 0:
        files = {"stderr": f"stderr/{job.stderr.name}"}
    return RunRecord(
        cell=job.id,
        settings=cell.settings,
        case=cell.case,
        suite=job.suite,
        label=cell.label,
        problem=cell.problem,
        problem_parameters=_json(cell.parameters),
        solver=cell.solver,
        paper_label=_label(cell.solver),
        declared_order=_order(cell.solver),
        solver_options=_json(cell.options),
        control="rtol" if control.dt is None else "dt",
        dt_s=_or_nan(control.dt),
        rtol=_or_nan(control.rtol),
        max_step_s=_or_nan(control.max_step),
        max_steps=control.max_steps,
        wall_limit_s=cell.wall_limit,
        memory_limit_MB=cell.memory,
        status=str(status),
        code=job.code,
        commit=job.commit,
        finished=environment.now(),
        **{"t_end_s": cell.parameters.get("t_end", math.nan), **files, **columns},
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
