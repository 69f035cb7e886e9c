"""Messages between the runner and a supervisor process, one JSON line a message, and the runner's end of it."""

import contextlib
import os
import select
import subprocess
import sys
from collections.abc import Mapping
from typing import Any

import msgspec

from ..machine import THREADS
from ..results.environment import ROOT
from ..suites.spec import RunSpec
from .job import Job


class Message(msgspec.Struct, frozen=True, tag=True):
    """One line."""


class Warm(Message, frozen=True):
    """Compile the solvers of ``specs``, compute the references of ``jobs``."""

    specs: list[RunSpec]
    jobs: list[Job]


class Start(Message, frozen=True):
    """Begin this run beside those that run."""

    job: Job


class Stop(Message, frozen=True):
    """End all runs: the suite has met its limit."""


class Warmed(Message, frozen=True):
    """How long each solver took to compile since the last news, and each reference to compute or to read [s]."""

    times: dict[str, float]
    references: dict[str, float]
    over: bool = False  # runs may begin


class Done(Message, frozen=True):
    """A run is over. Its record is stored unless ``error`` or ``unbegun`` says why it could not be, or why none is.

    ``sha256`` is the digest of that record: what else stands in its place was written by somebody else.
    """

    run_id: str
    sha256: str = ""
    error: str = ""
    unbegun: str = ""


class CodeTime(Message, frozen=True):
    """CPU time [s] that warm-up and the code of runs have taken so far, which no budget counts."""

    seconds: float


Order = Warm | Start | Stop
News = Warmed | Done | CodeTime


def line_of(message: Message) -> bytes:
    """With its end of line."""
    return msgspec.json.encode(message, enc_hook=str) + b"\n"


class Reader:
    """Messages of a ``kind`` from the chunks of a pipe."""

    def __init__(self, kind: Any) -> None:
        self.decoder = msgspec.json.Decoder(kind, dec_hook=lambda wanted, given: wanted(given))
        self.pending = b""

    def messages(self, chunk: bytes) -> list[Any]:
        """Those that are whole now."""
        *lines, self.pending = (self.pending + chunk).split(b"\n")
        return [self.decoder.decode(line) for line in lines]


class Lost(RuntimeError):
    """The supervisor process has ended."""

    def __init__(self, code: int) -> None:
        super().__init__(f"the supervisor process ended with code {code}")
        self.code = code


class Supervised:
    """A supervisor process of our own, with further variables ``environ``: ``send`` it orders, ``receive`` its news."""

    def __init__(self, environ: Mapping[str, str] | None = None) -> None:
        self.process = subprocess.Popen(
            (sys.executable, "-m", "mbsbench.harness.execution.supervisor"),
            cwd=ROOT,
            env={**os.environ, **THREADS, **(environ or {})},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # a signal to our group is for us: we close its input, and it ends what runs, whole
        )
        self.reader = Reader(News)

    def send(self, order: Message) -> None:
        """Send an order; to one that is gone nothing is sent, and ``receive`` says so once its last news is read."""
        assert self.process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self.process.stdin.write(line_of(order))
            self.process.stdin.flush()

    def receive(self, timeout: float | None = None) -> list[News]:
        """Return news, none after ``timeout`` [s]; raise Lost if it is gone and all its news is read."""
        assert self.process.stdout is not None
        ready, _, _ = select.select([self.process.stdout], [], [], timeout)
        if not ready:
            return []
        chunk = os.read(self.process.stdout.fileno(), 2**16)
        if not chunk:
            raise Lost(self.process.wait())
        return self.reader.messages(chunk)

    def close(self) -> None:
        """At the end of its input it kills what runs and leaves."""
        assert self.process.stdin is not None and self.process.stdout is not None
        with contextlib.suppress(OSError):  # it is gone, and what we had to say with it
            self.process.stdin.close()
        self.process.wait()
        self.process.stdout.close()
