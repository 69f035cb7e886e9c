"""What a submission may not reach, each way tried in a process behind the fence and, as a control, in one without it.

All targets are the test's own: sockets on loopback, a file, and a process that sleeps.
"""

import ctypes
import os
import resource
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import casadi
import numba
import pytest

from mbsbench.harness.base import forked_process
from mbsbench.harness.base.cache import ROOT
from mbsbench.harness.base.forked_process import ForkedProcess
from mbsbench.harness.lab.ladder import calls, fence
from mbsbench.harness.lab.ladder.blind import confine_process
from mbsbench.harness.reference import orbit

MPTCP = 262
SYSTEM = ctypes.CDLL(None, use_errno=True)
FLAGS = 0x40086602  # FS_IOC_SETFLAGS of ioctl_iflags(2)


@dataclass(frozen=True)
class Targets:
    """What is outside: where TCP and UDP are listened to, an abstract Unix socket, a file, a process."""

    port: int
    udp: int
    abstract: str
    file: Path
    process: int


def connect(kind: int, protocol: int, family: int = socket.AF_INET) -> Callable[[Targets], object]:
    def attack(t: Targets) -> object:
        with socket.socket(family, kind, protocol) as made:
            if family == socket.AF_UNIX:
                made.connect(t.abstract)
            elif kind == socket.SOCK_DGRAM:
                made.sendto(b"question", ("127.0.0.1", t.udp))
            elif family == socket.AF_INET:
                made.connect(("127.0.0.1", t.port))

    return attack


def send_from_a_pair(t: Targets) -> None:
    """One end of a pair of datagram sockets can be sent to anywhere."""
    one, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    with one, other:
        one.connect(f"{t.abstract}-datagrams")


def native(result: int) -> None:
    if result < 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))


def make_ring(t: Targets) -> None:
    """io_uring makes system calls for us; its number is the same on each processor."""
    native(SYSTEM.syscall(425, 4, ctypes.create_string_buffer(120)))


def set_flags(t: Targets) -> None:
    with t.file.open("rb") as file:
        native(SYSTEM.ioctl(file.fileno(), ctypes.c_ulong(FLAGS), ctypes.byref(ctypes.c_long(0x80))))  # no atime


def set_times_opened(t: Targets) -> None:
    with t.file.open("rb") as file:
        os.utime(file.fileno(), (0, 0))


def read_memory(t: Targets) -> None:
    """A word of the process, at an address that is mapped in it: what it runs."""
    line = Path(f"/proc/{t.process}/maps").read_text(encoding="ascii").split("-")[0]
    here = ctypes.create_string_buffer(8)
    vectors = [(ctypes.c_ulong * 2)(ctypes.addressof(here), 8), (ctypes.c_ulong * 2)(int(line, 16), 8)]
    native(SYSTEM.process_vm_readv(t.process, vectors[0], 1, vectors[1], 1, 0))


def trace(t: Targets) -> None:
    native(SYSTEM.ptrace(16, t.process, None, None))  # PTRACE_ATTACH: it is let go when we end


def share_memory(t: Targets) -> None:
    native(made := SYSTEM.shmget(0, 4096, 0o1600))
    SYSTEM.shmctl(made, 0, None)  # it would outlive us


def share_queue(t: Targets) -> None:
    native(made := SYSTEM.msgget(0, 0o1600))
    SYSTEM.msgctl(made, 0, None)


def twice(x: float) -> float:
    """Compiled by numba."""
    return 2.0 * x


def read_a_kept_reference(t: Targets) -> bytes:
    """Any of them."""
    kept = next((p for p in orbit.FOLDER.iterdir() if p.is_file()), None)
    if kept is None:
        raise OSError("none is kept here")
    return kept.read_bytes()


ATTACKS: dict[str, Callable[[Targets], object]] = {
    "TCP": connect(socket.SOCK_STREAM, 0),
    "MPTCP": connect(socket.SOCK_STREAM, MPTCP),
    "UDP": connect(socket.SOCK_DGRAM, 0),
    "abstract Unix socket": connect(socket.SOCK_STREAM, 0, socket.AF_UNIX),
    "netlink": connect(socket.SOCK_RAW, 0, socket.AF_NETLINK),
    "a pair of sockets, one sent elsewhere": send_from_a_pair,
    "io_uring": make_ring,
    "chmod": lambda t: t.file.chmod(0o600),
    "fchmodat2": lambda t: native(SYSTEM.syscall(452, -100, os.fsencode(t.file), 0o600, 0)),
    "chown": lambda t: os.chown(t.file, os.getuid(), os.getgid()),
    "utime": lambda t: os.utime(t.file, (0, 0)),
    "utime of an open file": set_times_opened,
    "setxattr": lambda t: os.setxattr(t.file, "user.mbsbench", b"1"),
    "flags of an inode": set_flags,
    "writing": lambda t: t.file.write_text("here"),
    "truncating": lambda t: os.truncate(t.file, 0),
    "a file beside its folder": lambda t: t.file.with_name("new").touch(),
    "reading a problem": lambda t: (ROOT / "problems" / "heavy_top.py").read_bytes(),
    "reading how references are made": lambda t: (ROOT / "harness" / "reference" / "orbit.py").read_bytes(),
    "reading published results": lambda t: (ROOT / "results" / "published" / "claims.json").read_bytes(),
    "reading kept references": read_a_kept_reference,
    "affinity": lambda t: os.sched_setaffinity(t.process, {min(os.sched_getaffinity(0))}),
    "priority": lambda t: os.setpriority(os.PRIO_PROCESS, t.process, 10),
    "priority of a group": lambda t: os.setpriority(os.PRIO_PGRP, t.process, 10),
    "scheduler": lambda t: os.sched_setscheduler(t.process, os.SCHED_BATCH, os.sched_param(0)),
    "a limit": lambda t: resource.prlimit(t.process, resource.RLIMIT_CORE, (0, 0)),
    "a signal": lambda t: os.kill(t.process, signal.SIGWINCH),
    "memory": read_memory,
    "ptrace": trace,
    "shared memory of System V": share_memory,
    "a queue of System V": share_queue,
}
OWN: dict[str, Callable[[Path], object]] = {  # what honest code does
    "a pipe of sockets": lambda folder: socket.socketpair(),
    "its own affinity": lambda folder: os.sched_setaffinity(0, os.sched_getaffinity(0)),
    "its own priority": lambda folder: os.setpriority(os.PRIO_PROCESS, 0, os.getpriority(os.PRIO_PROCESS, 0)),
    "its own limits": lambda folder: resource.setrlimit(resource.RLIMIT_CORE, (0, 0)),
    "a file in its folder": lambda folder: (folder / "x").write_text("1") and (folder / "x").rename(folder / "y"),
    "a function that numba keeps": lambda folder: numba.njit(cache=True)(twice)(1.0),
    "CasADi": lambda folder: casadi.Function("f", [x := casadi.SX.sym("x")], [2.0 * x])(1.0),
    "a child": lambda folder: subprocess.run((sys.executable, "-c", ""), check=True),
}


@pytest.fixture
def targets(tmp_path):
    """Each of them, for one test."""
    name = f"\0mbsbench-{os.getpid()}"
    kinds = (
        (socket.AF_INET, socket.SOCK_STREAM, ("127.0.0.1", 0)),
        (socket.AF_INET, socket.SOCK_DGRAM, ("127.0.0.1", 0)),
        (socket.AF_UNIX, socket.SOCK_STREAM, name),
        (socket.AF_UNIX, socket.SOCK_DGRAM, f"{name}-datagrams"),
    )
    made = [socket.socket(family, kind) for family, kind, _ in kinds]
    for one, (_, kind, address) in zip(made, kinds, strict=True):
        one.bind(address)
        if kind == socket.SOCK_STREAM:
            one.listen()
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside" / "file").write_text("there")
    sleeping = subprocess.Popen(("sleep", "60"), start_new_session=True)
    ports = [one.getsockname()[1] for one in made[:2]]
    try:
        yield Targets(*ports, name, tmp_path / "outside" / "file", sleeping.pid)
    finally:
        sleeping.kill()
        sleeping.wait()
        for one in made:
            one.close()


def attempt(tmp_path, attack, *, fenced=True, user=0):
    """``fenced`` or not as the fence says, and how the attack ended: "done" or an error's name."""
    (tmp_path / "own").mkdir()

    def work(send):
        if user:
            os.chown(tmp_path / "own", user, user)
            os.setgroups([])
            os.setgid(user)
            os.setuid(user)
        kept = confine_process(tmp_path / "own") if fenced else False
        try:
            attack()
        except OSError as error:
            send(f"{kept} {type(error).__name__}: {error}")
        else:
            send(f"{kept} done")

    kept, _, how = ForkedProcess(work, limit=10.0, memory=500.0).wait().sent.strip().partition(" ")
    return kept == "True", how


@pytest.mark.parametrize("what", ["chmod", "chown", "utime", "setxattr", "flags of an inode"])
def test_attributes_of_its_own_files_stay_as_they_are(tmp_path, targets, what):
    """In its own folder it writes files, and changes nothing else of them."""
    own = tmp_path / "own" / "file"
    kept, how = attempt(tmp_path, lambda: (own.write_text("x"), ATTACKS[what](replace(targets, file=own))))
    if not kept:
        pytest.skip("not fenced here")
    assert how != "done"


def system_can_fence():
    """Asked of the system itself: a fence that says wrongly that it cannot hold would skip its own tests."""
    try:
        ctypes.CDLL("libseccomp.so.2")
    except OSError:
        return False

    def work(send):
        send(str(SYSTEM.unshare(fence.NEW_USERS_AND_IPC) == 0))

    namespace = os.getuid() or ForkedProcess(work, limit=10.0, memory=500.0).wait().sent.strip() == "True"
    return bool(namespace) and SYSTEM.syscall(fence.CREATE_RULESET, None, ctypes.c_size_t(0), 1) >= fence.SIGNALS


@pytest.mark.parametrize("what", ATTACKS)
def test_what_is_outside_is_out_of_reach(tmp_path, targets, what):
    """The system refuses it; skipped where the system cannot keep a submission in."""
    kept, how = attempt(tmp_path, lambda: ATTACKS[what](targets))
    if not kept and not system_can_fence():
        pytest.skip("this system cannot fence (landlock of Linux 6.12, libseccomp.so.2)")
    assert kept
    assert how != "done", what
    assert "Error" in how


@pytest.mark.parametrize("what", ATTACKS)
def test_without_the_fence_it_is_within_reach(tmp_path, targets, monkeypatch, what):
    """The control: otherwise the test above would show nothing."""
    monkeypatch.setattr(forked_process, "fork", unclosed(forked_process.fork))
    _, how = attempt(tmp_path, lambda: ATTACKS[what](targets), fenced=False)
    if how != "done":
        pytest.skip(f"this system refuses it to anybody: {how}")


def unclosed(fork):
    """``fork`` without the walls that every process of a run has."""
    from mbsbench.harness.base import isolation

    def begin(*given, **named):
        before, isolation.isolate_process = isolation.isolate_process, lambda: None
        try:
            return fork(*given, **named)
        finally:
            isolation.isolate_process = before

    return begin


def test_an_ordinary_user_is_kept_in_too(tmp_path):
    """Without root's rights, and where no namespace is to be had."""
    if os.getuid():
        pytest.skip("only root can become another user")
    if not attempt(tmp_path, lambda: None)[0]:
        pytest.skip("this system cannot fence (landlock of Linux 6.12, libseccomp.so.2)")

    def change():
        Path("file").write_text("its own")  # in its folder, where it works
        Path("file").chmod(0o600)

    with tempfile.TemporaryDirectory() as place:  # for all to enter, other than those of tests
        os.chmod(place, 0o755)
        kept, how = attempt(Path(place), change, user=65534)
        assert kept and how.startswith("PermissionError") and (Path(place) / "own" / "file").exists(), how


@pytest.mark.parametrize("what", OWN)
def test_honest_code_is_left_alone(tmp_path, what):
    """What solvers and their libraries need is as it was."""
    _, how = attempt(tmp_path, lambda: OWN[what](tmp_path / "own"))
    assert how == "done", what


def test_without_libseccomp_it_is_not_fenced(tmp_path, monkeypatch):
    """The library is not there, or has no such function: the fence says that it does not hold."""
    for name in ("libseccomp-of-nowhere.so.2", "libm.so.6"):
        monkeypatch.setattr(calls, "LIBRARY", name)
        assert not calls.refuse_calls()
    kept, how = attempt(tmp_path, lambda: None)
    assert (kept, how) == (False, "done")


def test_without_landlock_it_is_not_fenced(tmp_path, monkeypatch):
    """A system call that no kernel has in its place."""
    monkeypatch.setattr(fence, "CREATE_RULESET", 9999)
    assert not attempt(tmp_path, lambda: None)[0]


def test_a_fence_that_lacks_a_part_says_so(tmp_path, monkeypatch):
    """No namespace for root, or a Landlock that does not keep signals in: what runs then is marked not fenced."""
    if not os.getuid():
        with monkeypatch.context() as patch:
            patch.setattr(fence, "_isolate_memory", lambda: False)
            assert not attempt(tmp_path, lambda: None)[0]
        (tmp_path / "own").rmdir()
    monkeypatch.setattr(fence, "SIGNALS", 99)
    assert not attempt(tmp_path, lambda: None)[0]
