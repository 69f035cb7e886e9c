"""Runs on this machine: a supervisor process that forks them, ``size`` at a time.

An executor is anything with such a ``run``; a cluster's would be another.
"""

import contextlib
import json
import os
import select
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..results.environment import ROOT, THREADS
from ..results.records import RunRecord
from ..results.store import write_record
from ..types import EndedBy, Status
from .job import Job, record_of
from .supervisor import STOP, WARM
from .warmup import runs_to_warm

TICK = 0.25  # [s] between two looks at the clock


class PoolError(RuntimeError):
    """The runs cannot be run here; finished ones are stored."""


@dataclass(frozen=True)
class TimeLimit:
    """When a whole run has to end."""

    until: float  # of time.monotonic()
    seconds: float  # [s] as the suite gives it


@dataclass
class LocalPool:
    """Runs jobs, telling when each starts and ends; ``tick`` is called a few times a second."""

    size: int
    started: Callable[[Job], None] = lambda job: None
    ended: Callable[[Job], None] = lambda job: None
    tick: Callable[[], None] = lambda: None
    warmed: Callable[[dict[str, float]], None] = lambda times: None
    _flying: dict[str, Job] = field(default_factory=dict)
    _compiling: bool = False
    _attempts: dict[str, int] = field(default_factory=dict)
    _limit: TimeLimit | None = None
    _stopped: bool = False

    def run(self, jobs: Sequence[Job], limit: TimeLimit | None = None) -> None:
        """Run all ``jobs``; returns when each has a record, or at the limit, when those that had begun have one."""
        self._limit = limit
        waiting = list(jobs)[::-1]
        deaths = 0
        while waiting or self._flying:
            before = len(waiting)
            code = self._serve(waiting)
            if code is None:
                return
            deaths = deaths + 1 if len(waiting) == before else 1  # the supervisor died; a run may have done it
            if deaths > 3 and not self._over():
                raise PoolError(f"the supervisor process ends with code {code} again and again")
            for job in self._flying.values():
                if (job.folder / "runs" / f"{job.id}.json").exists():  # done; the word of it went with the supervisor
                    self.ended(job)
                elif self._limit is not None and self._over():
                    write_record(job.folder, _out_of_time(job, self._limit))
                    self.ended(job)
                elif self._attempts[job.id] < 2:
                    waiting.append(job)  # at the end: it goes next, and alone
                else:
                    lost = {"exit_code": max(code, 0), "signal": max(-code, 0)}
                    write_record(
                        job.folder, record_of(job, Status.CRASHED, ended_by=str(EndedBy.SUPERVISOR_LOST), **lost)
                    )
                    self.ended(job)
            self._flying.clear()

    def _serve(self, waiting: list[Job]) -> int | None:
        """One supervisor's life; None when all is done, else its exit code."""
        process = subprocess.Popen(
            (sys.executable, "-m", "mbsbench.harness.execution.supervisor"),
            cwd=ROOT,
            env={**os.environ, **THREADS},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # a signal to our group is for us: we close its input, and it ends what runs, whole
        )
        assert process.stdin is not None and process.stdout is not None
        pending = b""
        try:
            self._warm(process, waiting)
            while True:
                if self._limit is not None and self._over():
                    waiting.clear()
                    self._compiling = False
                    self._stop(process, self._limit.seconds)
                while waiting and not self._compiling and self._is_room_for(waiting[-1]):
                    self._send(process, waiting.pop())
                if not self._flying and not self._compiling:
                    return None
                ready, _, _ = select.select([process.stdout], [], [], TICK)
                self.tick()
                if not ready:
                    continue
                chunk = os.read(process.stdout.fileno(), 2**16)
                if not chunk:
                    return process.wait()
                *lines, pending = (pending + chunk).split(b"\n")
                for line in lines:
                    self._receive(json.loads(line))
        except BrokenPipeError:
            return process.wait()
        finally:
            with contextlib.suppress(OSError):  # it is gone, and what we had to say with it
                process.stdin.close()  # tells it to kill what runs and to leave
            process.wait()
            process.stdout.close()

    def _is_room_for(self, job: Job) -> bool:
        """One that a supervisor died with runs alone: if that happens again, it was this one."""
        alone = job.id in self._attempts or any(self._attempts[j.id] > 1 for j in self._flying.values())
        return not self._flying if alone else len(self._flying) < self.size

    def _over(self) -> bool:
        return self._limit is not None and time.monotonic() > self._limit.until

    def _stop(self, process: subprocess.Popen, limit: float) -> None:
        """Once: end what runs."""
        if self._stopped or not self._flying:
            return
        self._stopped = True
        assert process.stdin is not None
        process.stdin.write(STOP + str(limit).encode() + b"\n")
        process.stdin.flush()

    def _warm(self, process: subprocess.Popen, waiting: list[Job]) -> None:
        """Let the supervisor compile before any clock runs."""
        specs = [spec.to_plain() for spec in runs_to_warm([job.spec for job in reversed(waiting)])]
        self._compiling = bool(specs)
        if not specs:
            return
        assert process.stdin is not None
        process.stdin.write(WARM + json.dumps(specs).encode() + b"\n")
        process.stdin.flush()

    def _send(self, process: subprocess.Popen, job: Job) -> None:
        self._flying[job.id] = job
        self._attempts[job.id] = self._attempts.get(job.id, 0) + 1
        self.started(job)
        assert process.stdin is not None
        process.stdin.write((job.to_json() + "\n").encode())
        process.stdin.flush()

    def _receive(self, answer: dict[str, Any]) -> None:
        if "warm" in answer:
            self._compiling = False
            self.warmed(answer["warm"])
            return
        job = self._flying.pop(answer["run"])
        if answer["error"]:
            raise PoolError(answer["error"])
        self.ended(job)


def _out_of_time(job: Job, limit: TimeLimit) -> RunRecord:
    return record_of(job, Status.STALLED, ended_by=str(EndedBy.TOTAL_LIMIT), ended_limit_s=limit.seconds)
