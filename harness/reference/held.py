"""Hold what follows from a problem alone, its exact motion sampled, in memory, where the forks of a process inherit it.

Every run of a suite samples the same exact motion for its scales and thins the same exact poses for its pictures. The
parent of all runs does so once for each of our own problems, and hands each run the problem together with the samples.
They belong to one problem object, not to its name, and to nothing that a run measures.
"""

from collections.abc import Callable, Hashable
from typing import Any, TypeVar

from ..mechanics.types import Problem

T = TypeVar("T")
_held: dict[int, tuple[Problem, dict[Hashable, Any]]] = {}


def hold_values(problem: Problem) -> None:
    """Keep from now on, in memory, the values that ``recall_value`` computes for this problem object."""
    _held.setdefault(id(problem), (problem, {}))


def recall_value(problem: Problem, key: Hashable, compute: Callable[[], T]) -> T:
    """Return the result of ``compute``, which for a problem that is held is called only once for each ``key``."""
    one, values = _held.get(id(problem), (None, {}))
    if one is not problem:
        return compute()
    if key not in values:
        values[key] = compute()
    found: T = values[key]
    return found


def peek_value(problem: Problem, key: Hashable) -> Any:
    """Return the value held under ``key`` for a problem, without computing it; None if there is none."""
    one, values = _held.get(id(problem), (None, {}))
    return values.get(key) if one is problem else None


def forget_value(problem: Problem, key: Hashable) -> None:
    """Remove the value held under ``key`` for a problem, if there is one: it is too large to be inherited by forks."""
    if id(problem) in _held:
        _held[id(problem)][1].pop(key, None)
