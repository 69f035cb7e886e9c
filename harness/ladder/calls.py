"""System calls that a submission may not make, kept by libseccomp: what landlock(7) leaves open.

libseccomp is part of every Debian, Ubuntu and Fedora; it knows the numbers of calls on each processor and refuses those
of other processors. It is called by ctypes: three functions, which no maintained package on PyPI wraps.
"""

import ctypes
import errno
import socket
from collections.abc import Iterator
from dataclasses import dataclass

LIBRARY = "libseccomp.so.2"
ALLOW, REFUSE = 0x7FFF0000, 0x00050000  # actions; an error's number is added to the latter
NOT_EQUAL, MASKED = 1, 7  # comparisons of seccomp_rule_add(3)
KINDS_OF_SOCKETS = 0xF  # bits of their type; others are flags
NUMBERS_OF_IOCTL = 0xFFFFFFFF  # the kernel looks at so many bits of a request
CHATTR = (0x40086602, 0x40046602, 0x40087602, 0x40047602, 0x401C5820)  # requests that set flags and versions of inodes
# none of these asks whether a file lies in the submission's own folder: it cannot be told from numbers
ATTRIBUTES = (
    "chmod", "fchmod", "fchmodat", "fchmodat2", "chown", "fchown", "lchown", "fchownat",
    "utime", "utimes", "futimesat", "utimensat", "setxattr", "lsetxattr", "fsetxattr", "setxattrat",
    "removexattr", "lremovexattr", "fremovexattr", "removexattrat", "file_setattr",
)  # fmt: skip
SHARED = (
    "shmget", "shmat", "shmctl", "msgget", "msgsnd", "msgrcv", "msgctl", "semget", "semop", "semtimedop", "semctl",
    "mq_open", "mq_unlink", "add_key", "request_key", "keyctl",
)  # fmt: skip
OF_OTHERS = ("sched_setaffinity", "sched_setscheduler", "sched_setparam", "sched_setattr", "prlimit64")  # 0: itself
NEWER = {"fchmodat2": 452, "setxattrat": 463, "removexattrat": 466, "file_setattr": 469}  # the same on each processor
UNKNOWN = range(470, 512)  # calls that Linux did not have when this was written


class Comparison(ctypes.Structure):
    """Of an argument of a call with a number; ``MASKED``: of its bits in ``number`` with ``other``."""

    _fields_ = (
        ("argument", ctypes.c_uint), ("how", ctypes.c_int), ("number", ctypes.c_uint64), ("other", ctypes.c_uint64),
    )  # fmt: skip


@dataclass(frozen=True)
class Refusal:
    """A call, by name or number, the error that it ends with, and which arguments it is refused for: all without."""

    call: str | int
    error: int = errno.EPERM
    which: tuple[tuple[int, int, int, int], ...] = ()


def _refusals() -> Iterator[Refusal]:
    """Sockets of every family, attributes of files, memory of System V, priorities and limits of other processes."""
    yield Refusal("socket", errno.EACCES)  # TCP, MPTCP, UDP, Unix, netlink, vsock and what will come
    for kind in set(range(KINDS_OF_SOCKETS + 1)) - {int(socket.SOCK_STREAM)}:  # a pair of others can be sent elsewhere
        yield Refusal("socketpair", errno.EACCES, ((1, MASKED, KINDS_OF_SOCKETS, kind),))
    yield Refusal("io_uring_setup", errno.ENOSYS)  # it would make all of these for us
    for request in CHATTR:
        yield Refusal("ioctl", errno.EPERM, ((1, MASKED, NUMBERS_OF_IOCTL, request),))
    for name in (*ATTRIBUTES, *SHARED):
        yield Refusal(name)
    for name in OF_OTHERS:
        yield Refusal(name, errno.EPERM, ((0, NOT_EQUAL, 0, 0),))
    for name, own in (("setpriority", 0), ("ioprio_set", 1)):  # what kind of process, then which
        yield Refusal(name, errno.EPERM, ((0, NOT_EQUAL, own, 0),))
        yield Refusal(name, errno.EPERM, ((1, NOT_EQUAL, 0, 0),))
    for number in UNKNOWN:
        yield Refusal(number, errno.ENOSYS)


def refuse_calls() -> bool:
    """Refuse them to this process and all that it starts, for good; False where the system cannot."""
    try:
        library = ctypes.CDLL(LIBRARY)
        begin, release = library.seccomp_init, library.seccomp_release
        find, add = library.seccomp_syscall_resolve_name, library.seccomp_rule_add_array
    except (OSError, AttributeError):
        return False
    begin.restype, begin.argtypes = ctypes.c_void_p, (ctypes.c_uint32,)
    for function in (release, library.seccomp_load):
        function.argtypes = (ctypes.c_void_p,)
    add.argtypes = (ctypes.c_void_p, ctypes.c_uint32, ctypes.c_int, ctypes.c_uint, ctypes.POINTER(Comparison))
    rules = begin(ALLOW)
    if not rules:
        return False
    try:
        for refusal in _refusals():
            number = find(refusal.call.encode()) if isinstance(refusal.call, str) else refusal.call
            if number == -1:  # the library is older than the call
                number = NEWER.get(str(refusal.call), -1)
            which = (Comparison * len(refusal.which))(*(Comparison(*one) for one in refusal.which))
            action = REFUSE | refusal.error
            if number == -1 or add(rules, action, number, len(which), which):
                return False
        return bool(library.seccomp_load(rules) == 0)
    finally:
        release(rules)
