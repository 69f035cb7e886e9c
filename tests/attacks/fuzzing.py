"""Mutations of files, and readers that are run on each in a process of its own: words, time and memory count.

``MUTATIONS`` of the environment is how many each test makes: few in ``make test``, a thousand in ``make attacks``.
"""

import json
import os
import resource
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

COUNT = int(os.environ.get("MUTATIONS", "20"))
PATIENCE = 60.0  # [s] of wall time; a process that reads a small file and takes longer hangs
CPU = 30  # [s]
LARGEST = 1000.0  # [MB] of resident memory
WORDS = (
    b"nan",
    b"-1",
    b"1e999",
    b"9" * 30,
    b"",
    b"0",
    b"null",
    b"\xff\xfe",
    b"\x00",
    b"{",
    b'"',
    b"../../x",
    b"\x1b[2J",
    b"1e-320",
    b"<a>",
    b"true",
    b"[[[[",
    b",",
)
VALUES = (
    float("nan"),
    float("inf"),
    -1,
    0,
    10**30,
    1e308,
    5e-324,
    "",
    "x",
    "\x1b[2J",
    None,
    True,
    [],
    {},
    [[]],
    "nan",
    "9" * 400,
    {"a": [1]},
)


def mutate(raw: bytes, random: np.random.Generator, *, numbers: float = 0.0) -> bytes:
    """Damage bytes in one to three of the ways that disks and forgers have; in a share of cases ``numbers`` alone."""
    for _ in range(random.integers(1, 4)):
        at, size = int(random.integers(0, len(raw) + 1)), int(random.integers(1, 64))
        word = WORDS[random.integers(len(WORDS))]
        if random.random() < numbers:
            raw = replace_number(raw, at, word)
        else:
            raw = damage(raw, at, size, word, random)
    return raw


def damage(raw: bytes, at: int, size: int, word: bytes, random: np.random.Generator) -> bytes:
    """Damage bytes at a place."""
    flipped = bytes([raw[at] ^ (1 << int(random.integers(8)))]) if at < len(raw) else b""
    ways = (
        raw[:at],
        raw[:at] + random.bytes(size) + raw[at + size :],
        raw[:at] + bytes(size) + raw[at + size :],
        raw[:at] + raw[at + size :],
        raw[:at] + raw[max(at - size, 0) : at] * 3 + raw[at:],
        raw[:at] + word + raw[at:],
        replace_number(raw, at, word),
        raw[:at] + flipped + raw[at + 1 :],
    )
    return ways[random.integers(len(ways))]


def replace_number(raw: bytes, at: int, word: bytes) -> bytes:
    """Put a word in place of the first number from a place on."""
    digits = b"0123456789.+-eE"
    begin = next((k for k in range(at, len(raw)) if raw[k] in b"0123456789"), len(raw))
    end = next((k for k in range(begin, len(raw)) if raw[k] not in digits), len(raw))
    return raw[:begin] + word + raw[end:]


def mutate_json(value: object, random: np.random.Generator) -> object:
    """Put an unlikely value somewhere in a value of JSON, or leave something out."""
    if isinstance(value, dict) and value and random.random() < 0.9:
        key = list(value)[random.integers(len(value))]
        if random.random() < 0.1:
            return {k: v for k, v in value.items() if k != key}
        return value | {key: mutate_json(value[key], random)}
    if isinstance(value, list) and value and random.random() < 0.8:
        k = int(random.integers(len(value)))
        return [*value[:k], mutate_json(value[k], random), *value[k + 1 :]]
    if isinstance(value, str) and value[:1] in "[{" and value and random.random() < 0.5:
        return json.dumps(mutate_json(json.loads(value), random))
    return VALUES[random.integers(len(VALUES))]


@dataclass
class Tally:
    """What came of the mutations: how each ended, and what must not be."""

    name: str
    tried: int = 0
    codes: dict[int, int] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)
    largest: float = 0.0  # [MB]
    longest: float = 0.0  # [s]

    def run(self, about: str, work: Callable[[], int | None]) -> None:
        """Run the work in a process of its own; note a traceback, a hang, too much memory, a death by a signal."""
        code, words, seconds, size = run_apart(work)
        self.tried += 1
        self.codes[code] = self.codes.get(code, 0) + 1
        self.largest, self.longest = max(self.largest, size), max(self.longest, seconds)
        why = "hang" if seconds > PATIENCE else "signal" if code < 0 else "memory" if size > LARGEST else ""
        why = why or ("traceback" if "Traceback (most recent call last)" in words else "")
        why = why or ("escape" if "\x1b[2J" in words else "")
        self.faults += [f"{why} ({about}, code {code}, {seconds:.1f} s, {size:.0f} MB): {words[-1500:]}"] if why else []

    def close(self, least: int = COUNT) -> None:
        """Print the counts; AssertionError for a fault, or for fewer mutations than were to be made."""
        kinds = [line.split()[0] for line in self.faults]
        counts = ", ".join(
            f"{kinds.count(kind)} {kind}" for kind in ("traceback", "hang", "signal", "memory", "escape")
        )
        sys.stdout.write(
            f"\n{self.name}: {self.tried} mutations, {counts}, at most {self.largest:.0f} MB and "
            f"{self.longest:.1f} s; exit codes {dict(sorted(self.codes.items()))}\n"
        )
        assert self.tried >= least and not self.faults, f"{len(self.faults)} faults\n" + "\n\n".join(self.faults[:8])


def run_apart(work: Callable[[], int | None]) -> tuple[int, str, float, float]:
    """Fork, run; the exit code, what was printed, how long it took [s], and the largest resident memory [MB]."""
    with tempfile.TemporaryFile() as out:
        began = time.monotonic()
        if not (pid := os.fork()):
            code = 70
            try:
                os.setpgid(0, 0)
                resource.setrlimit(resource.RLIMIT_CPU, (CPU, CPU))
                os.dup2(out.fileno(), 1)
                os.dup2(out.fileno(), 2)
                sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
                code = int(work() or 0)
            except SystemExit as ended:
                code = ended.code if isinstance(ended.code, int) else 1
            except BaseException:
                traceback.print_exc()
            finally:
                for stream in (sys.stdout, sys.stderr):
                    stream.flush()
                os._exit(code)
        while not (found := os.wait4(pid, os.WNOHANG))[0] and time.monotonic() - began < PATIENCE:
            time.sleep(0.002)
        seconds = time.monotonic() - began
        if not found[0]:
            os.kill(pid, signal.SIGKILL)
            found, seconds = os.wait4(pid, 0), PATIENCE + seconds
        out.seek(0)
        words = out.read(2**20).decode(errors="replace")
    return os.waitstatus_to_exitcode(found[1]), words, seconds, found[2].ru_maxrss / 1e3
