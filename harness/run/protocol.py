"""Define the messages between a runner and a supervisor process, one JSON line each, and the runner's side of them."""

import os
import select
from collections.abc import Mapping
from typing import Any

import msgspec

from ..base.line_process import ModuleProcess
from ..catalogue.suites.spec import RunSpec
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
    """Return a message as one line of JSON, its newline included."""
    return msgspec.json.encode(message, enc_hook=str) + b"\n"


class Reader:
    """A decoder of messages of type ``kind`` from the chunks that are read from a pipe."""

    def __init__(self, kind: Any) -> None:
        self.decoder = msgspec.json.Decoder(kind, dec_hook=lambda wanted, given: wanted(given))
        self.pending = b""

    def messages(self, chunk: bytes) -> list[Any]:
        """Return the messages that are complete with the bytes ``chunk``; keep the rest for the next call."""
        *lines, self.pending = (self.pending + chunk).split(b"\n")
        return [self.decoder.decode(line) for line in lines]


class SupervisorLost(RuntimeError):
    """Signal that the supervisor process has ended, with its exit code, or minus the signal that ended it."""

    def __init__(self, code: int) -> None:
        super().__init__(f"the supervisor process ended with code {code}")
        self.code = code


class Supervised(ModuleProcess):
    """A supervisor process, started with further variables ``environ``: ``send`` it orders, ``receive`` its news.

    Once its input is closed, by this process or by its end, it kills its runs and exits.
    """

    def __init__(self, environ: Mapping[str, str] | None = None) -> None:
        super().__init__("harness.run.supervisor", environ)
        self.reader = Reader(News)

    def send(self, order: Message) -> None:
        """Send an order; do nothing if the process has ended, which ``receive`` reports once all its news is read."""
        self.send_lines(encode_message(order))

    def receive(self, timeout: float | None = None) -> list[News]:
        """Return the messages that arrive within ``timeout`` [s], possibly none; None waits without limit.

        Raise SupervisorLost if the process has ended and all its messages have been read.
        """
        ready, _, _ = select.select([self.answers], [], [], timeout)
        if not ready:
            return []
        chunk = os.read(self.answers.fileno(), 2**16)
        if not chunk:
            raise SupervisorLost(self.process.wait())
        return self.reader.messages(chunk)

    def discard(self) -> None:
        """End the process at once, as one that was given no order: it has no runs."""
        self.process.kill()
        self.close()
