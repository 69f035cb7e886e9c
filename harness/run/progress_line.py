"""Show on one line of standard error how far a long solve has got, where a terminal or a notebook shows it."""

import shutil
import sys
import time
from typing import Self

import numpy as np

from ..mechanics.state import States
from ..mechanics.types import Problem, Spool
from .remaining_time import describe_motion

QUIET = 1.0  # [s] without a line: most solves end sooner, and a line that flashes up cannot be read
EVERY = 0.2  # [s] between two lines: a tenth looks no smoother, and in a notebook each line is a message


class ProgressLine:
    """A line that the next one overwrites and that is erased at the end; nothing is written outside a terminal."""

    def __init__(self) -> None:
        self.watched, self._width = is_watched(), 0
        self._next = time.monotonic() + QUIET

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.erase()

    def is_due(self) -> bool:
        """Return whether it is time for another line."""
        return self.watched and time.monotonic() >= self._next

    def show(self, words: str) -> None:
        """Write ``words`` over the line, cut to the width of the terminal, since a wrapped line cannot be overwritten.

        Set when the next line is due.
        """
        if not self.watched:
            return
        words = words[: shutil.get_terminal_size().columns - 1]
        self._write(words.ljust(self._width))
        self._width, self._next = len(words), time.monotonic() + EVERY

    def erase(self) -> None:
        """Remove the line, and put the cursor at its start."""
        if self._width:
            self._write(f"{'':{self._width}}\r")
            self._width = 0

    def make_spool(self, problem: Problem) -> Spool | None:
        """Return the spool of a solver that shows here how far it has got; None if nobody watches."""
        return ProgressSpool(problem, self) if self.watched else None

    @staticmethod
    def _write(text: str) -> None:
        """Write ``text`` over the present line of standard error."""
        sys.stderr.write(f"\r{text}")
        sys.stderr.flush()


class ProgressSpool:
    """A ``harness.mechanics.types.Spool`` that shows the time of the last step it receives, and keeps no steps."""

    def __init__(self, problem: Problem, line: ProgressLine) -> None:
        self.rows, self._problem, self._line = 0, problem, line

    def due(self) -> bool:
        """Return whether it is time to show the next step."""
        return self._line.is_due()

    def take(self, t: np.ndarray | list[float], states: States) -> None:
        """Count these steps and, when it is time, print the simulated time of the last one."""
        self.rows += len(t)
        if len(t) and self._line.is_due():  # a compiled march gives each stretch, whether it is due or not
            self._line.show(describe_motion(self._problem.name, float(t[-1]), self._problem.t_end))


def is_watched() -> bool:
    """Return whether standard error is a notebook's or a terminal's, not a file's or a pipe's."""
    return "ipykernel" in sys.modules or bool(sys.stderr and sys.stderr.isatty())
