"""Execute runs on this machine by a supervisor process that forks them, ``size`` at a time.

Any object with such a ``run`` is an executor (``runner.Executor``); ``cluster.DaskPool`` is another.
"""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from ..base.clock import cpu_seconds_below
from ..base.code_meter import add_code_below, code_seconds_of_tree
from ..base.forked_process import SLACK
from ..mechanics.types import EndCause
from ..results.store import digest_record, write_record
from .costs import LAWS, WarmCaches, name_reference
from .job import Job, make_cut_short_record
from .protocol import CodeTime, News, StartOrder, StopOrder, Supervised, SupervisorLost, WarmUpOrder, WarmUpTimes
from .warmup import list_runs_to_warm, select_job_per_motion

# [s] between two readings of the clock: longer makes the bar jump, shorter wakes this process beside timed ones
TICK = 0.25
MOST_UNBEGUN = 3  # runs in a row that could not begin, after which no other is tried


class PoolError(RuntimeError):
    """Signal that runs cannot be executed or have no result; finished ones are stored."""


@dataclass(frozen=True)
class TimeLimit:
    """A limit on the CPU time of all runs of a suite together: ``seconds`` for each run in parallel, from ``start`` on.

    Code generation is not counted. ``SLACK`` times as much wall time is a safety net for runs that wait. On a cluster
    there is no limit on CPU time, and wall time of ``seconds`` is the limit.
    """

    seconds: float
    until: float = math.inf  # reading of time.monotonic()
    process: int = 0  # ancestor of the processes of all runs
    most: float = math.inf  # [s] of CPU that it and its descendants may have taken
    code_before: float = 0.0  # [s] of code generation before the limit began

    def start(self, process: int = 0, size: int = 1) -> "TimeLimit":
        """Return a copy of the limit that starts now.

        With ``process``, the id of a supervisor process that runs ``size`` runs at a time, CPU time is limited, and
        wall time to ``SLACK`` times as much; with 0 only wall time is limited.
        """
        slack = SLACK if process else 1.0
        most = cpu_seconds_below(process) + size * self.seconds if process else math.inf
        return TimeLimit(self.seconds, time.monotonic() + slack * self.seconds, process, most, code_seconds_of_tree())

    @property
    def is_over(self) -> bool:
        """True if the wall time or the CPU time has passed its limit."""
        code = code_seconds_of_tree() - self.code_before
        late = time.monotonic() > self.until + SLACK * code
        return late or (math.isfinite(self.most) and cpu_seconds_below(self.process) > self.most + code)


@dataclass
class StartFailures:
    """Keep the reasons why runs could not begin, which are no faults of their solvers."""

    words: list[str] = field(default_factory=list)
    in_a_row: int = 0

    def add(self, words: str) -> None:
        """Record why a run could not begin; raise PoolError after so many in a row that no other is likely to begin."""
        self.words.append(words)
        self.in_a_row += 1
        if self.in_a_row >= MOST_UNBEGUN:
            self.check()

    def check(self) -> None:
        """Raise PoolError if any run could not begin, with the number of these runs and the first reason."""
        if self.words:
            count, first = len(self.words), self.words[0]
            raise PoolError(
                f"{count} run{'s' * (count > 1)} could not begin, which says nothing of their solvers: "
                f"{first}; run again with --resume"
            )


@dataclass
class LocalPool:
    """Run jobs, reporting when each starts and ends; ``tick`` is called a few times a second."""

    size: int
    on_start: Callable[[Job], None] = lambda job: None
    on_end: Callable[[Job, str], None] = lambda job, sha256: None  # with the digest of its record
    tick: Callable[[], None] = lambda: None
    on_warmup: Callable[[dict[str, float], dict[str, float]], None] = lambda times, references: None
    environ: Mapping[str, str] = field(default_factory=dict)  # additional variables for the processes of runs
    ahead: Supervised | None = None  # a supervisor that was started while the runs were not known yet
    _flying: dict[str, Job] = field(default_factory=dict)  # begun and not ended, by run_id
    _compiling: bool = False  # no run begins until code is compiled
    _attempts: dict[str, int] = field(default_factory=dict)  # times that a run has begun, by run_id
    _limit: TimeLimit | None = None
    _stopped: bool = False  # the supervisor has been ordered to end all runs
    _code_seconds: float = 0.0  # [s] of code generation that this supervisor has reported
    _prepared: set[str] = field(default_factory=set)  # solvers and references that are compiled or computed
    _unbegun: StartFailures = field(default_factory=StartFailures)

    def run(self, jobs: Sequence[Job], limit: TimeLimit | None = None) -> None:
        """Run all ``jobs``; return when each has a record, or at the limit, when those that had begun have one.

        Raise PoolError if supervisors die repeatedly, or at the end if runs could not begin.
        """
        self._limit = limit
        self._run(list(jobs)[::-1], jobs)
        if self.ahead is not None:  # nothing waited for it
            self.ahead.discard()
            self.ahead = None
        self._unbegun.check()

    def _run(self, waiting: list[Job], jobs: Sequence[Job]) -> None:
        """Run the ``waiting`` jobs, the last of the list first, and empty the list; ``jobs`` are all jobs of the call.

        If the supervisor dies, another one goes on. A job during which a supervisor died is run once more, alone; if
        that supervisor dies too, the job gets a record that says so. Raise PoolError if supervisors die repeatedly
        although no job begins.
        """
        self._attempts = {job.id: 1 for job in jobs if job.alone}
        deaths = 0
        while waiting or self._flying:
            before = len(waiting)
            code = self._serve(waiting)
            if code is None:
                return
            deaths = deaths + 1 if len(waiting) == before else 1  # the supervisor died; a run may have caused it
            if deaths > 3 and not self._is_over():
                raise PoolError(f"the supervisor process ended repeatedly with code {code}")
            for job in self._flying.values():
                if self._limit is not None and self._is_over():
                    ending = make_cut_short_record(job, EndCause.TOTAL_LIMIT, ended_limit_s=self._limit.seconds)
                elif self._attempts[job.id] < 2 + job.alone:
                    waiting.append(job)  # last in the list: it runs next, and alone; no record of it was reported
                    continue
                else:
                    ending = make_cut_short_record(
                        job, EndCause.SUPERVISOR_LOST, exit_code=max(code, 0), signal=max(-code, 0)
                    )
                write_record(job.folder, ending)
                self.on_end(job, digest_record(ending))
            self._flying.clear()

    def _serve(self, waiting: list[Job]) -> int | None:
        """Run jobs by one supervisor; return None when all are done, or its exit code (minus a signal) if it dies.

        Their code is compiled first. Jobs that begin are removed from ``waiting``, and all others at the limit on time.
        Those that run when the supervisor dies stay in ``_flying``.
        """
        supervisor, self.ahead = self.ahead or Supervised(self.environ), None
        self._code_seconds = 0.0
        try:
            first = waiting[::-1]
            if first:  # before any limit on time starts
                supervisor.send(
                    WarmUpOrder(list_runs_to_warm([job.spec for job in first]), select_job_per_motion(first))
                )
            self._compiling = bool(first)
            while True:
                if self._limit is not None and self._is_over():
                    waiting.clear()
                    self._compiling = False
                    if self._flying and not self._stopped:
                        self._stopped = True
                        supervisor.send(StopOrder())
                while waiting and not self._compiling and self._is_room_for(waiting[-1]):
                    self._send_job(supervisor, waiting.pop())
                if not self._flying and not self._compiling:
                    return None
                news = supervisor.receive(TICK)
                self.tick()
                for message in news:
                    self._apply_news(message, supervisor.process.pid)
        except SupervisorLost as lost:
            return lost.code
        finally:
            supervisor.close()

    def _is_room_for(self, job: Job) -> bool:
        """Return whether a job may start: fewer than ``size`` jobs run, or none if one of them must run alone.

        A job during which a supervisor died, or that must run alone for another reason, has attempts already.
        """
        alone = job.id in self._attempts or any(self._attempts[j.id] > 1 for j in self._flying.values())
        return not self._flying if alone else len(self._flying) < self.size

    def _is_over(self) -> bool:
        """Return whether the runs have reached their limit on time, if there is one."""
        return self._limit is not None and self._limit.is_over

    def _send_job(self, supervisor: Supervised, job: Job) -> None:
        """Order the supervisor to begin a job; count the attempt and call ``on_start``."""
        self._flying[job.id] = job
        self._attempts[job.id] = self._attempts.get(job.id, 0) + 1
        self.on_start(job)
        supervisor.send(StartOrder(job))

    def _apply_news(self, news: News, supervisor: int) -> None:
        """Apply one message of the supervisor with process id ``supervisor``; call ``on_warmup`` or ``on_end``.

        The end of the warm-up lets runs begin and starts the limit. Raise PoolError if a run reports an error that
        concerns all runs, such as a folder that cannot be written.
        """
        if isinstance(news, CodeTime):
            add_code_below(news.seconds - self._code_seconds)
            self._code_seconds = news.seconds
            return
        if isinstance(news, WarmUpTimes):
            self.on_warmup(news.times, news.references)
            self._prepared |= {*news.times, *map(name_reference, news.references)}
            if news.over:
                self._compiling = False
                WarmCaches().add([LAWS, *sorted(self._prepared)])
                if self._limit is not None and self._limit.until == math.inf:
                    self._limit = self._limit.start(supervisor, self.size)
            return
        job = self._flying.pop(news.run_id)
        if news.error:
            raise PoolError(news.error)
        if news.unbegun:
            self._unbegun.add(news.unbegun)
            return
        self._unbegun.in_a_row = 0
        self.on_end(job, news.sha256)
