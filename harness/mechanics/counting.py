"""Count the evaluations that a user's code requests by calls of ``accelerations`` and ``equations``."""

import functools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


@dataclass
class CallCount:
    """Calls since ``collect_counts`` began; a call within a counted call is not counted again."""

    evaluations: int = 0
    factorisations: int = 0
    inside: bool = False  # True during a counted call


_count: ContextVar[CallCount | None] = ContextVar("count", default=None)


@contextmanager
def collect_counts(count: CallCount) -> Iterator[CallCount]:
    """Add calls of counted functions within this context to ``count``."""
    token = _count.set(count)
    try:
        yield count
    finally:
        _count.reset(token)


def count_calls(*, factorises: bool) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Return a decorator that makes ``collect_counts`` count each call of a function as an evaluation.

    With ``factorises`` a call counts as a factorisation, too.
    """

    def decorate(function: Callable[P, T]) -> Callable[P, T]:
        """Return a function that calls ``function`` and counts the call."""

        @functools.wraps(function)
        def call(*arguments: P.args, **keywords: P.kwargs) -> T:
            """Call the function; count the call if counting is active and it is not nested in another counted call."""
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

    return decorate
