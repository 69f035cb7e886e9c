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
from collections.abc import Iterator
from dataclasses import dataclass

from ..catalogue import registry
from ..metrics import compiled
from ..results import store
from ..results.records import RunRecord
from ..sandbox.apart import SLACK, Apart, Ended
from ..sandbox.isolation import CANNOT_WRITE, trim
from ..types import EndedBy
from . import worker
from .job import GRACE, Job, cut_short, unfinished
from .protocol import Done, Order, Reader, Start, Stop, Warm, Warmed, line_of
from .warmup import references_apart, warm_apart_then_here

MEASURE_LIMIT = 120.0  # [s] of CPU time for metrics once the solver is done, reference included
STOPPED_MEASURE_LIMIT = 10.0  # [s] for the steps a run had kept, when the suite is stopped
POLL = 0.1  # [s]


@dataclass
class Running:
    """A run on its way: the process of its solver, or the one that measures what that left."""

    job: Job
    process: Apart
    began: float
    limit: float  # [s] of wall time at which the process is killed
    by: EndedBy = EndedBy.WALL_LIMIT  # what it is then ended by
    bare: RunRecord | None = None  # while it is measured: how its solver's process ended


class Supervisor:
    """The running runs. ``start`` one, ``step`` until it is done."""

    def __init__(self) -> None:
        self.running: dict[int, Running] = {}  # by process
        self.stopped = False

    def start(self, job: Job) -> None:
        """Fork the process of the run's solver."""
        limit = job.spec.cpu_limit + GRACE
        wall = SLACK * limit
        process = Apart(
            lambda send: worker.hand_over(job), limit=limit, wall=wall, memory=job.spec.memory, stderr=job.stderr
        )
        self.running[process.pid] = Running(job, process, time.monotonic(), wall)

    def step(self, timeout: float = POLL, inputs: tuple[int, ...] = ()) -> Iterator[Done]:
        """Wait up to ``timeout`` [s] for news or ``inputs``, keep the limits, and yield the runs that ended."""
        processes = [run.process for run in self.running.values()]
        ending = any(p.closed_at and time.monotonic() - p.closed_at < 1.0 for p in processes)
        pipes = [p.pipe for p in processes if not p.closed_at]
        select.select([*pipes, *inputs], [], [], 0.002 if ending else timeout)
        for run in list(self.running.values()):
            ended = run.process.look()
            if ended is not None:
                del self.running[run.process.pid]
                yield from self._solved(run, ended) if run.bare is None else self._measured(run, run.bare, ended)

    def stop(self, limit: float) -> None:
        """End every running run: the suite has met its limit [s]. Each gets a record, with the steps it had kept."""
        self.stopped = True
        for run in self.running.values():
            if run.bare is not None:
                run.process.deadline = min(run.process.deadline, time.monotonic() + STOPPED_MEASURE_LIMIT)
            elif not run.process.killed:
                run.by, run.limit = EndedBy.TOTAL_LIMIT, limit
                run.process.kill()

    def kill_all(self) -> None:
        """End every running run, without records."""
        for run in self.running.values():
            run.process.kill()
            os.waitpid(run.process.pid, 0)

    def _solved(self, run: Running, ended: Ended) -> Iterator[Done]:
        """The solver's process is gone; what it handed over or kept is measured by another that knows nothing of it."""
        job, wall = run.job, time.monotonic() - run.began
        if ended.code == CANNOT_WRITE:
            yield Done(job.id, f"cannot write to {job.folder}: no space left")
            return
        try:
            trim(job.stderr)
            store.path_of(job.folder, job.id).remove_file(missing_ok=True)  # not for the solver's process to write
            bare = unfinished(job, ended, wall, run.by, run.limit)
        except OSError as error:  # the run left what cannot be removed: it alone fails
            yield Done(job.id, _store_failure(job, wall, error))
            return
        limit = STOPPED_MEASURE_LIMIT if self.stopped else MEASURE_LIMIT
        process = Apart(
            lambda send: worker.store_measured(job, bare, wall, ended.cpu), limit=limit, memory=job.spec.memory,
            stderr=job.spool.sibling(f"{job.id}.stderr"),
        )  # fmt: skip
        self.running[process.pid] = Running(job, process, run.began, SLACK * limit, EndedBy.MEASURE_LIMIT, bare)

    def _measured(self, run: Running, bare: RunRecord, ended: Ended) -> Iterator[Done]:
        """A measuring process that failed leaves the bare record: how the solver's process, or it, has ended."""
        job, failed = run.job, ""
        if ended.code == CANNOT_WRITE:
            failed = "no space left"
        elif ended.code != 0 and not store.path_of(job.folder, job.id).is_there():
            wall = time.monotonic() - run.began
            own = bare.ended_by != EndedBy.EXIT or bare.exit_code != 0
            try:
                store.write_record(job.folder, bare if own else unfinished(job, ended, wall, run.by, run.limit))
            except OSError as error:
                failed = str(error.strerror or error)
        yield Done(job.id, f"cannot write to {job.folder}: {failed}" if failed else "")


def _store_failure(job: Job, wall: float, error: OSError) -> str:
    """Store that the run ended with ``error``; why this is impossible, else empty."""
    try:
        store.write_record(job.folder, cut_short(job, EndedBy.EXCEPTION, message=_words(error), wall_s=wall))
    except OSError as another:
        return f"cannot write to {job.folder}: {_words(another)}"
    return ""


def _words(error: OSError) -> str:
    return f"{error.filename}: {error.strerror}" if error.filename else str(error)


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
                        compiled.load()  # what measures
                        references = references_apart(jobs, lambda: _closed(orders))
                        os.write(news, line_of(Warmed({}, references)))
                        warm_apart_then_here(
                            specs, lambda: _closed(orders), lambda times: os.write(news, line_of(Warmed(times, {})))
                        )
                        os.write(news, line_of(Warmed({}, {}, over=True)))
                    case Stop(limit):
                        supervisor.stop(limit)
                    case Start(job):
                        try:
                            job.stderr.parent.make()  # where something stands in its place, no run can be judged
                        except OSError as error:
                            os.write(news, line_of(Done(job.id, f"cannot write to {job.folder}: {_words(error)}")))
                        else:
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

    for catalogue in (registry.problems(), registry.solvers()):
        tuple(catalogue.values())
    gc.collect()
    gc.freeze()


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the runner, which then closes our input
    answers = os.dup(1)
    os.dup2(2, 1)  # nothing else may write into the answers
    preload()
    sys.stdout.flush()
    serve(0, answers)
