"""Define the messages between a runner and a supervisor process, one JSON line each, and the runner's side of them."""

import contextlib
import os
import select
import subprocess
import sys
from collections.abc import Mapping
from typing import Any

import msgspec

from ..base.machine import THREADS
from ..catalogue.suites.spec import RunSpec
from ..results.environment import ROOT
from .job import Job


class Message(msgspec.Struct, frozen=True, tag=True):
    """A message that is sent as one line of JSON; each class is an order or a report."""


class WarmUpOrder(Message, frozen=True):
    """An order to compile the solvers of ``specs`` and to compute the references of ``jobs``."""

    specs: list[RunSpec]
    jobs: list[Job]


class StartOrder(Message, frozen=True):
    """An order to begin a run in parallel with those that are running."""

    job: Job


class StopOrder(Message, frozen=True):
    """An order to end all runs, because the suite has reached its limit on time."""


class WarmUpTimes(Message, frozen=True):
    """A report of how long [s] solvers took to compile, and references to compute or read, since the last report."""

    times: dict[str, float]
    references: dict[str, float]
    over: bool = False  # runs may begin


class RunEnded(Message, frozen=True):
    """A report that a run has ended. Its record is stored unless ``error`` or ``unbegun`` says why there is none.

    ``sha256`` is the digest of that record: any other file in its place was written by something else.
    """

    run_id: str
    sha256: str = ""
    error: str = ""
    unbegun: str = ""


class CodeTime(Message, frozen=True):
    """A report of the CPU time [s] of warm-up and code generation so far, which no limit on time counts."""

    seconds: float  # since the supervisor began


Order = WarmUpOrder | StartOrder | StopOrder
News = WarmUpTimes | RunEnded | CodeTime


def encode_message(message: Message) -> bytes:
    """Return a message as one line of JSON, with its end of line."""
    return msgspec.json.encode(message, enc_hook=str) + b"\n"


class Reader:
    """A decoder of messages of type ``kind`` from the chunks that are read from a pipe."""

    def __init__(self, kind: Any) -> None:
        self.decoder = msgspec.json.Decoder(kind, dec_hook=lambda wanted, given: wanted(given))
        self.pending = b""

    def messages(self, chunk: bytes) -> list[Any]:
        """Return the messages that are complete with this chunk; keep the rest for the next call."""
        *lines, self.pending = (self.pending + chunk).split(b"\n")
        return [self.decoder.decode(line) for line in lines]


class SupervisorLost(RuntimeError):
    """Signal that the supervisor process has ended, with its exit code, or minus the signal that ended it."""

    def __init__(self, code: int) -> None:
        super().__init__(f"the supervisor process ended with code {code}")
        self.code = code


class Supervised:
    """A supervisor process, started with further variables ``environ``: ``send`` it orders, ``receive`` its news."""

    def __init__(self, environ: Mapping[str, str] | None = None) -> None:
        self.process = subprocess.Popen(
            (sys.executable, "-m", "mbsbench.harness.run.supervisor"),
            cwd=ROOT,
            env={**os.environ, **THREADS, **(environ or {})},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            # a signal to our group must not reach it: this process closes its input, and it ends its runs itself
            start_new_session=True,
        )
        self.reader = Reader(News)

    def send(self, order: Message) -> None:
        """Send an order; do nothing if the process has ended, which ``receive`` reports once all its news is read."""
        assert self.process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self.process.stdin.write(encode_message(order))
            self.process.stdin.flush()

    def receive(self, timeout: float | None = None) -> list[News]:
        """Return the news that arrives within ``timeout`` [s] (None: wait without limit), possibly none.

        Raise SupervisorLost if the process has ended and all its news is read.
        """
        assert self.process.stdout is not None
        ready, _, _ = select.select([self.process.stdout], [], [], timeout)
        if not ready:
            return []
        chunk = os.read(self.process.stdout.fileno(), 2**16)
        if not chunk:
            raise SupervisorLost(self.process.wait())
        return self.reader.messages(chunk)

    def close(self) -> None:
        """Close the input of the supervisor, whereupon it kills its runs and exits, and wait for its end."""
        assert self.process.stdin is not None and self.process.stdout is not None
        with contextlib.suppress(OSError):  # it has ended, and unsent orders are lost with it
            self.process.stdin.close()
        self.process.wait()
        self.process.stdout.close()
