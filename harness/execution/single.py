"""One run from the shell: solved in a process of its own, written as one NPZ file, whatever happens."""

import dataclasses
import errno
import math
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from ..catalogue import registry
from ..files import partial_of
from ..mechanics.state import States
from ..metrics.measure import measure
from ..places import Place
from ..results import records
from ..results.records import RunRecord
from ..sandbox.apart import Apart
from ..sandbox.isolation import CANNOT_WRITE, OUTPUT_LIMIT
from ..suites.spec import RunSpec
from ..types import EndedBy, Status, Trajectory
from .eta import COMPILING, MEASURING, REFERENCES, RUNNING, waiting
from .job import Job, unfinished
from .run_file import in_file, without_motion
from .supervisor import GRACE, MEASURE_LIMIT
from .warmup import references_apart, runs_to_warm, warm, warm_apart_then_here
from .worker import hand_over, measured

PATIENCE = 3.0  # [s] of any of these until it is mentioned
NO_LIMIT = 1e7  # [s] of CPU, four months: a run from the shell is ended by whoever started it


class Say(Protocol):
    """Prints a line; one that ends with a carriage return is written over by the next."""

    def __call__(self, words: str, *, end: str = "\n") -> object: ...


def _silent(words: str, *, end: str = "\n") -> None:
    pass


@dataclass(frozen=True)
class Outcome:
    """How a single run went, for the summary on the terminal."""

    record: RunRecord  # without address, its series is the file
    native: str  # the last of what the process wrote to standard error


def solve_to_file(spec: RunSpec, out: Path, wall_limit: float | None, say: Say = _silent) -> Outcome:
    """Run ``spec`` and write ``out``; a run that crashes or is killed leaves a file with the steps it had kept.

    Interrupted itself, it ends the run and leaves ``out`` as it was: whole, or not there. The problem, its reference
    and its observables are used in other processes alone.
    """
    patience = _Patience(say)
    with tempfile.TemporaryDirectory() as place:
        limit = math.inf if wall_limit is None else wall_limit
        job = Job(dataclasses.replace(spec, wall_limit=limit), Path(place))
        if wall_limit is not None:  # a limit is on the run: compute the reference and compile before its clock starts
            patience.now(REFERENCES)
            references_apart([job], patience.over)
            patience.now(COMPILING)
            warm_apart_then_here(runs_to_warm([spec]), patience.over)
        stderr = Place(Path(place)) / "native.txt"

        def compile_and_run(send: Callable[[str], None]) -> None:
            if wall_limit is None:
                warm(runs_to_warm([spec]))
            send(RUNNING)
            hand_over(job, soft=1.0)

        patience.now(COMPILING)
        began = time.monotonic()
        process = Apart(
            compile_and_run, limit=limit + GRACE, memory=spec.memory, stderr=stderr,
            cpu=NO_LIMIT if wall_limit is None else 2.0 * wall_limit + 60.0,
        )  # fmt: skip
        ended = process.wait(lambda: patience.now(process.hear().strip() or COMPILING))
        if ended.code == CANNOT_WRITE:
            raise OSError(errno.ENOSPC, "nothing was written: no space left", place)
        native = stderr.read(OUTPUT_LIMIT).decode(errors="replace")[-2000:].strip() if stderr.is_there() else ""
        wall = time.monotonic() - began
        bare = unfinished(job, ended, wall, EndedBy.WALL_LIMIT, limit + GRACE)
        return Outcome(_measured(job, bare, wall, ended.cpu, out, patience), native)


def _measured(job: Job, bare: RunRecord, wall: float, spent: float, out: Path, patience: "_Patience") -> RunRecord:
    """The record, with its file written, by a process of its own; without a motion where that does not end well."""

    def measure_and_write(send: Callable[[str], None]) -> None:
        began = time.monotonic()
        record = measured(job, bare, in_file(out), spent)
        record = dataclasses.replace(record, wall_s=wall + time.monotonic() - began)
        send(records.to_json(record if record.series else _start_alone(job, out, record)))

    limit = MEASURE_LIMIT if math.isfinite(job.spec.wall_limit) else NO_LIMIT
    patience.now(MEASURING)
    process = Apart(measure_and_write, limit=limit, memory=job.spec.memory)
    try:
        ended = process.wait(patience.over)
    finally:
        partial_of(out, process.pid).unlink(missing_ok=True)
    _, opened, sent = ended.sent.partition("{")
    if ended.code == 0 and opened:
        return records.from_json(opened + sent)
    if ended.code == CANNOT_WRITE:
        raise OSError(errno.ENOSPC, "nothing was written: no space left", str(out))
    return without_motion(out, unfinished(job, ended, wall, EndedBy.MEASURE_LIMIT, limit))


def _start_alone(job: Job, out: Path, record: RunRecord) -> RunRecord:
    """Where there is no motion (refused, ended before the first step), the file holds the start."""
    try:
        problem = registry.make_problem(job.spec.problem, job.spec.parameters)
        start = Trajectory(np.zeros(1), States.one(problem.initial), Status(record.status), record.message, {})
        return in_file(out)(problem, start, measure(problem, start), record)
    except Exception:  # a problem that cannot be measured at all: the record has said so
        return without_motion(out, record)


class _Patience:
    """Says what takes its time and how long is left, once; then every second on one line."""

    def __init__(self, say: Say) -> None:
        self.say, self.doing = say, ""

    def now(self, doing: str) -> bool:
        """What goes on from now on, or still does."""
        if doing != self.doing:
            self.doing, self.began, self.due = doing, time.monotonic(), PATIENCE
        return self.over()

    def over(self) -> bool:
        """Say how long it takes; always False, so that the wait continues."""
        elapsed = time.monotonic() - self.began
        if elapsed > self.due:
            words = waiting(self.doing, elapsed)
            self.say(words, end="\n" if self.due == PATIENCE else "\r")
            self.due = elapsed + 1.0
        return False
