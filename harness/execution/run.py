"""One run: ``run_one`` solves in a process of its own, measures what that left, and returns the outcome.

Suites, ``solve`` and the tests run it. Its caller is a process that adopts orphans and does nothing else (``Run``):
it limits the solver's process and ends all that this started; who started it limits the measuring.
"""

import contextlib
import dataclasses
import errno
import math
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

from ..catalogue import registry
from ..clock import set_keeper
from ..code_meter import CODE_LIMIT, listen_to_numba
from ..files import FileError
from ..places import Place
from ..results import records, store
from ..results.records import RunRecord
from ..sandbox.apart import NOWHERE, SLACK, Apart, Ended, NotBegunError
from ..sandbox.isolation import CANNOT_WRITE, PATIENCE, adopt_orphans, end_descendants, limit_process, trim
from ..types import EndedBy, Problem
from .job import CUT_SHORT, GRACE, Job, cut_short, record_unfinished
from .measuring import Outcome, make_problem, measure_run, write_outcome
from .worker import SOFT, hand_over

MEASURE_LIMIT = 120.0  # [s] of CPU time for metrics once the solver is done, reference included
STOPPED_MEASURE_LIMIT = 10.0  # [s] for the steps a run had kept, when its suite is stopped
NO_LIMIT = 1e7  # [s] of CPU, four months: a run from the shell is ended by whoever started it
MEASURING, STORED = "measuring", "stored"  # what a run sends, each before a record: how its solver ended, its outcome
SOLVING, UNBEGUN = "solving", "unbegun"  # and before: the solver's process has begun; why it has not
FULL = "no space left on the disk, or a file as large as ulimit -f allows"
Send = Callable[[str], None]
Store = Callable[[Outcome], RunRecord]


def run_here(job: Job) -> RunRecord:
    """Run in this process, without limits, and store the record."""
    hand_over(job)
    return store_outcome(job, measure_run(job, cut_short(job, EndedBy.EXIT)))


def run_one(
    job: Job, send: Send, problem: Problem | None = None, *, soft: float = SOFT, measure_limit: float = MEASURE_LIMIT
) -> Outcome:
    """Solve in a process of its own, with the limits of ``job``; measure here.

    ``send`` is told how the solver's process ended. At SIGTERM the solver is ended: its suite has met its limit.
    """
    began, stopped = time.monotonic(), list[int]()
    signal.signal(signal.SIGTERM, lambda number, frame: stopped.append(number))
    adopt_orphans()
    if problem is None and registry.is_own_problem(job.spec.problem):  # a plugin's is made where limits hold
        with contextlib.suppress(Exception):  # the solver's process will report it
            problem = make_problem(job)
    listen_to_numba()  # here, where measuring needs numba anyway: the solver's process has it from the start

    def solve(send: Send) -> None:
        set_keeper(os.getppid())
        hand_over(job, soft, problem)

    limit = job.spec.cpu_limit + GRACE
    wall = SLACK * limit
    process = Apart(
        solve,
        limit=min(limit, NO_LIMIT),
        wall=wall,
        memory=job.spec.memory,
        stderr=job.stderr,
        above="here",
        code=CODE_LIMIT,
    )
    told = list[bool]()

    def is_unwanted() -> bool:
        if process.begun and not told:
            send(f"{SOLVING} 1")
            told.append(True)
        return bool(stopped)

    ended = process.watch(is_unwanted)
    is_unwanted()  # it may have begun and ended between two looks
    if ended.unbegun and not stopped:
        send(f"{UNBEGUN} {' '.join(ended.unbegun.split())}")
        raise NotBegunError(ended.unbegun)
    if ended.code == CANNOT_WRITE:
        raise OSError(errno.ENOSPC, FULL)
    by, at = (EndedBy.TOTAL_LIMIT, job.total_limit or math.nan) if stopped else (EndedBy.WALL_LIMIT, wall)
    try:
        trim(job.stderr)
        store.path_of(job.folder, job.id).remove_file(missing_ok=True)  # not for the solver's process to write
        bare = record_unfinished(job, ended, time.monotonic() - began, by, at)
    except OSError as error:  # the run left what cannot be removed: it alone fails
        return Outcome(cut_short(job, EndedBy.EXCEPTION, message=words_of(error), wall_s=time.monotonic() - began))
    send_record(send, MEASURING, bare)
    limit_process(job.spec.memory, STOPPED_MEASURE_LIMIT if stopped else measure_limit, CODE_LIMIT)
    outcome = measure_run(job, bare, problem, ended.cpu)
    end_descendants()
    return dataclasses.replace(outcome, record=dataclasses.replace(outcome.record, wall_s=time.monotonic() - began))


def store_outcome(job: Job, outcome: Outcome) -> RunRecord:
    """Write series and record into the results folder."""
    record = write_outcome(job, outcome)
    store.write_record(job.folder, record)
    for rest in (job.handover, job.spool):
        rest.remove_file(missing_ok=True)
    return record


def run_and_store(job: Job, send: Send) -> None:
    """Run for a results folder."""
    send_record(send, STORED, store_outcome(job, run_one(job, send)))


def send_record(send: Send, what: str, record: RunRecord) -> None:
    """Send a record on one line."""
    send(f"{what} {records.to_json(record).replace(chr(10), ' ')}")


def words_of(error: OSError) -> str:
    """The file and the reason."""
    return f"{error.filename}: {error.strerror}" if error.filename else str(error)


def measure_kept(job: Job, bare: RunRecord, send: Send, store: Store, problem: Problem | None) -> None:
    """Measure the steps that a run had kept whose own process ended before it could; ``store`` the outcome."""
    send_record(send, MEASURING, bare)
    job.handover.remove_file(missing_ok=True)
    limit_process(job.spec.memory, STOPPED_MEASURE_LIMIT, CODE_LIMIT)
    send_record(send, STORED, store(measure_run(job, bare, problem)))


class Run(Apart):
    """The process of a run, which ends with its record in what it sent, or why there is none."""

    def __init__(
        self, job: Job, work: Callable[[Send], object], measure_limit: float = MEASURE_LIMIT,
        stderr: Path | Place = NOWHERE, *, salvages: bool = False,
    ) -> None:  # fmt: skip
        limit = job.spec.cpu_limit + GRACE  # the process keeps it itself, as long as its solver lets it
        super().__init__(
            work, limit=limit + measure_limit, wall=SLACK * (limit + PATIENCE), memory=math.inf, stderr=stderr,
            above="itself", code=2.0 * CODE_LIMIT,  # of its solver and of measuring
        )  # fmt: skip
        self.job, self.measure_limit = job, SLACK * measure_limit
        self.began, self.stopped, self.measuring = time.monotonic(), False, False
        self.salvages = salvages
        self.solving, self.unbegun = salvages, ""  # whether its solver has begun, or why it has not

    def look(self) -> Ended | None:
        """Once the solver's process has ended, keep the limit on the wall time of measuring."""
        ended = super().look()
        if ended is None and not self.measuring and f"\n{MEASURING} " in f"\n{self.hear()}":
            self.measuring, self.deadline = True, time.monotonic() + self.measure_limit
        return ended

    def salvage(self, bare: RunRecord, store: Store, problem: Problem | None = None) -> "Run | None":
        """Where it ended before its solver, the process that measures the steps kept for the record ``bare``."""
        if self.salvages or self.measuring or not self.job.spool.is_own_file():
            return None

        def work(send: Send) -> None:
            measure_kept(self.job, bare, send, store, problem)

        return Run(self.job, work, STOPPED_MEASURE_LIMIT, salvages=True)

    def stop(self) -> None:
        """End the solver: its suite has met its limit. The steps that it had kept are measured."""
        self.stopped = True
        if not self.measuring:
            os.kill(self.pid, signal.SIGTERM)
            self.measure_limit = SLACK * STOPPED_MEASURE_LIMIT
        else:
            self.deadline = min(self.deadline, time.monotonic() + STOPPED_MEASURE_LIMIT)

    def outcome(self, ended: Ended) -> tuple[RunRecord, bool]:
        """The record, and whether the process itself came to the end of its work.

        OSError where the disk is full, ``NotBegunError`` where its solver did not begin.
        """
        sent = self._read(ended.sent)
        self.measuring = MEASURING in sent
        if ended.code == 0 and STORED in sent:
            return sent[STORED], True
        if ended.code == CANNOT_WRITE:
            raise OSError(errno.ENOSPC, FULL, str(self.job.folder))
        wall = time.monotonic() - self.began
        if MEASURING not in sent:  # ended before its solver
            if self.stopped:
                return cut_short(self.job, EndedBy.TOTAL_LIMIT, ended_limit_s=self.job.total_limit, wall_s=wall), False
            if not self.solving:
                raise NotBegunError(self.unbegun or ended.unbegun or f"the process of the run {ended.words}")
            return record_unfinished(self.job, ended, wall, EndedBy.WALL_LIMIT, math.nan), False
        bare = sent[MEASURING]
        if bare.ended_by != EndedBy.EXIT or bare.exit_code != 0:
            return bare, False
        late = dataclasses.replace(ended, killed=ended.at_limit)
        return record_unfinished(self.job, late, wall, EndedBy.MEASURE_LIMIT, self.measure_limit), False

    def _read(self, sent: str) -> dict[str, RunRecord]:
        """The records in whole lines; FileError where they are not those that a run sends, each once and in order."""
        lines = [line.partition(" ")[::2] for line in sent.split("\n")[:-1]]
        ahead = dict(line for line in lines if line[0] in (SOLVING, UNBEGUN))
        self.solving, self.unbegun = self.salvages or SOLVING in ahead, ahead.get(UNBEGUN, "")
        lines = [line for line in lines if line[0] not in ahead]
        found = {what: records.from_json(text) for what, text in lines if text}
        bare = found.get(MEASURING)
        if (
            [what for what, text in lines if text] not in ([], [MEASURING], [STORED], [MEASURING, STORED])
            or any(r.run_id != self.job.id for r in found.values())
            or (bare is not None and bare.status not in CUT_SHORT)
        ):
            raise FileError("the process of the run sent what is not its record")
        return found
