"""Counts of evaluations that code of users asks for: how often it calls ``accelerations`` and ``equations``."""

import functools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


@dataclass
class Count:
    """Calls since ``counting`` began; one within another is none of its own."""

    evaluations: int = 0
    factorisations: int = 0
    inside: bool = False


_count: ContextVar[Count | None] = ContextVar("count", default=None)


@contextmanager
def counting(count: Count) -> Iterator[Count]:
    """Add the calls made within to ``count``."""
    token = _count.set(count)
    try:
        yield count
    finally:
        _count.reset(token)


def count_calls(*, factorises: bool) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Count each call of the function as an evaluation, and as a factorisation if it ``factorises``."""

    def mark(function: Callable[P, T]) -> Callable[P, T]:
        @functools.wraps(function)
        def call(*arguments: P.args, **keywords: P.kwargs) -> T:
            count = _count.get()
            if count is None or count.inside:
                return function(*arguments, **keywords)
            count.evaluations += 1
            count.factorisations += factorises
            count.inside = True
            try:
                return function(*arguments, **keywords)
            finally:
                count.inside = False

        return call

    return mark
