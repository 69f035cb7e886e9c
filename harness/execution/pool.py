"""Runs on this machine: a supervisor process that forks them, ``size`` at a time.

An executor is anything with such a ``run``; a cluster's would be another.
"""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from ..clock import cpu_seconds_below
from ..code_meter import add_code_below, code_seconds_of_tree
from ..results.store import digest_of, write_record
from ..sandbox.apart import SLACK
from ..types import EndedBy
from .costs import LAWS, Prepared, reference_name
from .job import Job, cut_short
from .protocol import CodeTime, Lost, News, Start, Stop, Supervised, Warm, Warmed
from .warmup import jobs_by_motion, runs_to_warm

TICK = 0.25  # [s] between two looks at the clock
MOST_UNBEGUN = 3  # runs in a row that did not begin: then no other would


class PoolError(RuntimeError):
    """The runs cannot be run here; finished ones are stored."""


@dataclass(frozen=True)
class TimeLimit:
    """CPU time that the runs of a suite may take together, from when the first can begin: [s] for each at a time.

    Making code is left out.
    ``SLACK`` times as much wall time is a safety net, for runs that wait; it is all there is on a cluster.
    """

    seconds: float
    until: float = math.inf  # of time.monotonic()
    process: int = 0  # below which all runs are
    most: float = math.inf  # [s] of CPU that it and all below it may have taken
    code_before: float = 0.0  # [s] of making code before it began

    def start(self, process: int = 0, size: int = 1) -> "TimeLimit":
        """The clock runs; with the supervisor ``process`` of ``size`` runs at a time that on CPU time."""
        slack = SLACK if process else 1.0
        most = cpu_seconds_below(process) + size * self.seconds if process else math.inf
        return TimeLimit(self.seconds, time.monotonic() + slack * self.seconds, process, most, code_seconds_of_tree())

    @property
    def is_over(self) -> bool:
        """Whether either is over."""
        code = code_seconds_of_tree() - self.code_before
        late = time.monotonic() > self.until + SLACK * code
        return late or (math.isfinite(self.most) and cpu_seconds_below(self.process) > self.most + code)


@dataclass
class Unbegun:
    """Runs that ended without a result, through no fault of their solvers, and why."""

    words: list[str] = field(default_factory=list)
    in_a_row: int = 0

    def add(self, words: str) -> None:
        """Note one; PoolError after as many in a row as say that no other would begin."""
        self.words.append(words)
        self.in_a_row += 1
        if self.in_a_row >= MOST_UNBEGUN:
            self.check()

    def check(self) -> None:
        """Raise PoolError where there are any."""
        if self.words:
            count, first = len(self.words), self.words[0]
            raise PoolError(f"{count} run{'s' * (count > 1)} could not begin, which says nothing of their solvers: "
                            f"{first}; run again with --resume")  # fmt: skip


@dataclass
class LocalPool:
    """Runs jobs, telling when each starts and ends; ``tick`` is called a few times a second."""

    size: int
    on_start: Callable[[Job], None] = lambda job: None
    on_end: Callable[[Job, str], None] = lambda job, sha256: None  # with the digest of its record
    tick: Callable[[], None] = lambda: None
    on_warmup: Callable[[dict[str, float], dict[str, float]], None] = lambda times, references: None
    environ: Mapping[str, str] = field(default_factory=dict)  # of the processes of runs, beside ours
    _flying: dict[str, Job] = field(default_factory=dict)
    _compiling: bool = False
    _attempts: dict[str, int] = field(default_factory=dict)
    _limit: TimeLimit | None = None
    _stopped: bool = False
    _code_seconds: float = 0.0
    _prepared: set[str] = field(default_factory=set)
    _unbegun: Unbegun = field(default_factory=Unbegun)

    def run(self, jobs: Sequence[Job], limit: TimeLimit | None = None) -> None:
        """Run all ``jobs``; returns when each has a record, or at the limit, when those that had begun have one."""
        self._limit = limit
        self._run(list(jobs)[::-1], jobs)
        self._unbegun.check()

    def _run(self, waiting: list[Job], jobs: Sequence[Job]) -> None:
        self._attempts = {job.id: 1 for job in jobs if job.alone}
        deaths = 0
        while waiting or self._flying:
            before = len(waiting)
            code = self._serve(waiting)
            if code is None:
                return
            deaths = deaths + 1 if len(waiting) == before else 1  # the supervisor died; a run may have done it
            if deaths > 3 and not self._is_over():
                raise PoolError(f"the supervisor process ended repeatedly with code {code}")
            for job in self._flying.values():
                if self._limit is not None and self._is_over():
                    ending = cut_short(job, EndedBy.TOTAL_LIMIT, ended_limit_s=self._limit.seconds)
                elif self._attempts[job.id] < 2 + job.alone:
                    waiting.append(job)  # at the end: it goes next, and alone; nobody said that a record of it is one
                    continue
                else:
                    ending = cut_short(job, EndedBy.SUPERVISOR_LOST, exit_code=max(code, 0), signal=max(-code, 0))
                write_record(job.folder, ending)
                self.on_end(job, digest_of(ending))
            self._flying.clear()

    def _serve(self, waiting: list[Job]) -> int | None:
        """One supervisor's life; None when all is done, else its exit code."""
        supervisor, self._code_seconds = Supervised(self.environ), 0.0
        try:
            first = waiting[::-1]
            if first:  # before any clock runs
                supervisor.send(Warm(runs_to_warm([job.spec for job in first]), jobs_by_motion(first)))
            self._compiling = bool(first)
            while True:
                if self._limit is not None and self._is_over():
                    waiting.clear()
                    self._compiling = False
                    if self._flying and not self._stopped:
                        self._stopped = True
                        supervisor.send(Stop())
                while waiting and not self._compiling and self._is_room_for(waiting[-1]):
                    self._send(supervisor, waiting.pop())
                if not self._flying and not self._compiling:
                    return None
                news = supervisor.receive(TICK)
                self.tick()
                for message in news:
                    self._receive(message, supervisor.process.pid)
        except Lost as lost:
            return lost.code
        finally:
            supervisor.close()

    def _is_room_for(self, job: Job) -> bool:
        """One that a supervisor died with runs alone: if that happens again, it was this one."""
        alone = job.id in self._attempts or any(self._attempts[j.id] > 1 for j in self._flying.values())
        return not self._flying if alone else len(self._flying) < self.size

    def _is_over(self) -> bool:
        return self._limit is not None and self._limit.is_over

    def _send(self, supervisor: Supervised, job: Job) -> None:
        self._flying[job.id] = job
        self._attempts[job.id] = self._attempts.get(job.id, 0) + 1
        self.on_start(job)
        supervisor.send(Start(job))

    def _receive(self, news: News, supervisor: int) -> None:
        if isinstance(news, CodeTime):
            add_code_below(news.seconds - self._code_seconds)
            self._code_seconds = news.seconds
            return
        if isinstance(news, Warmed):
            self.on_warmup(news.times, news.references)
            self._prepared |= {*news.times, *map(reference_name, news.references)}
            if news.over:
                self._compiling = False
                Prepared().add([LAWS, *sorted(self._prepared)])
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
