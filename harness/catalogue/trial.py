"""Try foreign code in a separate process before it runs in this one.

A plugin that hangs, crashes or ends its process is reported in one line. Only a line sent from that process shows that
the code returned.
"""

import json
import threading
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from ..base.code_meter import CODE_LIMIT
from ..base.forked_process import ForkedProcess
from ..mechanics.types import Problem
from . import registry

T = TypeVar("T")
LIMIT = 30.0  # [s] CPU time to be imported, or to make a problem: a plugin that hangs holds its command up for as long
MEMORY = 4000.0  # [MB]


def try_in_process(what: str, attempt: Callable[[], T]) -> T:
    """Call ``attempt`` in another process first, then in this one; return its result.

    Raise ValueError in one line if either call fails; ``what`` names the attempt there, for example
    ``problem heavy_top``. In a process with several threads, which cannot be forked safely, it is called here only.
    """
    if threading.active_count() == 1:  # otherwise an earlier plugin has started a thread, and nothing can be forked
        complaint = _try_in_child(what, attempt)
        if complaint:
            raise ValueError(complaint)
    try:
        return attempt()
    except Exception as error:  # a plugin may raise anything: one line for the user
        raise ValueError(_describe_error(what, error)) from error


def make_problem(name: str, parameters: Mapping[str, Any] | None = None) -> Problem:
    """Return the problem ``name`` of the catalogue or of a plugin; a plugin's is made in another process first."""
    if registry.is_own_problem(name):
        return registry.make_problem(name, parameters)
    return try_in_process(f"problem {name}", lambda: registry.make_problem(name, parameters))


def _describe_error(what: str, error: BaseException) -> str:
    """Return one line for the user: the message of a ValueError, else ``what`` with the error's type and message."""
    if not isinstance(error, ValueError):
        return f"{what}: {type(error).__name__}: {error}"
    # sys.exit(), MemoryError: a type without a message
    silent = error.__cause__ is not None and not str(error.__cause__)
    return f"{str(error).rstrip()} {type(error.__cause__).__name__}" if silent else str(error)


def _try_in_child(what: str, attempt: Callable[[], object]) -> str:
    """Run ``attempt`` in another process; return what went wrong in one line, empty if it returned."""

    def run(send: Callable[[str], None]) -> None:
        """Send the complaint about ``attempt``, empty if it returns."""
        try:
            attempt()
            complaint = ""
        except BaseException as error:  # including SystemExit
            complaint = _describe_error(what, error)
        send(json.dumps(complaint))

    ended = ForkedProcess(run, limit=LIMIT, memory=MEMORY, code=CODE_LIMIT).wait()
    if ended.sent:
        return str(json.loads(ended.sent))
    return f"{what}: {ended.describe_limit(LIMIT, MEMORY) or f'its process {ended.words} unexpectedly'}"
