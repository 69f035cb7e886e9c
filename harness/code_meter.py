"""The meter of code: CPU time of printing, compiling, linking and loading it, which is no time of a solver's.

It takes tens of seconds where nothing is kept on disk and milliseconds where all is, and says nothing about a method.
Whatever of ours makes code does so in ``making_code``; what numba compiles or loads by itself, for a plugin too, is
known by numba's own events. The meter of a process counts the time of the threads that make code, and tells it to the
process that keeps its limits.
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

CODE_LIMIT = 600.0  # [s] of CPU for the code of one run: all of ours, made anew, takes a tenth of that
PACKAGE = __name__.split(".")[0]
UNSETTLED = 0.2  # [s] of making code: a collection takes up to as long
SLOTS = 4  # processes above one another that tell their times in one page
Made = TypeVar("Made", bound=Callable[..., Any])


class CodePage:
    """Memory shared with a child, in which that tells what it has made [s], and when the making that goes on began."""

    def __init__(self) -> None:
        self._numbers = memoryview(mmap.mmap(-1, 16 * SLOTS)).cast("d")
        for slot in range(SLOTS):
            self.tell(slot, 0.0)

    def tell(self, slot: int, made: float, since: float = -1.0) -> None:
        """``since`` [s of the child's CPU time] is when it began to make code; negative: it makes none."""
        self._numbers[2 * slot], self._numbers[2 * slot + 1] = made, since

    def seconds(self, used: float, first: int = 0) -> float:
        """CPU time of making code of the processes from slot ``first`` on, which have used ``used`` [s] together."""
        total = 0.0
        for slot in range(first, SLOTS):
            made, since = self._numbers[2 * slot : 2 * slot + 2].tolist()
            total += (made if made >= 0.0 else 0.0) + (max(used - since, 0.0) if since >= 0.0 else 0.0)
        return total

    def is_making(self, first: int = 0) -> bool:
        """Whether one of them makes code just now, or did so when it ended."""
        return any(self._numbers[2 * slot + 1] >= 0.0 for slot in range(first, SLOTS))


class _Here(threading.local):
    """Of one thread: blocks that are open, and its time when the first was opened."""

    depth = 0
    began = 0.0


@dataclass
class _Process:
    """The meter of this process: only what is made here and now."""

    made: float = 0.0  # [s] in blocks that are closed
    made_below: float = 0.0  # [s] by processes that it has started
    page: CodePage | None = None
    slot: int = 0
    settled: float = 0.0  # [s] of it whose garbage has been collected
    soft_limit: int = 0  # [s] of CPU at which the system ends this process, code left out; 0: none
    lock: Any = field(default_factory=threading.Lock)


_here, _process = _Here(), _Process()


def _start_anew() -> None:
    """In a forked child, whose CPU time begins at zero, too."""
    global _here, _process
    _here, _process = _Here(), _Process()


os.register_at_fork(after_in_child=_start_anew)


def _open() -> None:
    _here.depth += 1
    if _here.depth == 1:
        _here.began = time.thread_time()
        if _process.page:
            _process.page.tell(_process.slot, _process.made + _process.made_below, cpu_seconds())
        _move_limit(making=True)


def _close() -> None:
    if _here.depth == 1:
        with _process.lock:
            _process.made += time.thread_time() - _here.began
        if _process.page:
            _process.page.tell(_process.slot, _process.made + _process.made_below)
        _move_limit(making=False)
    _here.depth = max(_here.depth - 1, 0)


def _check(space: dict[str, Any]) -> None:
    """Only the harness and its own solvers say what makes code; a plugin that gets round this is bounded and shown."""
    caller = str(space.get("__name__", ""))
    if caller.split(".")[0] != PACKAGE:
        raise RuntimeError(f"making_code is for {PACKAGE} itself: return setup_time instead (called by {caller})")


class _MakingCode:
    """``with making_code:`` or ``@making_code``: what is done inside is no time of the solver's."""

    def __enter__(self) -> None:
        _check(sys._getframe(1).f_globals)
        _open()

    def __exit__(self, *exception: object) -> None:
        _close()

    def __call__(self, function: Made) -> Made:
        _check(sys._getframe(1).f_globals)

        @wraps(function)
        def make(*given: Any, **named: Any) -> Any:
            with making_code:
                return function(*given, **named)

        return cast(Made, make)


making_code = _MakingCode()


def settle() -> None:
    """Collect what compilers have left in memory, as part of making code: else it is done in the time of a solver."""
    if _process.made - _process.settled > UNSETTLED:
        with making_code:
            gc.collect()
        _process.settled = _process.made


def is_making_code() -> bool:
    """Whether this thread is making code."""
    return _here.depth > 0


def code_seconds() -> float:
    """CPU time [s] of making code in this process so far."""
    return _process.made + (time.thread_time() - _here.began if _here.depth else 0.0)


def code_seconds_of_tree() -> float:
    """The same with what processes below it have made for it, as ``add_code_below`` was told."""
    return code_seconds() + _process.made_below


def add_code_below(seconds: float) -> None:
    """Count CPU time [s] that a process below this one took to make code; call within ``making_code``."""
    _process.made_below += seconds


def solver_seconds() -> float:
    """CPU time [s] of this process without that of making code: a clock that stands still meanwhile."""
    return cpu_seconds() - code_seconds()


@dataclass
class Stopwatch:
    """CPU time since it was made: of the solver, and of making code."""

    solver_began: float = field(default_factory=solver_seconds)
    code_began: float = field(default_factory=code_seconds)

    @property
    def solver(self) -> float:
        """CPU time [s] without code."""
        return solver_seconds() - self.solver_began

    @property
    def code(self) -> float:
        """CPU time [s] of making code."""
        return code_seconds() - self.code_began


def listen_to_numba() -> None:
    """Count what numba compiles, or loads from its cache, whoever has asked for it; loads numba."""
    from numba.core import event

    class Listener(event.Listener):  # type: ignore[misc]
        def on_start(self, event: Any) -> None:
            _open()

        def on_end(self, event: Any) -> None:
            _close()

    if not _listening:
        _listening.append(Listener())
        for kind in ("numba:compile", "numba:compiler_lock"):  # the lock is held while code is loaded, too
            event.register(kind, _listening[0])


_listening: list[Any] = []


def page_for_child() -> tuple[CodePage, int]:
    """A page and a slot in it for a child of this process: the page that this one itself reports to, if it does."""
    below = _process.slot + 1
    page, slot = (_process.page, below) if _process.page and below < SLOTS else (CodePage(), 0)
    page.tell(slot, 0.0)
    return page, slot


def report_to(page: CodePage, slot: int) -> None:
    """Tell there what this process makes from now on."""
    _process.page, _process.slot = page, slot


def leave_code_out_of(soft_limit: float) -> None:
    """Let the system end this process at ``soft_limit`` [s] of CPU time, besides what it takes to make code."""
    _process.soft_limit = math.ceil(soft_limit - code_seconds())
    _move_limit(making=is_making_code())


HARD = 5  # [s] between the limit at which the system asks a process to end, and that at which it ends it


def _move_limit(*, making: bool) -> None:
    """Set the system's soft limit: at the hard one while code is made, else at the solver's own."""
    if _process.soft_limit:
        with contextlib.suppress(ValueError, OSError):  # a plugin has changed it
            hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
            most = hard - HARD
            soft = most if making else min(most, _process.soft_limit + math.ceil(_process.made))
            resource.setrlimit(resource.RLIMIT_CPU, (soft, hard))
