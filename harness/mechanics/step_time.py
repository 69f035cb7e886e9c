"""Store when the step in progress began, so that a state without its time is refused, not evaluated at t = 0.

``State.t`` is 0 unless given, as for a start. A step that forgets it would follow drives and loads of t = 0.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from .state import State

_step_start: ContextVar[float] = ContextVar("begun", default=0.0)  # [s]
REMEDY = "pass the time on: State(r, R, v, Omega, t), or dataclasses.replace(state, ..., t=t)"


@contextmanager
def begin_step(t: float) -> Iterator[None]:
    """Let ``check_time`` treat evaluations within this context as parts of a step that began at ``t`` [s]."""
    token = _step_start.set(t)
    try:
        yield
    finally:
        _step_start.reset(token)


def check_time(s: State) -> None:
    """Raise ValueError for a state with t = 0, the default, in a step that began later: its time was left out."""
    begun = _step_start.get()
    if s.t == 0.0 < begun:
        raise ValueError(f"a state of the step from t = {begun:.6g} s has t = 0 s; {REMEDY}")
