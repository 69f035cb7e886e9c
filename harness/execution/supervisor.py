"""Forks one process a run, keeps its limits, and sees that every run ends as a record.

``mbsbench.supervisor`` is the long-lived, single-threaded parent of the runs: jobs come as JSON lines on
standard input, the address of each finished run goes out as one. ``stop LIMIT`` ends every running run as
stalled at the suite's limit [s]. At the end of its input (the runner is gone) it kills what runs and leaves.
"""

import json
import math
import os
import select
import selectors
import signal
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass

from ..catalogue import registry
from ..results import store
from ..results.records import RunRecord
from ..sandbox.isolation import CANNOT_WRITE, Child, fork, kill_group, trim
from ..suites.spec import RunSpec
from ..types import EndedBy, Status
from . import worker
from .job import Job, record_of
from .warmup import warm_apart_then_here

GRACE = 2.0  # [s] over the wall limit, then killed: a solver was asked to stop at 0.9 of the limit
MEASURE_LIMIT = 120.0  # [s] for metrics once the solver is done, reference included
STOPPED_MEASURE_LIMIT = 10.0  # [s] for the steps a run had kept, when the whole run is stopped
POLL = 0.1  # [s]
WARM = b"warm "  # begins the line that asks for compilation ahead of the runs
STOP = b"stop "  # begins the line that ends all runs, followed by the limit of the suite [s]


@dataclass
class Running:
    """A run on its way."""

    job: Job
    child: Child
    began: float
    deadline: float
    measuring: bool = False
    closed: float = 0.0  # when its pipe closed: it is about to end
    killed: str = ""
    instead: RunRecord | None = None  # of the run, already gone, whose kept steps this process measures


@dataclass(frozen=True)
class Ended:
    """A run whose process is gone. Its record is stored, unless ``error`` says why it could not be."""

    job: Job
    error: str = ""


class Supervisor:
    """The running runs. ``start`` one, ``step`` until it comes back."""

    def __init__(self) -> None:
        self.running: dict[int, Running] = {}  # by pipe
        self.selector = selectors.DefaultSelector()
        self.stopped: float | None = None  # [s] the limit of the suite, once it was met

    def start(self, job: Job) -> None:
        """Fork the run's process."""
        now = time.monotonic()
        limit = job.spec.wall_limit + GRACE
        child = fork(lambda tell: _run(job, tell), job.stderr, job.spec.memory, limit + MEASURE_LIMIT)
        os.set_blocking(child.phase, False)
        self.running[child.phase] = Running(job, child, now, now + limit)
        self.selector.register(child.phase, selectors.EVENT_READ)

    def step(self, timeout: float = POLL) -> Iterator[Ended]:
        """Wait up to ``timeout`` for news, keep the limits, and yield the runs that ended."""
        now = time.monotonic()
        ending = any(run.closed and now - run.closed < 1.0 for run in self.running.values())
        for key, _ in self.selector.select(0.002 if ending else timeout):
            run = self.running.get(key.fd)
            if run is not None:
                self._heard(run)
        for run in list(self.running.values()):
            if time.monotonic() > run.deadline and not run.killed:
                run.killed = "measuring" if run.measuring else "wall"
                kill_group(run.child.pid)
            pid, status, usage = os.wait4(run.child.pid, os.WNOHANG)
            if pid:
                ended = self._ended(run, os.waitstatus_to_exitcode(status), usage.ru_maxrss / 1024.0)
                if ended is not None:
                    yield ended

    def stop(self, limit: float) -> None:
        """End every running run now: the suite has met its limit [s]. Each comes back with the steps it had kept."""
        self.stopped = limit
        for run in self.running.values():
            if run.instead is not None:
                run.deadline = min(run.deadline, time.monotonic() + STOPPED_MEASURE_LIMIT)
            elif not run.killed:
                run.killed = "stop"
                kill_group(run.child.pid)

    def kill_all(self) -> None:
        """End every running run, without records."""
        for run in self.running.values():
            kill_group(run.child.pid)
            os.waitpid(run.child.pid, 0)

    def _heard(self, run: Running) -> None:
        told = os.read(run.child.phase, 64)
        if told.startswith(b"m"):
            run.measuring, run.deadline = True, time.monotonic() + MEASURE_LIMIT
        if not told:
            run.closed = time.monotonic()
            self.selector.unregister(run.child.phase)

    def _ended(self, run: Running, exit_code: int, peak: float) -> Ended | None:
        """What became of a process; None when the steps it left are being measured first."""
        kill_group(run.child.pid)  # what the run may have started and left behind
        if not run.closed:
            self.selector.unregister(run.child.phase)
        os.close(run.child.phase)
        del self.running[run.child.phase]
        job, written = run.job, run.job.folder / "runs" / f"{run.job.id}.json"
        if run.instead is None:
            trim(job.stderr)
        if exit_code == 0 and written.exists() and not run.killed:
            job.spool.unlink(missing_ok=True)
            return Ended(job)
        if exit_code == CANNOT_WRITE:
            return Ended(job, f"cannot write to {job.folder}: no space left")
        record = run.instead or _bare(run, exit_code, peak, self.stopped)
        if run.instead is None and not run.measuring and job.spool.exists() and job.spool.stat().st_size > 0:
            self._salvage(run, record)
            return None
        try:
            store.write_record(job.folder, record)
        except OSError as error:
            return Ended(job, f"cannot write to {job.folder}: {error.strerror or error}")
        job.spool.unlink(missing_ok=True)
        return Ended(job)

    def _salvage(self, run: Running, record: RunRecord) -> None:
        """Measure, in a process of its own, the steps that a run kept before it was ended."""
        job, words = run.job, run.job.spool.with_suffix(".stderr")

        def measure_and_store(tell: object) -> None:
            for plugin in job.plugins:
                registry.load_plugin(plugin)
            store.write_record(job.folder, worker.salvaged(job, record))

        limit = STOPPED_MEASURE_LIMIT if self.stopped is not None else MEASURE_LIMIT
        child = fork(measure_and_store, words, job.spec.memory, limit)
        os.set_blocking(child.phase, False)
        until = time.monotonic() + limit
        self.running[child.phase] = Running(job, child, run.began, until, measuring=True, instead=record)
        self.selector.register(child.phase, selectors.EVENT_READ)


def _bare(run: Running, exit_code: int, peak: float, stopped: float | None) -> RunRecord:
    """The record of a process that left none."""
    status, by, limit = explain(run, exit_code, peak)
    if run.killed == "stop":
        status, by, limit = Status.STALLED, EndedBy.TOTAL_LIMIT, stopped or math.nan
    return record_of(
        run.job,
        status,
        ended_by=str(by),
        ended_limit_s=limit,
        exit_code=max(exit_code, 0),
        signal=max(-exit_code, 0),
        wall_s=time.monotonic() - run.began,
        peak_memory_MB=peak,
    )


def explain(run: Running, exit_code: int, peak: float) -> tuple[Status, EndedBy, float]:
    """Status, end and limit [s] of a process that left no record."""
    if run.killed == "wall":
        return Status.STALLED, EndedBy.WALL_LIMIT, run.job.spec.wall_limit + GRACE
    if run.killed == "measuring":
        return Status.CRASHED, EndedBy.MEASURE_LIMIT, MEASURE_LIMIT
    if exit_code == -signal.SIGXCPU:
        return Status.STALLED, EndedBy.CPU_LIMIT, math.nan
    if exit_code < 0:
        if peak > 0.9 * run.job.spec.memory:
            return Status.MEMORY, EndedBy.MEMORY_LIMIT, math.nan
        return Status.CRASHED, EndedBy.SIGNAL, math.nan
    return Status.CRASHED, EndedBy.EXIT, math.nan


def _run(job: Job, tell: object) -> None:
    worker.run(job, tell)  # type: ignore[arg-type]


def serve(jobs: int, results: int) -> None:
    """Read jobs from the descriptor ``jobs``, write a line to ``results`` for each that ended; leave at its end."""
    supervisor = Supervisor()
    supervisor.selector.register(jobs, selectors.EVENT_READ)
    os.set_blocking(jobs, False)
    pending = b""
    try:
        while True:
            for end in list(supervisor.step(POLL if supervisor.running else 3600.0)):
                os.write(results, (json.dumps({"run": end.job.id, "error": end.error}) + "\n").encode())
            try:
                chunk = os.read(jobs, 2**16)
            except BlockingIOError:
                continue
            if not chunk:
                return
            *lines, pending = (pending + chunk).split(b"\n")
            for line in lines:
                if line.startswith(WARM):
                    specs = [RunSpec.from_plain(plain) for plain in json.loads(line.removeprefix(WARM))]
                    answer = {"warm": warm_apart_then_here(specs, lambda: _closed(jobs))}
                    os.write(results, (json.dumps(answer) + "\n").encode())
                elif line.startswith(STOP):
                    supervisor.stop(float(line.removeprefix(STOP)))
                else:
                    supervisor.start(Job.from_json(line.decode()))
    finally:
        supervisor.kill_all()


def _closed(descriptor: int) -> bool:
    """Whether nobody can write to this pipe any more."""
    poll = select.poll()
    poll.register(descriptor, select.POLLHUP)
    return any(event & select.POLLHUP for _, event in poll.poll(0))


def preload() -> None:
    """Import what runs need, so that forks have it; freeze it, so that the collector does not copy its pages."""
    import gc

    from ..catalogue import registry

    registry.problems()
    registry.solvers()
    gc.collect()
    gc.freeze()


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the runner, which then closes our input
    answers = os.dup(1)
    os.dup2(2, 1)  # nothing else may write into the answers
    preload()
    sys.stdout.flush()
    serve(0, answers)
