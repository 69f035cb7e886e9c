"""A supervisor that serves one suite after another: starting one takes a second, loading a solver's code another.

It is the process of ``mbsbench run``, in the environment in which the tests began. A test with other variables has one
of its own, and so has one that uses the fixture ``own_supervisor``, as it looks at processes or at what is compiled.
"""

import contextlib
import os
from collections.abc import Mapping

from mbsbench.harness.run.protocol import (
    CodeTime,
    Message,
    News,
    RunEnded,
    StartOrder,
    Supervised,
    SupervisorLost,
    WarmUpOrder,
    WarmUpTimes,
)

OF_PYTEST = "PYTEST_CURRENT_TEST"


def read_variables() -> dict[str, str]:
    """Return the environment variables that a process started here has from us."""
    return {k: v for k, v in os.environ.items() if k != OF_PYTEST}


class KeptSupervisor(Supervised):
    """A supervisor that is closed only with runs in progress, or for good by ``end``."""

    def __init__(self) -> None:
        super().__init__()
        self.busy = 0  # orders that it has not carried out
        self.told, self.before = 0.0, 0.0  # [s] of code: in all, and before the suite that it serves

    def send(self, order: Message) -> None:
        self.busy += isinstance(order, StartOrder | WarmUpOrder)
        super().send(order)

    def receive(self, timeout: float | None = None) -> list[News]:
        news = super().receive(timeout)
        self.busy -= sum(isinstance(n, RunEnded) or (isinstance(n, WarmUpTimes) and n.over) for n in news)
        self.told = max([self.told, *(n.seconds for n in news if isinstance(n, CodeTime))])
        return [CodeTime(n.seconds - self.before) if isinstance(n, CodeTime) else n for n in news]

    def close(self) -> None:
        with contextlib.suppress(SupervisorLost):
            self.receive(0.0)  # what it has told since the last run is of this suite
        self.before = self.told
        if self.busy or self.process.poll() is not None:
            self.end()

    def end(self) -> None:
        """End the process, and what it runs."""
        super().close()

    @property
    def is_free(self) -> bool:
        """Whether it can serve another suite."""
        return not self.busy and self.process.poll() is None


class Keeper:
    """The supervisor of all suites of a session that are run in the variables in which the session began."""

    def __init__(self) -> None:
        self.variables = read_variables()
        self.kept: KeptSupervisor | None = None

    def take(self, environ: Mapping[str, str] | None = None) -> Supervised:
        """Return the kept one, started if none is there, or a new one for other variables; as ``Supervised`` does."""
        if environ or read_variables() != self.variables or (self.kept is not None and self.kept.busy):
            return Supervised(environ)
        if self.kept is None or not self.kept.is_free:
            self.kept = KeptSupervisor()
        return self.kept

    def end(self) -> None:
        """End the kept one, which has nothing to do: killed, it waits for no process that holds its input, too."""
        if self.kept is not None and self.kept.is_free:
            self.kept.process.kill()
            self.kept.end()
        self.kept = None
