"""Fork a process with limits and a session of its own, its standard error in a file, and a keeper as its parent.

The keeper ends all that the process starts. The forking process is single-threaded and has numpy, numba, casadi and the
catalogues loaded: forking takes milliseconds, a fresh interpreter a second.
"""

import contextlib
import ctypes
import errno
import math
import os
import resource
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Collection
from pathlib import Path

from .clock import cpu_seconds, list_descendants, set_subreaper
from .code_meter import HARD, limit_solver_time
from .confined_paths import ConfinedPath

Target = Callable[[Callable[[str], None]], object]  # what a child runs, given a function that sends a line
OUTPUT_LIMIT = 2**30  # [bytes] largest file a run may write
CANNOT_WRITE = 74  # exit code (EX_IOERR): the disk is full, which is not a result of the run
DISK_FULL = (errno.ENOSPC, errno.EDQUOT)
BEGUN = "begun"  # first line from a child whose target began; else it says why not
PR_SET_PDEATHSIG, PR_SET_DUMPABLE, PR_SET_CHILD_SUBREAPER, PR_SET_NO_NEW_PRIVS = 1, 4, 36, 38  # prctl(2)
CREATE_RULESET, RESTRICT_SELF = 444, 446  # system calls of landlock(7)
MAKE_BLOCK, SCOPE_SIGNAL = 1 << 11, 1 << 1  # rights removed: making block devices, signalling processes outside
TOLD = (signal.SIGTERM, signal.SIGCHLD)  # signals that a keeper waits for
# [s] for ending all that a target has started: more delays the next run, less may leave some of it behind
PATIENCE = 5.0
# [bytes] of each end of a longer standard error: more keeps what a loop repeats, less may cut a traceback
STDERR_KEPT = 2**16


def describe_missing_protection(platform: str = sys.platform) -> str:
    """Describe in one line what a run is not protected from on this system; empty on Linux."""
    if platform.startswith("linux"):
        return ""
    return (
        "this system is not Linux: a run's memory is not limited, its CPU limit leaves out processes that a solver "
        "starts, and those may outlive it (docs/known-limitations.md)"
    )


def fork(
    target: Target, stderr: Path | ConfinedPath, memory: float, cpu: float, *, keeper: bool = True, code: float = 0.0
) -> tuple[int, int]:
    """Run ``target(send)`` in a child limited to ``memory`` [MB], ``cpu`` [s], and ``code`` [s] for making code.

    Return its keeper's process id (and group) and the read end of the pipe on which ``send`` writes lines. Standard
    output and error go to the file ``stderr``. The memory is that beyond what is loaded here. The keeper adopts all
    that ``target`` starts and leaves running; when the child ends, it ends that too, waits for it, so that the system
    accounts for its CPU time, and then ends as the child did: with exit code 0 if ``target`` returned, 70 if it raised,
    ``CANNOT_WRITE`` on a full disk. The first line is ``BEGUN`` or, if the child could not be prepared for its target,
    the reason. SIGTERM to the keeper ends all at once. Raise ValueError if this process has several threads.
    Without a ``keeper`` the child's own process id is returned.
    """
    if threading.active_count() > 1:
        running = threading.active_count() - 1
        raise ValueError(f"a run needs a process without threads ({running} run here); start a plugin's own in solve")
    if signal.getsignal(signal.SIGCHLD) == signal.SIG_IGN:  # an inherited SIG_IGN would make waitpid fail
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    parent = os.getpid()
    read, write = os.pipe()
    _flush()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, TOLD)
    pid = os.fork()
    if pid:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        os.close(write)
        return pid, read
    ended, begun = 70, False
    try:
        os.setsid()  # a group of its own
        end_with_parent(parent)
        if keeper:
            _become_keeper((read, write))
        isolate_process()
        os.closerange(3, write)  # the parent's own
        os.closerange(write + 1, 1024)
        _redirect_streams(stderr)
        limit_process(memory, cpu, code)
        os.write(write, f"{BEGUN}\n".encode())
        begun = True
        for name in (signal.SIGINT, signal.SIGTERM, signal.SIGCHLD):
            signal.signal(name, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        with os.fdopen(write, "w", encoding="utf-8", errors="replace") as pipe:
            target(lambda line: print(line, file=pipe, flush=True))
        ended = 0
    except BaseException as error:  # the child must never return into its parent's loop
        ended = CANNOT_WRITE if is_disk_full_error(error) else ended
        with contextlib.suppress(Exception):  # on a full disk nothing can be written
            if not begun:
                os.write(write, f"{type(error).__name__}: {error}\n".encode(errors="replace"))
            traceback.print_exc()
    finally:
        try:
            _flush()
        finally:
            os._exit(ended)


def _flush() -> None:
    """Flush buffered output; a program without a terminal may have no streams."""
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()


def is_disk_full_error(error: BaseException) -> bool:
    """Return whether ``error`` means that a disk is full, or that a file exceeds a limit set outside, below ours."""
    if not isinstance(error, OSError):
        return False
    cut = error.errno == errno.EFBIG and resource.getrlimit(resource.RLIMIT_FSIZE)[0] < OUTPUT_LIMIT
    return cut or error.errno in DISK_FULL


def adopt_orphans() -> None:
    """Become the parent of all processes below this one whose own parents end."""
    _prctl(PR_SET_CHILD_SUBREAPER, 1)


def protect_process() -> None:
    """Protect memory and open files of this process and its children from other processes of this user."""
    _prctl(PR_SET_DUMPABLE, 0)


def isolate_process() -> None:
    """Restrict this process and its children: no access to memory or open files of others, nor signals to them.

    Landlock enforces it, for root too (signals since Linux 6.12). Where the kernel lacks it, processes have only the
    protection of ``protect_process``.
    """
    protect_process()
    _prctl(PR_SET_NO_NEW_PRIVS, 1)
    if sys.platform.startswith("linux"):
        system = ctypes.CDLL(None).syscall
        signals = system(CREATE_RULESET, None, ctypes.c_size_t(0), 1) >= 6  # version of landlock
        # struct landlock_ruleset_attr: rights on files, rights on the net, scopes; one of them must be restricted
        rules = (ctypes.c_uint64 * 3)(0 if signals else MAKE_BLOCK, 0, SCOPE_SIGNAL if signals else 0)
        ruleset = system(CREATE_RULESET, rules, ctypes.c_size_t(ctypes.sizeof(rules)), 0)
        if ruleset >= 0:
            if system(RESTRICT_SELF, ruleset, 0) == 0:  # separated from its siblings; its parent may read its memory
                _prctl(PR_SET_DUMPABLE, 1)
            os.close(ruleset)


def _prctl(option: int, value: int) -> None:
    """Set an attribute of this process (prctl(2)); do nothing on systems other than Linux."""
    if sys.platform.startswith("linux"):
        ctypes.CDLL(None).prctl(option, ctypes.c_ulong(value), 0, 0, 0)


def end_orphans(known: Collection[int]) -> None:
    """Kill and reap all processes below this one, except those ``known`` and their descendants, within ``PATIENCE``."""
    until = time.monotonic() + PATIENCE
    while (strays := list_descendants(os.getpid(), known)) and time.monotonic() < until:
        for pid in strays:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.kill(pid, signal.SIGKILL)
            with contextlib.suppress(ChildProcessError):
                os.waitpid(pid, os.WNOHANG)


def kill_descendants(root: int) -> None:
    """Send SIGKILL to all processes below ``root``."""
    for pid in list_descendants(root):
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.kill(pid, signal.SIGKILL)


def end_descendants() -> tuple[dict[int, int], float]:
    """Kill and reap all processes below this one, within ``PATIENCE``; return their exit statuses and CPU time [s].

    Statuses are by process id, as ``os.waitpid`` returns them.
    """
    statuses, before = dict[int, int](), resource.getrusage(resource.RUSAGE_CHILDREN)
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        kill_descendants(os.getpid())
        statuses |= _reap()
        if not list_descendants(os.getpid()):
            break
        time.sleep(0.001)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return statuses, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _become_keeper(pipe: tuple[int, int]) -> None:
    """Fork the child, in which alone this function returns, and become its keeper.

    On the child's end or on SIGTERM the keeper ends all that the child started, and then ends as the child did. It
    closes ``pipe``, the descriptors of the child's pipe.
    """
    adopt_orphans()
    own = os.getpid()
    child = os.fork()
    if not child:
        end_with_parent(own)
        set_subreaper(own)
        return
    os.closerange(3, max(1024, *pipe) + 1)  # the parent's descriptors, and both ends of the pipe
    status = None
    while status is None and signal.sigwait(TOLD) != signal.SIGTERM:
        status = _reap().get(child)
    if status is None:
        with contextlib.suppress(ProcessLookupError):
            os.kill(child, signal.SIGKILL)
    found, _ = end_descendants()
    status = found.get(child, status)
    code = -signal.SIGKILL if status is None else os.waitstatus_to_exitcode(status)
    if code < 0:
        signal.signal(-code, signal.SIG_DFL) if -code not in (signal.SIGKILL, signal.SIGSTOP) else None
        signal.pthread_sigmask(signal.SIG_UNBLOCK, (-code,))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        os.kill(own, -code)
    os._exit(code)


def _reap() -> dict[int, int]:
    """Wait for all children that have ended, without blocking; return their exit statuses by process id."""
    found = dict[int, int]()
    with contextlib.suppress(ChildProcessError):
        while (ended := os.waitpid(-1, os.WNOHANG))[0]:
            found[ended[0]] = ended[1]
    return found


def end_with_parent(parent: int, number: int = signal.SIGKILL) -> None:
    """Request the signal ``number`` for this process when ``parent`` dies; exit with code 70 if it has died already.

    Nothing else would end this process at its limits if its parent is killed, even by SIGKILL.
    """
    _prctl(PR_SET_PDEATHSIG, number)
    if os.getppid() != parent:  # the parent died before the request
        os._exit(70)


def kill_group(pid: int) -> None:
    """Send SIGKILL to the process group ``pid`` and to its leader."""
    for end in (os.killpg, os.kill):  # the group does not exist until the child has called setsid
        try:
            end(pid, signal.SIGKILL)
        except (ProcessLookupError, PermissionError):
            continue


def trim_output(place: ConfinedPath) -> None:
    """Limit a file of standard error to ``STDERR_KEPT`` bytes at each end; remove it if empty or no regular file."""
    if place.kind() not in ("", "a file"):  # placed there by the run
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


def _redirect_streams(stderr: Path | ConfinedPath) -> None:
    """Redirect standard output and error of this process to the file ``stderr``, its input to the null device."""
    file = stderr.open_new() if isinstance(stderr, ConfinedPath) else stderr.open("ab")
    target = os.dup(file.fileno())
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.dup2(target, 1)  # output of a solver goes with its errors
    os.dup2(target, 2)
    os.close(target)
    os.close(nothing)


def limit_process(memory: float, cpu: float, code: float = 0.0) -> None:
    """Limit this process to ``memory`` [MB] and ``cpu`` [s] of CPU time beyond what it uses now; infinity is no limit.

    It may use ``code`` [s] more to make code. A lower limit from outside, such as a batch system's, stays.
    """
    _limit_resource(resource.RLIMIT_CORE, 0)
    _limit_resource(resource.RLIMIT_FSIZE, OUTPUT_LIMIT)
    if math.isfinite(cpu):
        seconds, hard = int(cpu_seconds() + cpu) + 1, resource.getrlimit(resource.RLIMIT_CPU)[1]
        most = seconds + int(code) + HARD
        hard = most if hard == resource.RLIM_INFINITY else min(hard, most)
        resource.setrlimit(resource.RLIMIT_CPU, (min(seconds, hard), hard))
        if code:
            limit_solver_time(seconds)
    # elsewhere the system accepts the limit but does not enforce it
    if math.isfinite(memory) and not describe_missing_protection():
        # private memory; RLIMIT_AS would count mapped libraries
        _limit_resource(resource.RLIMIT_DATA, _measure_private_memory() + int(memory * 2**20))


def _limit_resource(what: int, most: int) -> None:
    """Set soft and hard limit of this process on ``what`` (RLIMIT_...) to ``most``, or to a lower hard limit."""
    hard = resource.getrlimit(what)[1]
    lower = most if hard == resource.RLIM_INFINITY else min(most, hard)
    resource.setrlimit(what, (lower, lower))


def _measure_private_memory() -> int:
    """Return the private memory of this process that RLIMIT_DATA counts [bytes]; 0 without /proc."""
    with contextlib.suppress(OSError):  # without /proc, as in some containers, the limit includes memory in use
        for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
            if line.startswith("VmData:"):
                return int(line.split()[1]) * 1024
    return 0
