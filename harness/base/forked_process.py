"""Run code in a separate process: end it at its limits with all that it started, and return what it sent."""

import contextlib
import math
import os
import select
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from .clock import cpu_by_process, cpu_seconds, cpu_seconds_below, list_descendants
from .code_meter import CodePage, CodeReading, listen_to_numba, prepare_child_page, report_code_time
from .confined_paths import ConfinedPath
from .isolation import BEGUN, PATIENCE, Target, end_descendants, fork, kill_descendants, kill_group
from .memory import bound_memory, measure_memory, measure_own_memory

Limit = Literal["", "cpu", "wall", "code", "memory"]
Above = Literal["keeper", "here", "itself"]
NOWHERE = Path(os.devnull)
SLACK = 10.0  # wall time allowed per CPU time, on a machine that does other work too
# [s] between two measurements of a tree's CPU time, each a walk through /proc; a limit is passed by that much
EVERY = 0.2
# [s] between two checks while nothing is sent: an end is noticed late by it; shorter takes time from the run
TICK = 0.02
MOST = 2**24  # [bytes] most that a process may send, before its pipe is closed
CHUNK, AT_ONCE = 2**16, 16  # [bytes] of a read, and reads between two checks of the limits
MAXRSS = 2.0**-20 if sys.platform == "darwin" else 2.0**-10  # [MB] unit of ru_maxrss: bytes on macOS, else kB
ASLEEP = 2.0  # [s] between two checks; longer means that this process was stopped


class NotBegunError(RuntimeError):
    """Signal that a process ended before its target began, so that nothing is known of the target."""


@dataclass(frozen=True)
class ProcessEnd:
    """The end of a process: its exit code or the limit that ended it, the lines that it sent, and what it used."""

    code: int  # the exit code, or minus the signal that ended it
    killed: bool  # killed by us, at its limit or before
    sent: str  # the lines it sent
    peak: float  # [MB] largest resident memory
    suspended: bool = False  # True if this process was stopped meanwhile, so that clocks say little
    cpu: float = math.inf  # [s] CPU time of all its threads and all that it started, in whatever session
    over: Limit = ""  # the limit at which it was killed
    code_s: float = 0.0  # [s] CPU time of making code, as its meter reported, at most ``cpu``
    unbegun: str = ""  # why its target never began, through no fault of the target

    @property
    def at_limit(self) -> bool:
        """True if it was ended at a limit, by us or by the system at the same limit on CPU time."""
        return self.killed or self.code == -signal.SIGXCPU

    def describe_limit(self, limit: float, memory: float) -> str:
        """Return ``timed out after 30 s`` or the memory exceeded; empty if no limit ended it.

        ``limit`` [s] and ``memory`` [MB] are the limits to name.
        """
        words = f"took more than {memory:g} MB" if self.over == "memory" else f"timed out after {limit:g} s"
        return words if self.at_limit else ""

    @property
    def words(self) -> str:
        """The ending in words: ``ended by SIGSEGV`` or ``exited with code 3``."""
        known = -self.code in set(signal.Signals)
        return f"ended by {signal.Signals(-self.code).name}" if known else f"exited with code {self.code}"


class ForkedProcess:
    """A forked process with limits, watched by calls of ``check_end`` or by ``wait``."""

    def __init__(
        self,
        target: Target,
        *,
        limit: float,
        memory: float,
        wall: float | None = None,
        stderr: Path | ConfinedPath = NOWHERE,
        above: Above = "keeper",
        code: float = 0.0,
    ) -> None:
        """Start ``target(send)`` with ``limit`` [s] of CPU time and ``memory`` [MB], including all that it starts.

        The memory is that beyond what is loaded here. The system enforces the limits on each process, this class on the
        sum. After ``wall`` [s] the process is killed, too: a safety net against waiting without end, by default
        ``SLACK`` times the limit, for a busy machine. Its standard error goes to the file ``stderr``. ``above`` says
        who ends the processes that it leaves running: a keeper, this process (``here``; it must have adopted orphans
        and have no other children), or the process itself. The time of making code that its meter reports does not
        count towards the limits on time; it has a limit of its own, ``code`` [s], 0 for processes that make none.
        """
        self.above, self.code = above, code
        self.memory = memory + measure_own_memory() if math.isfinite(memory) else math.inf  # [MB] of its tree
        page, slot = prepare_child_page() if code else (CodePage(), 0)
        self._reading = CodeReading(page, slot)

        def begin(send: Callable[[str], None]) -> object:
            """Report the time of making code if that has a limit, and run the target."""
            if code:
                listen_to_numba()
                report_code_time(page, slot)
            return target(send)

        self.pid, self.pipe = fork(begin, stderr, memory, limit, keeper=above == "keeper", code=code)
        self.root = os.getpid() if above == "here" else self.pid
        os.set_blocking(self.pipe, False)
        self.limit, self.used = limit, dict[int, float]()  # [s], by process
        self.deadline = time.monotonic() + (SLACK * limit if wall is None else wall)
        self.over: Limit = ""
        self._next = self._killed_at = self._used = self._tree = self._seen = 0.0
        self.killed = self.suspended = self.begun = False
        self._looked = time.monotonic()
        self.closed_at = 0.0  # when it closed its pipe: it is about to end
        self._sent = bytearray()

    def read_lines(self) -> str:
        """Read what has arrived through the pipe, without waiting; return all lines that the target has sent so far.

        The first line, by which a process reports that its target began, sets ``begun`` and is left out. The pipe is
        closed at its end, or once more than ``MOST`` bytes have arrived.
        """
        with contextlib.suppress(BlockingIOError):
            for _ in range(AT_ONCE):
                if self.closed_at:
                    break
                chunk = os.read(self.pipe, CHUNK)
                self._sent += chunk
                if not chunk or len(self._sent) > MOST:
                    os.close(self.pipe)
                    self.closed_at = time.monotonic()
        first, _, lines = self._sent.decode(errors="replace").partition("\n")
        self.begun = first == BEGUN
        return lines if self.begun else ""

    def check_end(self) -> ProcessEnd | None:
        """Return how the process ended, or None while it runs; kill it if it has passed a limit.

        Once it has ended, what it left in its process group is killed. Time in which this process itself was stopped
        does not count towards the deadline.
        """
        now = time.monotonic()
        if now - self._looked > ASLEEP:
            self.suspended = True
            self.deadline += now - self._looked
        self._looked = now
        pid, status, usage = os.wait4(self.pid, os.WNOHANG)
        if not pid:
            self.read_lines()
            self._check_limits(now)
            return None
        sent = self.read_lines()
        kill_group(self.pid)  # end what it left behind
        if not self.closed_at:
            os.close(self.pipe)
        code, peak = os.waitstatus_to_exitcode(status), usage.ru_maxrss * MAXRSS
        peak = max(peak, self._tree) if self.over == "memory" else peak
        left = end_descendants()[1] if self.above == "here" else 0.0
        cpu = max(usage.ru_utime + usage.ru_stime + left, sum(self.used.values()))
        if code == -signal.SIGXCPU and self._reading.is_making():
            self.over = "code"
        code_s = min(self._reading.read_seconds(cpu), cpu)
        ended = ProcessEnd(code, self.killed and code != 0, sent, peak, self.suspended, cpu, self.over, code_s)
        if self.begun:
            return ended
        said = self._sent.decode(errors="replace").strip()
        return replace(ended, unbegun=said or f"its process {'was ended by us' if self.killed else ended.words}")

    @property
    def code_seconds(self) -> float:
        """The CPU time of making code [s] that its meter reports, at most all CPU time that was measured.

        Until that is measured, at most twice the limit ``code``.
        """
        return min(self._reading.read_seconds(self._used), self._used or 2.0 * self.code)

    def _check_limits(self, now: float) -> None:
        """Kill the process if its tree has passed a limit on CPU time, memory or time of making code, or its deadline.

        The system limits each process only; here the sum is limited. ``now`` [s] is a reading of ``time.monotonic``. A
        process group that has survived being killed for ``2 PATIENCE`` is killed again.
        """
        if self.killed:
            if now > self._killed_at + 2.0 * PATIENCE:
                kill_group(self.pid)
            return
        if now > self._next and (math.isfinite(self.limit) or self.code or math.isfinite(self.memory)):
            self._next = now + EVERY
            self._check_memory()
            self.used |= cpu_by_process(self.root)
            own = cpu_seconds() if self.above == "here" else 0.0
            # the parent that waited knows of short children
            used = max(sum(self.used.values()), cpu_seconds_below(self.root) - own)
            self._used = used
        code_s = self.code_seconds
        solving, late = self._used - code_s, self.deadline + SLACK * min(code_s, self.code)
        self.over = "code" if code_s > self.code + 1.0 else "cpu" if solving > self.limit + 1.0 else ""
        self.over = "wall" if now > late else "memory" if self._tree > self.memory else self.over
        if self.over:
            self.kill()

    def _check_memory(self) -> None:
        """Measure the memory of the process tree, and record it in ``_tree`` if two consecutive values pass the limit.

        The exact measurement, page by page, is made only if a quick upper bound, which counts shared pages repeatedly,
        exceeds the limit.
        """
        if math.isfinite(self.memory):
            tree = (*list_descendants(self.root), *((self.pid,) if self.above == "itself" else ()))
            if bound_memory(tree) > self.memory:
                seen = measure_memory(tree)
                # measured twice: shared pages count repeatedly while a process ends
                if min(seen, self._seen) > self.memory:
                    self._tree = max(self._tree, seen)
                self._seen = seen

    def wait(self, unwanted: Callable[[], bool] = lambda: False) -> ProcessEnd:
        """Wait for the end of the process and return it; kill the process once ``unwanted()``, or on Ctrl-C.

        Raise NotBegunError if its target never began, though nobody killed it.
        """
        ended = self.wait_for_end(unwanted)
        if ended.unbegun and not ended.killed:
            raise NotBegunError(f"a process could not begin its work: {ended.unbegun}")
        return ended

    def wait_for_end(self, unwanted: Callable[[], bool] = lambda: False) -> ProcessEnd:
        """Wait for the end as ``wait`` does, but return it also if the target never began."""
        ended = None
        try:
            while (ended := self.check_end()) is None:
                if unwanted():
                    self.kill()
                if self.closed_at:
                    time.sleep(0.002)
                else:
                    select.select([self.pipe], [], [], TICK)
        except BaseException:  # on Ctrl-C, too, no process is left behind
            self.kill()
            if ended is None:
                os.waitpid(self.pid, 0)
            raise
        return ended

    def kill(self) -> None:
        """Kill the process with all that it started."""
        if not self.killed:
            self.killed, self._killed_at = True, time.monotonic()
            if self.above != "keeper":
                kill_descendants(self.root)
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGTERM if self.above == "keeper" else signal.SIGKILL)  # its keeper ends all
