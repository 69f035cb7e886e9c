"""Code run in a process of its own: started, ended at its limit with all that it started, and what it sent back."""

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

from ..clock import cpu_by_process, cpu_seconds, cpu_seconds_below, descendants
from ..code_meter import CodePage, CodeReading, listen_to_numba, page_for_child, report_to
from ..places import Place
from .isolation import BEGUN, PATIENCE, Target, end_descendants, fork, kill_descendants, kill_group
from .memory import megabytes, megabytes_at_most, own_megabytes

Limit = Literal["", "cpu", "wall", "code", "memory"]
Above = Literal["keeper", "here", "itself"]
NOWHERE = Path(os.devnull)
SLACK = 10.0  # wall time for a second of CPU, on a machine that does other work too
EVERY = 0.2  # [s] between two looks at the CPU time of a tree
TICK = 0.02  # [s] between two looks while nothing is sent
MOST = 2**24  # [bytes] that a process may send; its pipe is closed then
CHUNK, AT_ONCE = 2**16, 16  # [bytes] of a read, and reads before the limits are looked at again
MAXRSS = 2.0**-20 if sys.platform == "darwin" else 2.0**-10  # [MB] unit of ru_maxrss: bytes on macOS, else kB
ASLEEP = 2.0  # [s] between two looks: more, and it is we who were stopped


class NotBegunError(RuntimeError):
    """A process ended before what it was to run began: nothing is known of that, and nothing is kept."""


@dataclass(frozen=True)
class Ended:
    """How a process ended."""

    code: int  # its exit code, or minus the signal that ended it
    killed: bool  # by us, at its limit or before
    sent: str  # the lines it sent
    peak: float  # [MB] largest resident memory
    suspended: bool = False  # time passed in which nobody looked: its clocks say little
    cpu: float = math.inf  # [s] of all its threads, and of all that it started, in whatever session
    over: Limit = ""  # the limit at which it was killed
    code_s: float = 0.0  # [s] that making code took, as its meter reported, at most ``cpu``
    unbegun: str = ""  # why its target never began: no fault of its target

    @property
    def at_limit(self) -> bool:
        """Whether it was ended at a limit: by us, or by the system at the same limit on CPU time."""
        return self.killed or self.code == -signal.SIGXCPU

    def describe_limit(self, limit: float, memory: float) -> str:
        """``timed out after 30 s``, or the memory that it took; empty where no limit, [s] and [MB], ended it."""
        words = f"took more than {memory:g} MB" if self.over == "memory" else f"timed out after {limit:g} s"
        return words if self.at_limit else ""

    @property
    def words(self) -> str:
        """``ended by SIGSEGV`` or ``exited with code 3``."""
        known = -self.code in set(signal.Signals)
        return f"ended by {signal.Signals(-self.code).name}" if known else f"exited with code {self.code}"


class Apart:
    """A forked process, watched by ``look`` or ``wait``."""

    def __init__(
        self, target: Target, *, limit: float, memory: float, wall: float | None = None,
        stderr: Path | Place = NOWHERE, above: Above = "keeper", code: float = 0.0,
    ) -> None:  # fmt: skip
        """Run ``target(send)`` with ``limit`` [s] of CPU time and ``memory`` [MB], all that it starts included.

        The memory is that beyond what is loaded here. The system keeps the limit on each process; ours is on the sum.

        After ``wall`` [s] it is killed, too: a safety net for what waits without end, ``SLACK`` times the limit unless
        given. What a busy machine slows down stays within it. ``above`` names who ends what it leaves: a keeper, this
        process (which has adopted orphans, and has no other children), or the process itself. The time of making code
        that its meter reports is left out of both limits, up to ``code`` [s], which is a limit of its own.
        """
        self.above, self.code = above, code
        self.memory = memory + own_megabytes() if math.isfinite(memory) else math.inf  # [MB] of its tree
        page, slot = page_for_child() if code else (CodePage(), 0)
        self._reading = CodeReading(page, slot)

        def begin(send: Callable[[str], None]) -> object:
            if code:
                listen_to_numba()
                report_to(page, slot)
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

    def hear(self) -> str:
        """Return the lines that its target has sent so far."""
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

    def look(self) -> Ended | None:
        """None while it runs; kills it past its deadline, from which time in which we were stopped is left out."""
        now = time.monotonic()
        if now - self._looked > ASLEEP:
            self.suspended = True
            self.deadline += now - self._looked
        self._looked = now
        pid, status, usage = os.wait4(self.pid, os.WNOHANG)
        if not pid:
            self.hear()
            self._check_limits(now)
            return None
        sent = self.hear()
        kill_group(self.pid)  # what it started and left behind
        if not self.closed_at:
            os.close(self.pipe)
        code, peak = os.waitstatus_to_exitcode(status), usage.ru_maxrss * MAXRSS
        peak = max(peak, self._tree) if self.over == "memory" else peak
        left = end_descendants()[1] if self.above == "here" else 0.0
        cpu = max(usage.ru_utime + usage.ru_stime + left, sum(self.used.values()))
        if code == -signal.SIGXCPU and self._reading.is_making():
            self.over = "code"
        code_s = min(self._reading.seconds(cpu), cpu)
        ended = Ended(code, self.killed and code != 0, sent, peak, self.suspended, cpu, self.over, code_s)
        if self.begun:
            return ended
        said = self._sent.decode(errors="replace").strip()
        return replace(ended, unbegun=said or f"its process {'was ended by us' if self.killed else ended.words}")

    @property
    def code_seconds(self) -> float:
        """CPU time [s] of making code, as its meter reports, and no more than it has used as far as that is known."""
        return min(self._reading.seconds(self._used), self._used or 2.0 * self.code)

    def _check_limits(self, now: float) -> None:
        """On the sum over its tree: the limit that the system keeps is on each process."""
        if self.killed:
            if now > self._killed_at + 2.0 * PATIENCE:
                kill_group(self.pid)
            return
        if now > self._next and (math.isfinite(self.limit) or self.code or math.isfinite(self.memory)):
            self._next = now + EVERY
            self._check_memory()
            self.used |= cpu_by_process(self.root)
            own = cpu_seconds() if self.above == "here" else 0.0
            used = max(sum(self.used.values()), cpu_seconds_below(self.root) - own)  # who waited knows short children
            self._used = used
        code_s = self.code_seconds
        solving, late = self._used - code_s, self.deadline + SLACK * min(code_s, self.code)
        self.over = "code" if code_s > self.code + 1.0 else "cpu" if solving > self.limit + 1.0 else ""
        self.over = "wall" if now > late else "memory" if self._tree > self.memory else self.over
        if self.over:
            self.kill()

    def _check_memory(self) -> None:
        """Look at each page only where the sum that counts shared ones repeatedly is over the limit."""
        if math.isfinite(self.memory):
            tree = (*descendants(self.root), *((self.pid,) if self.above == "itself" else ()))
            if megabytes_at_most(tree) > self.memory:
                seen = megabytes(tree)
                if min(seen, self._seen) > self.memory:  # twice: what is shared counts more than once while one ends
                    self._tree = max(self._tree, seen)
                self._seen = seen

    def wait(self, unwanted: Callable[[], bool] = lambda: False) -> Ended:
        """Wait for its end, or end it once it is ``unwanted``. An exception here ends it too.

        NotBegunError where its target never began, though nobody ended it.
        """
        ended = self.watch(unwanted)
        if ended.unbegun and not ended.killed:
            raise NotBegunError(f"a process could not begin its work: {ended.unbegun}")
        return ended

    def watch(self, unwanted: Callable[[], bool] = lambda: False) -> Ended:
        """As ``wait``, but how it ended where its target never began, too."""
        ended = None
        try:
            while (ended := self.look()) is None:
                if unwanted():
                    self.kill()
                if self.closed_at:
                    time.sleep(0.002)
                else:
                    select.select([self.pipe], [], [], TICK)
        except BaseException:
            self.kill()
            if ended is None:
                os.waitpid(self.pid, 0)
            raise
        return ended

    def kill(self) -> None:
        """End it with all that it started."""
        if not self.killed:
            self.killed, self._killed_at = True, time.monotonic()
            if self.above != "keeper":
                kill_descendants(self.root)
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGTERM if self.above == "keeper" else signal.SIGKILL)  # its keeper ends all
