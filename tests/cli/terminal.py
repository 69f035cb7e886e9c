"""A terminal of a given width to run commands in: what a person would see, line by line."""

import fcntl
import os
import pty
import re
import select
import struct
import subprocess
import sys
import termios
import time
from pathlib import Path

ESCAPE = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]|\x1b\][^\x07]*\x07")


def in_terminal(*arguments: str, width: int, where: Path, timeout: float = 60.0, **environment: str) -> tuple[int, str]:
    """Exit code and all that ``mbsbench ...`` wrote to a terminal ``width`` columns wide."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 40, width, 0, 0))
    clean = {k: v for k, v in os.environ.items() if k not in ("NO_COLOR", "COLUMNS", "FORCE_COLOR")}
    process = subprocess.Popen(
        (sys.executable, "-m", "mbsbench.cli", *arguments),
        cwd=where,
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        env={**clean, "TERM": "xterm-256color", **environment},
        close_fds=True,
    )
    os.close(theirs)
    out, until = b"", time.monotonic() + timeout
    while time.monotonic() < until:
        if select.select([ours], [], [], 0.1)[0]:
            try:
                chunk = os.read(ours, 2**16)
            except OSError:  # the other end is closed
                break
            if not chunk:
                break
            out += chunk
    os.close(ours)
    process.kill() if process.poll() is None and time.monotonic() >= until else None
    return process.wait(timeout=10), out.decode("utf-8", errors="replace")


def seen(text: str) -> list[str]:
    """The lines without colours and movements of the cursor."""
    return [line for part in ESCAPE.sub("", text).split("\n") for line in part.rstrip("\r").split("\r")]
