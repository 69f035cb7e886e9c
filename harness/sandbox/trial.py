"""Foreign code is tried in a process of its own before it runs in this one: a plugin that hangs, crashes or ends its
process is told in a line. Only a note from that process says that it came back.
"""

import os
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from ..catalogue import registry
from ..types import Problem
from .isolation import fork, kill_group

T = TypeVar("T")
LIMIT = 60.0  # [s] to be imported, or to make a problem
MEMORY = 4000.0  # [MB]
GOOD = "came back"


def tried(what: str, attempt: Callable[[], T]) -> T:
    """What ``attempt`` gives, once it has come back elsewhere; ValueError in one line where it does not, or raises."""
    if threading.active_count() == 1:  # else a plugin before it has started a thread, and nothing can be forked
        complaint = _elsewhere(what, attempt)
        if complaint:
            raise ValueError(complaint)
    try:
        return attempt()
    except Exception as error:
        raise ValueError(_words(what, error)) from error


def made(name: str, parameters: Mapping[str, Any] | None = None) -> Problem:
    """The problem ``name``; a plugin's is tried first."""
    if registry.is_own_problem(name):
        return registry.make_problem(name, parameters)
    return tried(f"problem {name}", lambda: registry.make_problem(name, parameters))


def _words(what: str, error: BaseException) -> str:
    if not isinstance(error, ValueError):
        return f"{what}: {type(error).__name__}: {error}"
    silent = error.__cause__ is not None and not str(error.__cause__)  # sys.exit(), MemoryError: a type without words
    return f"{str(error).rstrip()} {type(error.__cause__).__name__}" if silent else str(error)


def _elsewhere(what: str, attempt: Callable[[], object]) -> str:
    """What is wrong with it; empty when it came back."""
    with tempfile.TemporaryDirectory() as place:
        note = Path(place) / "note"

        def run(tell: object) -> None:
            try:
                attempt()
                complaint = ""
            except BaseException as error:  # sys.exit too
                complaint = _words(what, error)
            note.write_text(complaint, encoding="utf-8", errors="replace")

        child = fork(run, Path(place) / "said", MEMORY, LIMIT)
        until = time.monotonic() + LIMIT
        ended, status = 0, 0
        try:
            while not ended and time.monotonic() < until:
                ended, status = os.waitpid(child.pid, os.WNOHANG)
                time.sleep(0.0 if ended else 0.002)
        finally:
            kill_group(child.pid)  # and what it may have started
            if not ended:
                os.waitpid(child.pid, 0)
            os.close(child.phase)
        if note.exists():
            return note.read_text(encoding="utf-8")
    if not ended:
        return f"{what}: it did not come back within {LIMIT:g} s"
    code = os.waitstatus_to_exitcode(status)
    how = f"by {signal.Signals(-code).name}" if code < 0 else f"with exit code {code}"
    return f"{what}: it ended its process {how} instead of coming back"
