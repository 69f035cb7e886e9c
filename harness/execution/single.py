"""One run from the shell: solved in a process of its own, written as one NPZ file, whatever happens."""

import dataclasses
import errno
import math
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..catalogue import registry
from ..files import partial_of
from ..mechanics.state import States
from ..metrics.measure import measure
from ..results import records
from ..results.records import RunRecord
from ..sandbox.apart import Apart
from ..sandbox.isolation import CANNOT_WRITE
from ..suites.spec import RunSpec
from ..types import EndedBy, Problem, Status, Trajectory
from .job import Job, unfinished
from .run_file import in_file
from .supervisor import GRACE
from .warmup import references_apart, runs_to_warm, warm_apart_then_here
from .worker import salvaged, solved

PATIENCE = 3.0  # [s] until it is said that compilation may take a while
NO_LIMIT = 1e7  # [s] of CPU, four months: a run from the shell is ended by whoever started it


@dataclass(frozen=True)
class Outcome:
    """How a single run went, for the summary on the terminal."""

    record: RunRecord  # without address, its series is the file
    native: str  # the last of what the process wrote to standard error


def solve_to_file(
    spec: RunSpec, out: Path, wall_limit: float | None, say: Callable[[str], object] = lambda words: None
) -> Outcome:
    """Run ``spec`` and write ``out``; a run that crashes or is killed leaves a file with the steps it had kept.

    Interrupted itself, it ends the run and leaves ``out`` as it was: whole, or not there.
    """
    problem = registry.make_problem(spec.problem, spec.parameters)
    patience = _Patience(say)
    with tempfile.TemporaryDirectory() as place:
        limit = math.inf if wall_limit is None else wall_limit
        job = Job(dataclasses.replace(spec, wall_limit=limit), Path(place))
        if wall_limit is not None:  # a limit is on the run: compute the reference and compile before its clock starts
            references_apart([job], patience.over)
            warm_apart_then_here(runs_to_warm([spec]), patience.over)
        began, stderr = time.monotonic(), Path(place) / "stderr"
        process = Apart(
            lambda send: send(records.to_json(_written(solved(job, send, in_file(out), soft=1.0), problem, out))),
            limit=limit + GRACE, memory=spec.memory, stderr=stderr,
            cpu=NO_LIMIT if wall_limit is None else 2.0 * wall_limit + 60.0,
        )  # fmt: skip
        try:
            ended = process.wait(patience.over)
        finally:
            partial_of(out, process.pid).unlink(missing_ok=True)
        native = stderr.read_text(encoding="utf-8", errors="replace")[-2000:].strip() if stderr.exists() else ""
        _, opened, sent = ended.sent.partition("{")
        if ended.code == 0 and opened:
            return Outcome(records.from_json(opened + sent), native)
        if ended.code == CANNOT_WRITE:
            raise OSError(errno.ENOSPC, "nothing was written: no space left", str(out))
        bare = unfinished(job, ended, time.monotonic() - began, EndedBy.WALL_LIMIT, limit + GRACE)
        record = salvaged(job, dataclasses.replace(bare, section=problem.section, t_end_s=problem.t_end), in_file(out))
        return Outcome(_written(record, problem, out), native)


class _Patience:
    """Says once that a run takes its time, and why it may."""

    def __init__(self, say: Callable[[str], object]) -> None:
        self.say, self.until, self.said = say, time.monotonic() + PATIENCE, False

    def over(self) -> bool:
        """Never; but looks at the clock."""
        if not self.said and time.monotonic() > self.until:
            self.said = True
            self.say(
                "running; the first run after an installation or a change compiles kernels, the first of a variant may "
                "compute its reference: half a minute or more"
            )
        return False


def _written(record: RunRecord, problem: Problem, out: Path) -> RunRecord:
    """Where there is no motion (refused, ended before the first step), the file holds the start."""
    if record.series:
        return record
    start = Trajectory(np.zeros(1), States.one(problem.initial), Status(record.status), record.message, {})
    return in_file(out)(problem, start, measure(problem, start), record)
