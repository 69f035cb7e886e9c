"""Foreign code is tried in a process of its own before it runs in this one: a plugin that hangs, crashes or ends its
process is reported in one line. Only a line sent from that process says that it returned.
"""

import json
import threading
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from ..catalogue import registry
from ..code_meter import CODE_LIMIT
from ..types import Problem
from .apart import Apart

T = TypeVar("T")
LIMIT = 30.0  # [s] of CPU time to be imported, or to make a problem
MEMORY = 4000.0  # [MB]


def try_apart(what: str, attempt: Callable[[], T]) -> T:
    """The value of ``attempt``, once it has returned in another process; ValueError in one line where it does not."""
    if threading.active_count() == 1:  # else a plugin before it has started a thread, and nothing can be forked
        complaint = _try_elsewhere(what, attempt)
        if complaint:
            raise ValueError(complaint)
    try:
        return attempt()
    except Exception as error:
        raise ValueError(_describe_error(what, error)) from error


def make_problem(name: str, parameters: Mapping[str, Any] | None = None) -> Problem:
    """The problem ``name``; a plugin's is tried first."""
    if registry.is_own_problem(name):
        return registry.make_problem(name, parameters)
    return try_apart(f"problem {name}", lambda: registry.make_problem(name, parameters))


def _describe_error(what: str, error: BaseException) -> str:
    if not isinstance(error, ValueError):
        return f"{what}: {type(error).__name__}: {error}"
    silent = error.__cause__ is not None and not str(error.__cause__)  # sys.exit(), MemoryError: a type without words
    return f"{str(error).rstrip()} {type(error.__cause__).__name__}" if silent else str(error)


def _try_elsewhere(what: str, attempt: Callable[[], object]) -> str:
    """The complaint about ``attempt``; empty when it returned."""

    def run(send: Callable[[str], None]) -> None:
        try:
            attempt()
            complaint = ""
        except BaseException as error:  # sys.exit too
            complaint = _describe_error(what, error)
        send(json.dumps(complaint))

    ended = Apart(run, limit=LIMIT, memory=MEMORY, code=CODE_LIMIT).wait()
    if ended.sent:
        return str(json.loads(ended.sent))
    return f"{what}: {ended.describe_limit(LIMIT, MEMORY) or f'its process {ended.words} unexpectedly'}"
