"""Fork one process for each run, enforce its limits, and ensure that every run ends with a record.

``mbsbench.harness.run.supervisor`` is the long-lived, single-threaded parent of the runs: orders come as lines on
standard input, news is written as lines (module protocol). At the end of its input (the runner has ended) it kills the
runs in progress and exits.
"""

import contextlib
import dataclasses
import os
import select
import signal
import sys
import time
from collections.abc import Iterator
from functools import partial

from ..base.clock import cpu_seconds_below
from ..base.code_meter import listen_to_numba
from ..base.confined_paths import ConfinedPath
from ..base.files import FileError
from ..base.forked_process import NotBegunError, ProcessEnd
from ..base.isolation import adopt_orphans, end_orphans, protect_process, trim_output
from ..catalogue import registry
from ..catalogue.mechanism import load_readers
from ..mechanics.types import Problem
from ..results import store
from ..results.records import RunRecord
from .job import Job
from .protocol import CodeTime, Order, Reader, RunEnded, StartOrder, StopOrder, WarmUpOrder, WarmUpTimes, encode_message
from .run import SOLVING, RunProcess, describe_error, run_and_store, store_outcome
from .warmup import fill_caches

POLL = 0.1  # [s] between two checks of the limits; each wakes a process beside the timed ones
NEWS = 0.5  # [s] of CPU time for warm-up and code generation after which it is reported again


class Supervisor:
    """The runs in progress: ``start`` each, and call ``step`` until it has ended."""

    def __init__(self) -> None:
        self.running: dict[int, RunProcess] = {}  # by process number
        self.code_before = 0.0  # [s] of CPU in warm-up, and for code generation of runs that have ended

    def start(self, job: Job) -> None:
        """Start the process of a run; ``step`` reports its end."""
        problem = _create_problem(job)
        keep = partial(store_outcome, job)
        run = RunProcess(job, lambda send: run_and_store(job, send, keep, problem), stderr=_name_stderr(job))
        self.running[run.pid] = run

    def step(self, timeout: float = POLL, inputs: tuple[int, ...] = ()) -> Iterator[RunEnded]:
        """Wait up to ``timeout`` [s] for runs or ``inputs``, enforce the limits, and yield the runs that have ended.

        ``inputs`` are further descriptors that end the wait when they can be read. Processes that ended runs have left
        behind are killed.
        """
        ending = any(r.closed_at and time.monotonic() - r.closed_at < 1.0 for r in self.running.values())
        pipes = [r.pipe for r in self.running.values() if not r.closed_at]
        select.select([*pipes, *inputs], [], [], 0.002 if ending else timeout)
        for run in list(self.running.values()):
            if (ended := run.check_end()) is not None:
                del self.running[run.pid]
                self.code_before += ended.code_s
                end_orphans(self.running)
                if (done := self._finish(run, ended)) is not None:
                    yield done

    def _finish(self, run: RunProcess, ended: ProcessEnd) -> RunEnded | None:
        """Ensure that an ended run has a record, and return the report of its end.

        If its process left no record, one is written, and another process is started to measure the steps that the run
        had kept, if any: None is returned until that has ended.
        """
        job = run.job
        try:
            trim_output(_name_stderr(job))
            record, stored = read_outcome(run, ended)
            if not stored:
                store.write_record(job.folder, record)
                if (more := run.measure_partial(record, partial(store_outcome, job))) is not None:
                    self.running[more.pid] = more
                    return None
        except OSError as error:
            return RunEnded(job.id, error=f"cannot write to {job.folder}: {error.strerror or error}")
        except NotBegunError as error:
            return RunEnded(job.id, unbegun=str(error))
        return RunEnded(job.id, store.digest_record(record))

    @property
    def code_seconds(self) -> float:
        """CPU time [s] of warm-up and code generation so far, which no limit counts."""
        return self.code_before + sum(run.code_seconds for run in self.running.values())

    def stop(self) -> None:
        """End every running run, because the suite has reached its limit; each gets a record with the steps it kept."""
        for run in self.running.values():
            run.stop()

    def kill_all(self) -> None:
        """Kill every running run and wait for its end; no records are written."""
        for run in self.running.values():
            run.kill()
            os.waitpid(run.pid, 0)


def _create_problem(job: Job) -> Problem | None:
    """Return the problem of a job, created once in this process for all runs of it; their forks inherit it untouched.

    Return None for a problem that is not our own, as a plugin's code or a mechanism's file is loaded where limits hold,
    and for one that cannot be created.
    """
    spec = job.spec
    if job.plugins or not registry.is_own_problem(spec.problem):
        return None
    with contextlib.suppress(Exception):  # its run will report it
        return registry.share_problem(spec.problem, spec.parameters)
    return None


def _name_stderr(job: Job) -> ConfinedPath:
    """Return the file for the standard error of a job's measuring process."""
    return job.spool.sibling(f"{job.id}.stderr")


def read_outcome(run: RunProcess, ended: ProcessEnd) -> tuple[RunRecord, bool]:
    """Return the run's record, and whether the process itself stored it, as ``RunProcess.read_outcome`` does.

    What a solver wrote into the pipe to the parent process, and is no record, is ignored.
    """
    try:
        return run.read_outcome(ended)
    except FileError:
        # it must have begun, since it has written
        return run.read_outcome(dataclasses.replace(ended, sent=f"{SOLVING} 1\n"))


def serve(orders: int, news: int) -> None:
    """Carry out the orders read from the descriptor ``orders``, and write reports to the descriptor ``news``.

    Return when ``orders`` is closed; runs that are still in progress then are killed.
    """
    protect_process()
    adopt_orphans()
    supervisor, reader = Supervisor(), Reader(Order)
    reported = 0.0  # [s] of warm-up and code generation in the last report
    os.set_blocking(orders, False)
    try:
        while True:
            for done in list(supervisor.step(POLL if supervisor.running else 3600.0, (orders,))):
                os.write(news, encode_message(done))
            if supervisor.code_seconds > reported + NEWS:
                os.write(news, encode_message(CodeTime(reported := supervisor.code_seconds)))
            try:
                chunk = os.read(orders, 2**16)
            except BlockingIOError:
                continue
            if not chunk:
                return
            for order in reader.messages(chunk):
                match order:
                    case WarmUpOrder(specs, jobs):
                        before = cpu_seconds_below(os.getpid())
                        fill_caches(
                            specs,
                            jobs,
                            lambda: _is_closed(orders),
                            lambda times, references: os.write(news, encode_message(WarmUpTimes(times, references))),
                        )
                        supervisor.code_before += cpu_seconds_below(os.getpid()) - before
                        os.write(news, encode_message(CodeTime(reported := supervisor.code_seconds)))
                        os.write(news, encode_message(WarmUpTimes({}, {}, over=True)))
                    case StopOrder():
                        supervisor.stop()
                    case StartOrder(job):
                        try:
                            # fails where another file has this name: no run can be judged then
                            job.stderr.parent.make_folder()
                        except OSError as error:
                            why = f"cannot write to {job.folder}: {describe_error(error)}"
                            os.write(news, encode_message(RunEnded(job.id, error=why)))
                        else:
                            supervisor.start(job)
    finally:
        supervisor.kill_all()


def _is_closed(descriptor: int) -> bool:
    """Return whether the pipe with this descriptor has no writer any more."""
    poll = select.poll()
    poll.register(descriptor, select.POLLHUP)
    return any(event & select.POLLHUP for _, event in poll.poll(0))


def preload() -> None:
    """Import all problems, solvers and readers, so that forks inherit them, and exempt them from garbage collection.

    Otherwise the collector would write to their memory pages in each fork, which would copy them.
    """
    import gc

    listen_to_numba()
    for catalogue in (registry.problems(), registry.solvers()):
        tuple(catalogue.values())
    load_readers()
    gc.collect()
    gc.freeze()


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is handled by the runner, which then closes our input
    answers = os.dup(1)
    os.dup2(2, 1)  # standard output is reserved for news
    preload()
    sys.stdout.flush()
    serve(0, answers)
