"""Forks one process a run, keeps its limits, and sees that every run ends as a record.

``mbsbench.harness.execution.supervisor`` is the long-lived, single-threaded parent of the runs: orders come as lines on
standard input, news go out as lines (module protocol). At the end of its input (the runner is gone) it kills what
runs and leaves.
"""

import dataclasses
import os
import select
import signal
import sys
import time
from collections.abc import Iterator
from functools import partial

from ..catalogue import registry
from ..clock import cpu_seconds_below
from ..code_meter import listen_to_numba
from ..files import FileError
from ..places import Place
from ..results import store
from ..results.records import RunRecord
from ..sandbox.apart import Ended, NotBegunError
from ..sandbox.isolation import adopt_orphans, end_orphans, shut_out, trim
from .job import Job
from .protocol import CodeTime, Done, Order, Reader, Start, Stop, Warm, Warmed, line_of
from .run import SOLVING, Run, run_and_store, store_outcome, words_of
from .warmup import prepare

POLL = 0.1  # [s]
NEWS = 0.5  # [s] of CPU for code until it is told


class Supervisor:
    """The running runs. ``start`` one, ``step`` until it is done."""

    def __init__(self) -> None:
        self.running: dict[int, Run] = {}  # by process
        self.code_before = 0.0  # [s] of CPU in warm-up, and for code of runs that have ended

    def start(self, job: Job) -> None:
        """Fork the process of the run."""
        run = Run(job, lambda send: run_and_store(job, send), stderr=_own_stderr(job))
        self.running[run.pid] = run

    def step(self, timeout: float = POLL, inputs: tuple[int, ...] = ()) -> Iterator[Done]:
        """Wait up to ``timeout`` [s] for news or ``inputs``, keep the limits, and yield the runs that ended."""
        ending = any(r.closed_at and time.monotonic() - r.closed_at < 1.0 for r in self.running.values())
        pipes = [r.pipe for r in self.running.values() if not r.closed_at]
        select.select([*pipes, *inputs], [], [], 0.002 if ending else timeout)
        for run in list(self.running.values()):
            if (ended := run.look()) is not None:
                del self.running[run.pid]
                self.code_before += ended.code_s
                end_orphans(self.running)
                if (done := self._finish(run, ended)) is not None:
                    yield done

    def _finish(self, run: Run, ended: Ended) -> Done | None:
        """See that the run has a record; None while the steps that it had kept are measured for it."""
        job = run.job
        try:
            trim(_own_stderr(job))
            record, stored = outcome_of(run, ended)
            if not stored:
                store.write_record(job.folder, record)
                if (more := run.salvage(record, partial(store_outcome, job))) is not None:
                    self.running[more.pid] = more
                    return None
        except OSError as error:
            return Done(job.id, error=f"cannot write to {job.folder}: {error.strerror or error}")
        except NotBegunError as error:
            return Done(job.id, unbegun=str(error))
        return Done(job.id, store.digest_of(record))

    @property
    def code_seconds(self) -> float:
        """CPU time [s] that no budget counts."""
        return self.code_before + sum(run.code_seconds for run in self.running.values())

    def stop(self) -> None:
        """End every running run: the suite has met its limit. Each gets a record, with the steps it had kept."""
        for run in self.running.values():
            run.stop()

    def kill_all(self) -> None:
        """End every running run, without records."""
        for run in self.running.values():
            run.kill()
            os.waitpid(run.pid, 0)


def _own_stderr(job: Job) -> Place:
    """Where the process that measures writes what no solver wrote."""
    return job.spool.sibling(f"{job.id}.stderr")


def outcome_of(run: Run, ended: Ended) -> tuple[RunRecord, bool]:
    """The run's ``outcome``; where a solver wrote what is no record into its parent's pipe, that is left out."""
    try:
        return run.outcome(ended)
    except FileError:
        return run.outcome(dataclasses.replace(ended, sent=f"{SOLVING} 1\n"))  # it began, or it could not have written


def serve(orders: int, news: int) -> None:
    """Take orders from the descriptor ``orders``, write to ``news``; leave at the end of the orders."""
    shut_out()
    adopt_orphans()
    supervisor, reader = Supervisor(), Reader(Order)
    told = 0.0
    os.set_blocking(orders, False)
    try:
        while True:
            for done in list(supervisor.step(POLL if supervisor.running else 3600.0, (orders,))):
                os.write(news, line_of(done))
            if supervisor.code_seconds > told + NEWS:
                os.write(news, line_of(CodeTime(told := supervisor.code_seconds)))
            try:
                chunk = os.read(orders, 2**16)
            except BlockingIOError:
                continue
            if not chunk:
                return
            for order in reader.messages(chunk):
                match order:
                    case Warm(specs, jobs):
                        before = cpu_seconds_below(os.getpid())
                        prepare(
                            specs, jobs, lambda: _is_closed(orders),
                            lambda times, references: os.write(news, line_of(Warmed(times, references))),
                        )  # fmt: skip
                        supervisor.code_before += cpu_seconds_below(os.getpid()) - before
                        os.write(news, line_of(CodeTime(told := supervisor.code_seconds)))
                        os.write(news, line_of(Warmed({}, {}, over=True)))
                    case Stop():
                        supervisor.stop()
                    case Start(job):
                        try:
                            job.stderr.parent.make()  # where something stands in its place, no run can be judged
                        except OSError as error:
                            why = f"cannot write to {job.folder}: {words_of(error)}"
                            os.write(news, line_of(Done(job.id, error=why)))
                        else:
                            supervisor.start(job)
    finally:
        supervisor.kill_all()


def _is_closed(descriptor: int) -> bool:
    """Whether no one can write to this pipe any more."""
    poll = select.poll()
    poll.register(descriptor, select.POLLHUP)
    return any(event & select.POLLHUP for _, event in poll.poll(0))


def preload() -> None:
    """Import what runs need, so that forks have it; freeze it, so that the collector does not copy its pages."""
    import gc

    listen_to_numba()
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
