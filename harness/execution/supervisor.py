"""Forks one process a run, keeps its limits, and sees that every run ends as a record.

``mbsbench.harness.execution.supervisor`` is the long-lived, single-threaded parent of the runs: orders come as lines on
standard input, news go out as lines (module protocol). At the end of its input (the runner is gone) it kills what
runs and leaves.
"""

import os
import select
import signal
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from ..catalogue import registry
from ..results import store
from ..results.records import RunRecord
from ..sandbox.apart import Apart, Ended
from ..sandbox.isolation import CANNOT_WRITE, trim
from ..types import EndedBy
from . import worker
from .job import Job, unfinished
from .protocol import Done, Order, Reader, Start, Stop, Warm, Warmed, line_of
from .warmup import references_apart, warm_apart_then_here

GRACE = 2.0  # [s] over the wall limit, then killed: a solver was asked to stop at 0.9 of the limit
MEASURE_LIMIT = 120.0  # [s] for metrics once the solver is done, reference included
STOPPED_MEASURE_LIMIT = 10.0  # [s] for the steps a run had kept, when the suite is stopped
POLL = 0.1  # [s]


@dataclass
class Running:
    """A run on its way, or the process that measures what it left."""

    job: Job
    process: Apart
    began: float
    limit: float  # [s] at which the process is killed
    by: EndedBy = EndedBy.WALL_LIMIT  # what it is then ended by
    instead: RunRecord | None = None  # of the run, already gone, whose kept steps this process measures


class Supervisor:
    """The running runs. ``start`` one, ``step`` until it is done."""

    def __init__(self) -> None:
        self.running: dict[int, Running] = {}  # by process
        self.stopped = False

    def start(self, job: Job) -> None:
        """Fork the run's process."""
        limit = job.spec.wall_limit + GRACE
        self._fork(lambda send: worker.run(job, send), job, limit, cpu=limit + MEASURE_LIMIT, stderr=job.stderr)

    def _fork(self, target: Callable[[Any], object], job: Job, limit: float, instead: RunRecord | None = None,
              **options: Any) -> None:  # fmt: skip
        process = Apart(target, limit=limit, memory=job.spec.memory, **options)
        self.running[process.pid] = Running(job, process, time.monotonic(), limit, instead=instead)

    def step(self, timeout: float = POLL, inputs: tuple[int, ...] = ()) -> Iterator[Done]:
        """Wait up to ``timeout`` [s] for news or ``inputs``, keep the limits, and yield the runs that ended."""
        processes = [run.process for run in self.running.values()]
        ending = any(p.closed_at and time.monotonic() - p.closed_at < 1.0 for p in processes)
        pipes = [p.pipe for p in processes if not p.closed_at]
        select.select([*pipes, *inputs], [], [], 0.002 if ending else timeout)
        for run in list(self.running.values()):
            if run.by is EndedBy.WALL_LIMIT and run.instead is None and worker.MEASURING in run.process.hear():
                run.by, run.limit = EndedBy.MEASURE_LIMIT, MEASURE_LIMIT  # the solver is done: another limit counts
                run.process.deadline = time.monotonic() + MEASURE_LIMIT
            ended = run.process.look()
            if ended is not None:
                del self.running[run.process.pid]
                yield from self._ended(run, ended)

    def stop(self, limit: float) -> None:
        """End every running run: the suite has met its limit [s]. Each gets a record, with the steps it had kept."""
        self.stopped = True
        for run in self.running.values():
            if run.instead is not None:
                run.process.deadline = min(run.process.deadline, time.monotonic() + STOPPED_MEASURE_LIMIT)
            elif not run.process.killed:
                run.by, run.limit = EndedBy.TOTAL_LIMIT, limit
                run.process.kill()

    def kill_all(self) -> None:
        """End every running run, without records."""
        for run in self.running.values():
            run.process.kill()
            os.waitpid(run.process.pid, 0)

    def _ended(self, run: Running, ended: Ended) -> Iterator[Done]:
        """What became of a process; nothing yet when the steps it left are measured first."""
        job = run.job
        if run.instead is None:
            trim(job.stderr)
        if ended.code == CANNOT_WRITE:
            yield Done(job.id, f"cannot write to {job.folder}: no space left")
            return
        if ended.code != 0 or ended.killed or not (job.folder / "runs" / f"{job.id}.json").exists():
            record = run.instead or unfinished(job, ended, time.monotonic() - run.began, run.by, run.limit)
            measured = worker.MEASURING in ended.sent or run.instead is not None
            if not measured and job.spool.exists() and job.spool.stat().st_size > 0:
                self._salvage(job, record)
                return
            try:
                store.write_record(job.folder, record)
            except OSError as error:
                yield Done(job.id, f"cannot write to {job.folder}: {error.strerror or error}")
                return
        job.spool.unlink(missing_ok=True)
        yield Done(job.id)

    def _salvage(self, job: Job, record: RunRecord) -> None:
        """Measure, in a process of its own, the steps that a run kept before it was ended."""

        def measure_and_store(send: object) -> None:
            for plugin in job.plugins:
                registry.load_plugin(plugin)
            store.write_record(job.folder, worker.salvaged(job, record))

        limit = STOPPED_MEASURE_LIMIT if self.stopped else MEASURE_LIMIT
        self._fork(measure_and_store, job, limit, record, stderr=job.spool.with_suffix(".stderr"))


def serve(orders: int, news: int) -> None:
    """Take orders from the descriptor ``orders``, write to ``news``; leave at the end of the orders."""
    supervisor, reader = Supervisor(), Reader(Order)
    os.set_blocking(orders, False)
    try:
        while True:
            for done in list(supervisor.step(POLL if supervisor.running else 3600.0, (orders,))):
                os.write(news, line_of(done))
            try:
                chunk = os.read(orders, 2**16)
            except BlockingIOError:
                continue
            if not chunk:
                return
            for order in reader.messages(chunk):
                match order:
                    case Warm(specs, jobs):
                        references = references_apart(jobs, lambda: _closed(orders))
                        times = warm_apart_then_here(specs, lambda: _closed(orders))
                        os.write(news, line_of(Warmed(times, references)))
                    case Stop(limit):
                        supervisor.stop(limit)
                    case Start(job):
                        supervisor.start(job)
    finally:
        supervisor.kill_all()


def _closed(descriptor: int) -> bool:
    """Whether no one can write to this pipe any more."""
    poll = select.poll()
    poll.register(descriptor, select.POLLHUP)
    return any(event & select.POLLHUP for _, event in poll.poll(0))


def preload() -> None:
    """Import what runs need, so that forks have it; freeze it, so that the collector does not copy its pages."""
    import gc

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
