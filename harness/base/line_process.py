"""Talk to another process by lines: requests go to its standard input, answers come from its standard output."""

import contextlib
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from typing import IO, Any

from .cache import ROOT
from .machine import THREADS


class LineProcess:
    """A process that answers lines, and ends when its input is closed or this process ends."""

    def __init__(self, command: Sequence[str], **given: Any) -> None:
        """Start ``command``; ``given`` are further arguments of ``subprocess.Popen``."""
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, **given)

    @property
    def answers(self) -> IO[bytes]:
        """The standard output of the process."""
        assert self.process.stdout is not None
        return self.process.stdout

    def send_lines(self, lines: bytes) -> None:
        """Send lines, each with its newline; do nothing if the process has ended: its answers end, too."""
        assert self.process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self.process.stdin.write(lines)
            self.process.stdin.flush()

    def close(self, patience: float | None = None) -> None:
        """Close the input of the process and wait for its end; kill it after ``patience`` [s], None for no limit."""
        assert self.process.stdin is not None
        with contextlib.suppress(OSError):  # it has ended, and what was not sent is lost with it
            self.process.stdin.close()
        try:
            self.process.wait(patience)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.answers.close()


class ModuleProcess(LineProcess):
    """A Python process that runs a module of this package, beyond the reach of signals to the group of this process."""

    def __init__(self, module: str, environ: Mapping[str, str] | None = None) -> None:
        """Run ``mbsbench.<module>`` with one thread for linear algebra and the environment variables ``environ``."""
        super().__init__(
            (sys.executable, "-m", f"mbsbench.{module}"),
            cwd=ROOT,
            env={**os.environ, **THREADS, **(environ or {})},
            start_new_session=True,
        )
