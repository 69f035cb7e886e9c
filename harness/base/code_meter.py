"""Measure the CPU time of making code (printing, compiling, linking, loading), which no time of a solver contains.

Making code takes tens of seconds with empty caches and milliseconds with full ones, and says nothing about a method.
Our own functions that make code do so within ``making_code``; numba's events report what numba compiles or loads, for
plugins as well. Each process adds up the time of its threads that make code and reports it to the parent that keeps its
limits. The report is not trusted: the parent bounds it by the CPU time that it has measured.
"""

import contextlib
import gc
import math
import mmap
import os
import resource
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import wraps
from typing import Any, TypeVar, cast

from .clock import cpu_seconds
from .private_interfaces import listen_to_compiler

CODE_LIMIT = 600.0  # [s] CPU time for code generation in one run: that of all our own code takes a tenth of it
PACKAGE = __name__.split(".")[0]
UNSETTLED = 0.2  # [s] of making code after which garbage is collected, which takes up to as long
SLOTS = 4  # most nested processes that report to one page
HARD = 5  # [s] between the soft limit, at which a process is asked to end, and the hard one
Function = TypeVar("Function", bound=Callable[..., Any])


class CodePage:
    """Memory shared with a child and its children, in which each reports its time of making code in its own slot."""

    def __init__(self) -> None:
        self._numbers = memoryview(mmap.mmap(-1, 16 * SLOTS)).cast("d")
        for slot in range(SLOTS):
            self.report(slot, 0.0)

    def report(self, slot: int, seconds: float, since: float = -1.0) -> None:
        """Write to ``slot`` the CPU time [s] that its process spent in closed blocks of making code, and ``since``.

        ``since`` is the process's CPU time [s] at the beginning of the block that is open; -1 if none is open.
        """
        self._numbers[2 * slot], self._numbers[2 * slot + 1] = seconds, since

    def read(self, slot: int) -> tuple[float, float]:
        """Return ``seconds`` and ``since`` as last reported to ``slot`` (see ``report``)."""
        seconds, since = self._numbers[2 * slot : 2 * slot + 2].tolist()
        return seconds, since

    def is_making(self, first: int = 0) -> bool:
        """Return whether the process of slot ``first`` or of a later one makes code now, or did when it ended."""
        return any(self.read(slot)[1] >= 0.0 for slot in range(first, SLOTS))


class CodeReading:
    """A parent's reading of a page: the time of making code of its child and of the processes below it."""

    def __init__(self, page: CodePage, first: int = 0) -> None:
        """Prepare to read the slots of ``page`` from ``first`` on."""
        self.page, self.first = page, first
        self._used = 0.0  # [s] CPU time at the last reading
        self._open = dict[int, tuple[float, float]]()  # by slot: when the open block began, and ``used`` before it

    def read_seconds(self, used: float) -> float:
        """Read the page and return the CPU time spent on making code so far [s].

        ``used`` [s] is the CPU time so far of all processes that report to it together. While a block is open, all that
        they use counts as making code, from the last reading before the block began or, if that is later, from
        ``since`` of its process.
        """
        total = 0.0
        for slot in range(self.first, SLOTS):
            seconds, since = self.page.read(slot)
            total += seconds if seconds >= 0.0 else 0.0
            if not since >= 0.0:
                self._open.pop(slot, None)
                continue
            if self._open.get(slot, (-1.0, 0.0))[0] != since:  # a block that began after the last reading
                self._open[slot] = since, self._used
            total += max(used - max(since, self._open[slot][1]), 0.0)
        self._used = used
        return total

    def is_making(self) -> bool:
        """Return whether one of the processes read makes code now, or did when it ended."""
        return self.page.is_making(self.first)


class _Thread(threading.local):
    """The blocks that a thread has open, and its CPU time when it opened the first."""

    depth = 0  # blocks open
    began = 0.0  # [s]


@dataclass
class _Process:
    """The meter of this process."""

    closed: float = 0.0  # [s] in closed blocks
    below: float = 0.0  # [s] by processes started from here
    page: CodePage | None = None  # to which it reports, if any
    slot: int = 0  # its slot there
    collected: float = 0.0  # [s] of ``closed`` whose garbage has been collected
    soft_limit: int = 0  # [s] CPU time without code at which the system ends this process; 0 for none
    lock: Any = field(default_factory=threading.Lock)


_thread, _process = _Thread(), _Process()


def _reset_meter() -> None:
    """Set the meter to zero in a forked child, whose CPU time starts at zero."""
    global _thread, _process
    _thread, _process = _Thread(), _Process()


os.register_at_fork(after_in_child=_reset_meter)


def _open_block() -> None:
    """Open a block of making code in this thread; the outermost block reports its start and raises the time limit."""
    _thread.depth += 1
    if _thread.depth == 1:
        _thread.began = time.thread_time()
        if _process.page:
            _process.page.report(_process.slot, _process.closed + _process.below, cpu_seconds())
        _move_limit(making=True)


def _close_block() -> None:
    """Close this thread's innermost block; if it is the outermost, count and report its time, and lower the limit."""
    if _thread.depth == 1:
        with _process.lock:
            _process.closed += time.thread_time() - _thread.began
        if _process.page:
            _process.page.report(_process.slot, _process.closed + _process.below)
        _move_limit(making=False)
    _thread.depth = max(_thread.depth - 1, 0)


def _check_caller(space: dict[str, Any]) -> None:
    """Raise RuntimeError unless the caller, whose global names are ``space``, belongs to this package.

    Otherwise a plugin could hide its own time; plugins return ``setup_time`` instead.
    """
    caller = str(space.get("__name__", ""))
    if caller.split(".")[0] != PACKAGE:
        raise RuntimeError(f"making_code is for {PACKAGE} itself: return setup_time instead (called by {caller})")


class _MakingCode:
    """A context manager and decorator that counts CPU time as that of making code, not of the solver."""

    def __enter__(self) -> None:
        _check_caller(sys._getframe(1).f_globals)
        _open_block()

    def __exit__(self, *exception: object) -> None:
        _close_block()

    def __call__(self, function: Function) -> Function:
        """Return the function with its CPU time counted as that of making code; only for functions of this package."""
        _check_caller(sys._getframe(1).f_globals)

        @wraps(function)
        def make(*given: Any, **named: Any) -> Any:
            with making_code:
                return function(*given, **named)

        return cast(Function, make)


making_code = _MakingCode()


def collect_garbage() -> None:
    """Collect the garbage of compilers as part of making code; otherwise it is collected in the time of a solver."""
    if _process.closed - _process.collected > UNSETTLED:
        with making_code:
            gc.collect()
        _process.collected = _process.closed


def is_making_code() -> bool:
    """Return whether this thread is making code."""
    return _thread.depth > 0


def code_seconds() -> float:
    """Return the CPU time [s] of making code in this process so far, the block that this thread has open included."""
    return _process.closed + (time.thread_time() - _thread.began if _thread.depth else 0.0)


def code_seconds_of_tree() -> float:
    """Return the CPU time of making code in this process and in those added by ``add_code_below`` [s]."""
    return code_seconds() + _process.below


def add_code_below(seconds: float) -> None:
    """Add CPU time [s] that a process below this one took to make code, and report it to the parent.

    Within a block the parent counts that time already, and the block's end reports it.
    """
    _process.below += seconds
    if _process.page and not _thread.depth:
        _process.page.report(_process.slot, _process.closed + _process.below)


def solver_seconds() -> float:
    """Return the CPU time [s] of this process without that of making code: a clock that stands still meanwhile."""
    return cpu_seconds() - code_seconds()


@dataclass
class Stopwatch:
    """A watch, started when constructed, of CPU time of the solver and of making code."""

    solver_began: float = field(default_factory=solver_seconds)
    code_began: float = field(default_factory=code_seconds)

    @property
    def solver(self) -> float:
        """The CPU time without making code [s]."""
        return solver_seconds() - self.solver_began

    @property
    def code(self) -> float:
        """The CPU time of making code [s]."""
        return code_seconds() - self.code_began


def listen_to_numba() -> None:
    """Count numba's compiling and loading from its cache as making code, in plugins too; the first call imports it."""
    if _listening:
        return
    _listening.append(listen_to_compiler(_open_block, _close_block))


_listening: list[Any] = []


def prepare_child_page() -> tuple[CodePage, int]:
    """Choose and clear a slot to which a child of this process reports its time of making code; return page and slot.

    It is the next slot of the page to which this process itself reports or, without one that is free, of a new page.
    """
    below = _process.slot + 1
    page, slot = (_process.page, below) if _process.page and below < SLOTS else (CodePage(), 0)
    page.report(slot, 0.0)
    return page, slot


def report_code_time(page: CodePage, slot: int) -> None:
    """Make this process report its time of making code to ``slot`` of ``page`` from now on."""
    _process.page, _process.slot = page, slot


def limit_solver_time(soft_limit: float) -> None:
    """Limit the CPU time of this process to ``soft_limit`` [s]; making code from now on does not count towards it."""
    _process.soft_limit = math.ceil(soft_limit - code_seconds())
    _move_limit(making=is_making_code())


def _move_limit(*, making: bool) -> None:
    """Set the system's soft limit on CPU time: ``HARD`` below the hard limit while code is made, else the solver's.

    Do nothing without a limit of the solver (``limit_solver_time``).
    """
    if _process.soft_limit:
        with contextlib.suppress(ValueError, OSError):  # a plugin has changed it
            hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
            most = hard - HARD
            soft = most if making else min(most, _process.soft_limit + math.ceil(_process.closed))
            resource.setrlimit(resource.RLIMIT_CPU, (soft, hard))
