"""A forked process: a session of its own, limits, standard error in a file.

Forked from a single-threaded parent that has numpy, numba, casadi and the catalogues loaded: starting takes
milliseconds where a fresh interpreter takes a second.
"""

import ctypes
import errno
import os
import resource
import signal
import sys
import threading
import traceback
from collections.abc import Callable
from pathlib import Path

from ..places import Place

Target = Callable[[Callable[[str], None]], object]  # what a child runs, given how to send a line
OUTPUT_LIMIT = 2**30  # [bytes] largest file a run may write
CANNOT_WRITE = 74  # exit code (EX_IOERR): the disk is full, which is not a result of the run
DISK_FULL = (errno.ENOSPC, errno.EDQUOT)
PR_SET_PDEATHSIG = 1  # prctl(2)
STDERR_KEPT = 2**16  # [bytes] of each end of a longer standard error


def fork(target: Target, stderr: Path | Place, memory: float, cpu: float) -> tuple[int, int]:
    """Run ``target(send)`` in a child with ``memory`` [MB] beyond what is loaded and ``cpu`` [s].

    Returns its process (and group) and the read end of the pipe on which it sends lines.
    The child ends with exit code 0 if ``target`` returns, 70 if it raises, ``CANNOT_WRITE`` on a full disk.
    """
    if threading.active_count() > 1:
        running = threading.active_count() - 1
        raise ValueError(f"a run needs a process without threads ({running} run here); start a plugin's own in solve")
    if signal.getsignal(signal.SIGCHLD) == signal.SIG_IGN:  # as a parent may leave it: nobody could be waited for
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    parent = os.getpid()
    read, write = os.pipe()
    sys.stdout.flush()
    sys.stderr.flush()
    pid = os.fork()
    if pid:
        os.close(write)
        return pid, read
    code = 70
    try:
        os.closerange(3, write)  # the parent's own
        os.closerange(write + 1, 1024)
        os.setsid()  # a group of its own: killed whole, with whatever it started
        _end_with(parent)
        _redirect(stderr)
        _limit(memory, cpu)
        for name in (signal.SIGINT, signal.SIGTERM, signal.SIGCHLD):
            signal.signal(name, signal.SIG_DFL)
        with os.fdopen(write, "w", encoding="utf-8", errors="replace") as pipe:
            target(lambda line: print(line, file=pipe, flush=True))
        code = 0
    except BaseException as error:  # the child must never return into its parent's loop
        code = CANNOT_WRITE if isinstance(error, OSError) and error.errno in DISK_FULL else code
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _end_with(parent: int) -> None:
    """Die when the parent does, even by SIGKILL: otherwise nothing would end this process at its limits."""
    if sys.platform.startswith("linux"):
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:  # it went before we asked
            os._exit(70)


def kill_group(pid: int) -> None:
    """End a child and all it started."""
    for end in (os.killpg, os.kill):  # the group does not exist yet if the child has not reached setsid
        try:
            end(pid, signal.SIGKILL)
        except (ProcessLookupError, PermissionError):
            continue


def trim(place: Place) -> None:
    """Keep both ends of a long standard error, and no file where there is nothing in it."""
    if place.kind() not in ("", "a file"):  # the run put it there: it goes
        place.remove_file()
    size = place.size() if place.kind() else -1
    if size == 0:
        place.remove_file()
    elif size > 2 * STDERR_KEPT:
        with place.open_file() as file:
            head = file.read(STDERR_KEPT)
            file.seek(-STDERR_KEPT, os.SEEK_END)
            tail = file.read()
        place.write(head + f"\n... {size - 2 * STDERR_KEPT} bytes left out ...\n".encode() + tail)


def _redirect(stderr: Path | Place) -> None:
    file = stderr.open_new() if isinstance(stderr, Place) else stderr.open("ab")
    target = os.dup(file.fileno())
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.dup2(target, 1)  # what a solver prints belongs with its errors
    os.dup2(target, 2)
    os.close(target)
    os.close(nothing)


def _limit(memory: float, cpu: float) -> None:
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (OUTPUT_LIMIT, OUTPUT_LIMIT))
    seconds = int(cpu) + 1
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))
    allowed = _data_in_use() + int(memory * 2**20)
    resource.setrlimit(resource.RLIMIT_DATA, (allowed, allowed))  # private memory; RLIMIT_AS counts mapped libraries


def _data_in_use() -> int:
    try:
        for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
            if line.startswith("VmData:"):
                return int(line.split()[1]) * 1024
    except OSError:
        pass  # no /proc here (macOS): the limit is then on the whole
    return 0
