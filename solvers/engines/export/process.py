"""Run an engine in a separate process, in the environment ``sys.prefix/engines/NAME`` (``make engines``).

A request is a line of JSON to ``inside/serve.py``, the answer another line, followed by rows as bytes. The process
serves one model after another, inherits all limits, states its CPU time with every answer and ends with this process.
Where it dies, the last line of its standard error is reported as the reason.
"""

import atexit
import json
import os
import signal
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from ....harness.base.code_meter import add_code_below
from ....harness.base.line_process import LineProcess
from ....harness.mechanics.types import Status
from ...formulations.recording import StepFailure

INSIDE = Path(__file__).parent.parent / "inside"
ENVIRONMENTS = Path(sys.prefix) / "engines"
PATIENCE = 5.0  # [s] for a process to end once its pipe is closed


def find_environment(inside: str) -> Path | None:
    """Return the Python executable of the environment of the engine ``inside``, or None if it has none."""
    python = ENVIRONMENTS / inside / "bin" / "python"
    return python if python.exists() else None


class Process(LineProcess):
    """A process that runs an engine; ``stepping`` and ``cpu`` are its CPU times [s] of steps and in total."""

    def __init__(self, inside: str, python: Path) -> None:
        """Start the process of the engine ``inside`` with the executable ``python``; it is closed at exit."""
        self.stepping = self.cpu = 0.0  # [s] so far
        self._name, self._errors = inside, tempfile.TemporaryFile()  # noqa: SIM115  open as long as the process
        command = [str(python), "-I", str(INSIDE / "serve.py"), str(INSIDE / f"{inside}.py")]
        super().__init__(command, stderr=self._errors)
        atexit.register(self.close)

    def request_answer(self, request: str, **arguments: Any) -> tuple[dict[str, Any], np.ndarray]:
        """Send ``request`` with its ``arguments``; return the engine's answer and its array of rows, if any.

        ``stepping`` and ``cpu`` are updated. CPU time of requests other than "advance" is counted as making code.
        Raises ValueError where the engine refuses, ``StepFailure`` where its process has died.
        """
        self.send_lines(json.dumps({"do": request, **arguments}).encode() + b"\n")
        line = self.answers.readline()
        if not line.endswith(b"\n"):
            raise self._report_failure()
        found = json.loads(line)
        shape = found.pop("shape", (0, 0))
        rows = self.answers.read(8 * shape[0] * shape[1])
        if len(rows) < 8 * shape[0] * shape[1]:
            raise self._report_failure()
        stepping, cpu, self.stepping, self.cpu = self.stepping, self.cpu, found.pop("stepping"), found.pop("cpu")
        if request != "advance":
            add_code_below(max(self.cpu - cpu - (self.stepping - stepping), 0.0))
        if "refusal" in found:
            raise ValueError(found["refusal"])
        return found, np.frombuffer(rows).reshape(shape)

    def close(self, patience: float | None = PATIENCE) -> None:
        """Close the pipes, which ends the process; kill it if it still runs after ``patience`` [s]."""
        super().close(patience)
        atexit.unregister(self.close)

    def _report_failure(self) -> StepFailure:
        """Close and forget this process, which has died; return the ``StepFailure`` to raise, with its last message.

        All its messages are written to standard error. The status is STALLED at the limit of CPU time, else CRASHED.
        """
        self.close()
        _processes.pop((self._name, os.getpid()), None)
        self._errors.seek(0)
        native, code = self._errors.read().decode(errors="replace"), self.process.returncode
        sys.stderr.write(native)
        last = next((line.strip() for line in reversed(native.splitlines()) if line.strip()), "it wrote nothing")
        if code == -signal.SIGXCPU:
            return StepFailure(Status.STALLED, f"the CPU limit was reached in the process of {self._name}")
        ended = f"by {signal.Signals(-code).name}" if code < 0 else f"with exit code {code}"
        return StepFailure(Status.CRASHED, f"the process of {self._name} was ended {ended}: {last}")


_processes: dict[tuple[str, int], Process] = {}  # by engine and process id: a forked process starts its own


def get_process(inside: str, python: Path) -> Process:
    """Return the running process of the engine ``inside``, or start one with the executable ``python``."""
    key = inside, os.getpid()
    if key not in _processes:
        _processes[key] = Process(inside, python)
    return _processes[key]


def sum_process_seconds() -> float:
    """Return the CPU time [s] of all running engine processes that this process started, as of their last answers."""
    return sum(one.cpu for (_, owner), one in _processes.items() if owner == os.getpid())
