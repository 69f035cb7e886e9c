"""Execute one run: ``run_one`` solves in a separate process, measures the result, and returns the outcome.

Suites, ``solve`` and the tests call it. Its caller is a process that adopts orphans and does nothing else
(``RunProcess``): it limits the solver's process and ends everything that process started. The parent of the caller
limits the measuring.
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

from ..base.clock import set_subreaper
from ..base.code_meter import CODE_LIMIT, listen_to_numba
from ..base.confined_paths import ConfinedPath
from ..base.files import FileError
from ..base.forked_process import NOWHERE, SLACK, ForkedProcess, NotBegunError, ProcessEnd
from ..base.isolation import CANNOT_WRITE, PATIENCE, adopt_orphans, end_descendants, limit_process, trim_output
from ..catalogue import registry
from ..mechanics.types import EndCause, Problem
from ..reference.held import hold_values
from ..results import records, store
from ..results.records import RunRecord
from .job import CUT_SHORT, GRACE, Job, make_cut_short_record, record_unfinished
from .measuring import Outcome, make_problem, measure_run, write_outcome
from .worker import SOFT, solve_job

# [s] of CPU time for metrics once the solver is done: twice the minute that a difficult reference takes
MEASURE_LIMIT = 120.0
# [s] to measure the kept steps of a stopped suite: more keeps who stopped it waiting, less loses metrics
STOPPED_MEASURE_LIMIT = 10.0
NO_LIMIT = 1e7  # [s] of CPU, four months: a run from the shell is ended by its user
MEASURING, STORED = "measuring", "stored"  # sent by a run, each before a record: how its solver ended, its outcome
SOLVING, UNBEGUN = "solving", "unbegun"  # sent earlier: the solver's process has begun; why it has not
FULL = "no space left on the disk, or a file as large as ulimit -f allows"
Send = Callable[[str], None]  # a line to the parent process
Store = Callable[[Outcome], RunRecord]  # writes an outcome, and returns its record with the place of its files


def run_one(
    job: Job, send: Send, problem: Problem | None = None, *, soft: float = SOFT, measure_limit: float = MEASURE_LIMIT
) -> Outcome:
    """Solve in a separate process with the limits of ``job``, measure in this one, and return the outcome.

    This process must do nothing else: it adopts orphans, handles SIGTERM, by which a suite ends the solver at its
    limit, and is itself limited to ``measure_limit`` [s] of CPU time. ``send`` is called with a line when the solver's
    process has begun, and with the record of how it ended. ``soft`` is the fraction of its limit on CPU time at which
    the solver is asked to stop. Raise NotBegunError if the solver's process could not begin, OSError if the disk is
    full.
    """
    began, stopped = time.monotonic(), list[int]()
    signal.signal(signal.SIGTERM, lambda number, frame: stopped.append(number))
    adopt_orphans()
    # the problem of a plugin is created where limits hold
    if problem is None and registry.is_own_problem(job.spec.problem):
        with contextlib.suppress(Exception):  # the solver's process will report it
            problem = make_problem(job)
    if problem is not None:
        hold_values(problem)  # its reference is read once
    listen_to_numba()  # measuring needs numba anyway, and the solver's process then inherits it

    def solve(send: Send) -> None:
        """Solve in the solver's process; processes that it starts are adopted and counted by its parent."""
        set_subreaper(os.getppid())
        solve_job(job, soft, problem)

    limit = job.spec.cpu_limit + GRACE
    wall = SLACK * limit
    process = ForkedProcess(
        solve,
        limit=min(limit, NO_LIMIT),
        wall=wall,
        memory=job.spec.memory,
        stderr=job.stderr,
        above="here",
        code=CODE_LIMIT,
    )
    reported = list[bool]()

    def is_unwanted() -> bool:
        """Return whether the run is to be ended; report once that the solver's process has begun."""
        if process.begun and not reported:
            send(f"{SOLVING} 1")
            reported.append(True)
        return bool(stopped)

    ended = process.wait_for_end(is_unwanted)
    is_unwanted()  # it may have begun and ended between two checks
    if ended.unbegun and not stopped:
        send(f"{UNBEGUN} {' '.join(ended.unbegun.split())}")
        raise NotBegunError(ended.unbegun)
    if ended.code == CANNOT_WRITE:
        raise OSError(errno.ENOSPC, FULL)
    by, at = (EndCause.TOTAL_LIMIT, job.total_limit or math.nan) if stopped else (EndCause.WALL_LIMIT, wall)
    try:
        trim_output(job.stderr)
        store.locate_record(job.folder, job.id).remove_file(missing_ok=True)  # the solver's process must not write it
        bare = record_unfinished(job, ended, time.monotonic() - began, by, at)
    except OSError as error:  # the run left a file that cannot be removed: only this run fails
        return Outcome(
            make_cut_short_record(
                job, EndCause.EXCEPTION, message=describe_error(error), wall_s=time.monotonic() - began
            )
        )
    send_record(send, MEASURING, bare)
    limit_process(job.spec.memory, STOPPED_MEASURE_LIMIT if stopped else measure_limit, CODE_LIMIT)
    outcome = measure_run(job, bare, problem, ended.cpu)
    end_descendants()
    return dataclasses.replace(outcome, record=dataclasses.replace(outcome.record, wall_s=time.monotonic() - began))


def store_outcome(job: Job, outcome: Outcome) -> RunRecord:
    """Write series and record of a run into its results folder, remove its temporary files, and return the record."""
    record = write_outcome(job, outcome)
    store.write_record(job.folder, record)
    for rest in (job.handover, job.spool):
        rest.remove_file(missing_ok=True)
    return record


def run_and_store(job: Job, send: Send, store: Store, problem: Problem | None = None, **limits: float) -> None:
    """Run a job by ``run_one``, pass its outcome to ``store``, and send the record that this returns.

    ``limits`` are the keywords ``soft`` and ``measure_limit`` of ``run_one``.
    """
    send_record(send, STORED, store(run_one(job, send, problem, **limits)))


def send_record(send: Send, what: str, record: RunRecord) -> None:
    """Send a record on one line that begins with ``what``: ``MEASURING`` or ``STORED``."""
    send(f"{what} {records.format_record(record).replace(chr(10), ' ')}")


def describe_error(error: OSError) -> str:
    """Return the file, if known, and the reason of an error, for a message."""
    return f"{error.filename}: {error.strerror}" if error.filename else str(error)


def measure_kept_steps(job: Job, bare: RunRecord, send: Send, store: Store, problem: Problem | None) -> None:
    """Measure the steps kept by a run whose process ended before it could; pass the outcome to ``store``.

    ``bare``, the record of how the process ended, is sent first, the record that ``store`` returns at the end. This
    process is limited in memory and CPU time from then on.
    """
    send_record(send, MEASURING, bare)
    job.handover.remove_file(missing_ok=True)
    limit_process(job.spec.memory, STOPPED_MEASURE_LIMIT, CODE_LIMIT)
    send_record(send, STORED, store(measure_run(job, bare, problem)))


class RunProcess(ForkedProcess):
    """The process of a run, which sends its record before it ends, or the reason why it has none.

    ``work(send)`` is what the process does. With ``salvages`` it only measures the steps that an earlier process of the
    run has kept.
    """

    def __init__(
        self,
        job: Job,
        work: Callable[[Send], object],
        measure_limit: float = MEASURE_LIMIT,
        stderr: Path | ConfinedPath = NOWHERE,
        *,
        salvages: bool = False,
    ) -> None:
        limit = job.spec.cpu_limit + GRACE  # the process enforces it itself, unless its solver prevents that
        super().__init__(
            work,
            limit=limit + measure_limit,
            wall=SLACK * (limit + PATIENCE),
            memory=math.inf,
            stderr=stderr,
            above="itself",
            code=2.0 * CODE_LIMIT,  # for its solver and for measuring
        )
        self.job, self.measure_limit = job, SLACK * measure_limit
        self.began, self.stopped, self.measuring = time.monotonic(), False, False
        self.salvages = salvages
        self.solving, self.unbegun = salvages, ""  # whether its solver has begun, or why it has not

    def check_end(self) -> ProcessEnd | None:
        """Return how the process ended, None while it runs.

        As soon as it reports that it measures, a limit on the wall time of measuring is set.
        """
        ended = super().check_end()
        if ended is None and not self.measuring and f"\n{MEASURING} " in f"\n{self.read_lines()}":
            self.measuring, self.deadline = True, time.monotonic() + self.measure_limit
        return ended

    def measure_partial(self, bare: RunRecord, store: Store, problem: Problem | None = None) -> "RunProcess | None":
        """Start a process that measures the steps that this run kept, and return it.

        Return None if measuring had begun already, or if no steps were kept. ``bare`` is the record of how the run
        ended; ``store`` writes the outcome and returns its record.
        """
        if self.salvages or self.measuring or not self.job.spool.is_own_file():
            return None

        def work(send: Send) -> None:
            """Measure the kept steps."""
            measure_kept_steps(self.job, bare, send, store, problem)

        return RunProcess(self.job, work, STOPPED_MEASURE_LIMIT, salvages=True)

    def stop(self) -> None:
        """End the solver, as its suite has reached its limit; limit the time to measure the steps that it had kept."""
        self.stopped = True
        if not self.measuring:
            os.kill(self.pid, signal.SIGTERM)
            self.measure_limit = SLACK * STOPPED_MEASURE_LIMIT
        else:
            self.deadline = min(self.deadline, time.monotonic() + STOPPED_MEASURE_LIMIT)

    def read_outcome(self, ended: ProcessEnd) -> tuple[RunRecord, bool]:
        """Return the run's record, and whether the process itself stored it; ``ended`` is how the process ended.

        If it sent no record, one is made from ``ended``. Raise OSError if the disk is full, NotBegunError if its solver
        did not begin, FileError if it sent what is not its record.
        """
        sent = self._read_records(ended.sent)
        self.measuring = MEASURING in sent
        if ended.code == 0 and STORED in sent:
            return sent[STORED], True
        if ended.code == CANNOT_WRITE:
            raise OSError(errno.ENOSPC, FULL, str(self.job.folder))
        wall = time.monotonic() - self.began
        if MEASURING not in sent:  # the process ended before its solver
            if self.stopped:
                return make_cut_short_record(
                    self.job, EndCause.TOTAL_LIMIT, ended_limit_s=self.job.total_limit, wall_s=wall
                ), False
            if not self.solving:
                raise NotBegunError(self.unbegun or ended.unbegun or f"the process of the run {ended.words}")
            return record_unfinished(self.job, ended, wall, EndCause.WALL_LIMIT, math.nan), False
        bare = sent[MEASURING]
        if bare.ended_by != EndCause.EXIT or bare.exit_code != 0:
            return bare, False
        late = dataclasses.replace(ended, killed=ended.at_limit)
        return record_unfinished(self.job, late, wall, EndCause.MEASURE_LIMIT, self.measure_limit), False

    def _read_records(self, sent: str) -> dict[str, RunRecord]:
        """Return the records in the complete lines of ``sent``, by ``MEASURING`` or ``STORED``.

        Set ``solving`` and ``unbegun``, by which the solver has begun or has not, and why. Raise FileError unless the
        records are those of this run, each once and in this order.
        """
        lines = [line.partition(" ")[::2] for line in sent.split("\n")[:-1]]
        ahead = dict(line for line in lines if line[0] in (SOLVING, UNBEGUN))
        self.solving, self.unbegun = self.salvages or SOLVING in ahead, ahead.get(UNBEGUN, "")
        lines = [line for line in lines if line[0] not in ahead]
        found = {what: records.parse_record_json(text) for what, text in lines if text}
        bare = found.get(MEASURING)
        if (
            [what for what, text in lines if text] not in ([], [MEASURING], [STORED], [MEASURING, STORED])
            or any(r.run_id != self.job.id for r in found.values())
            or (bare is not None and bare.status not in CUT_SHORT)
        ):
            raise FileError("the process of the run sent what is not its record")
        return found
