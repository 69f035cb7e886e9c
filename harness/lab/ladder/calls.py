"""Refuse system calls to a submission by libseccomp, where landlock(7) leaves them open.

libseccomp is part of every Debian, Ubuntu and Fedora; it knows the numbers of calls on each processor and refuses those
of other processors. It is called by ctypes, as no maintained package on PyPI wraps it.
"""

import ctypes
import errno
import socket
from collections.abc import Iterator
from dataclasses import dataclass

LIBRARY = "libseccomp.so.2"
ALLOW, REFUSE = 0x7FFF0000, 0x00050000  # actions; an error's number is added to the latter
NOT_EQUAL, MASKED = 1, 7  # comparisons of seccomp_rule_add(3)
KINDS_OF_SOCKETS = 0xF  # bits of the type of a socket; others are flags
NUMBERS_OF_IOCTL = 0xFFFFFFFF  # the kernel reads these bits of a request
CHATTR = (0x40086602, 0x40046602, 0x40087602, 0x40047602, 0x401C5820)  # requests that set flags and versions of inodes
# refused even for files in the submission's own folder: seccomp sees numbers, no paths
ATTRIBUTES = (  # calls that change attributes of files
    "chmod",
    "fchmod",
    "fchmodat",
    "fchmodat2",
    "chown",
    "fchown",
    "lchown",
    "fchownat",
    "utime",
    "utimes",
    "futimesat",
    "utimensat",
    "setxattr",
    "lsetxattr",
    "fsetxattr",
    "setxattrat",
    "removexattr",
    "lremovexattr",
    "fremovexattr",
    "removexattrat",
    "file_setattr",
)
SHARED = (  # calls for memory, queues, semaphores and keys that processes share
    "shmget",
    "shmat",
    "shmctl",
    "msgget",
    "msgsnd",
    "msgrcv",
    "msgctl",
    "semget",
    "semop",
    "semtimedop",
    "semctl",
    "mq_open",
    "mq_unlink",
    "add_key",
    "request_key",
    "keyctl",
)
# calls that change another process, unless their first argument is 0, the caller itself
OF_OTHERS = ("sched_setaffinity", "sched_setscheduler", "sched_setparam", "sched_setattr", "prlimit64")
# these numbers are equal on all processors
NEWER = {"fchmodat2": 452, "setxattrat": 463, "removexattrat": 466, "file_setattr": 469}
UNKNOWN = range(470, 512)  # calls that did not exist when this was written


class ArgumentTest(ctypes.Structure):
    """A comparison of an argument of a call with ``number``.

    For ``MASKED``, of its bits in ``number`` with ``other``.
    """

    _fields_ = (
        ("argument", ctypes.c_uint),
        ("how", ctypes.c_int),
        ("number", ctypes.c_uint64),
        ("other", ctypes.c_uint64),
    )


@dataclass(frozen=True)
class RefusedCall:
    """A refused call by name or number, its error, and tests of arguments; without tests it is always refused."""

    call: str | int
    error: int = errno.EPERM
    tests: tuple[tuple[int, int, int, int], ...] = ()  # tests of arguments, as of ``ArgumentTest``


def _list_refused_calls() -> Iterator[RefusedCall]:
    """Yield the refused calls: sockets, file attributes, System V memory, priorities and limits of other processes.

    Calls that are newer than this list are refused, too.
    """
    yield RefusedCall("socket", errno.EACCES)  # TCP, MPTCP, UDP, Unix, netlink, vsock and future families
    # a pair of another type can send to other addresses
    for kind in set(range(KINDS_OF_SOCKETS + 1)) - {int(socket.SOCK_STREAM)}:
        yield RefusedCall("socketpair", errno.EACCES, ((1, MASKED, KINDS_OF_SOCKETS, kind),))
    yield RefusedCall("io_uring_setup", errno.ENOSYS)  # io_uring performs these operations without the calls
    for request in CHATTR:
        yield RefusedCall("ioctl", errno.EPERM, ((1, MASKED, NUMBERS_OF_IOCTL, request),))
    for name in (*ATTRIBUTES, *SHARED):
        yield RefusedCall(name)
    for name in OF_OTHERS:
        yield RefusedCall(name, errno.EPERM, ((0, NOT_EQUAL, 0, 0),))
    for name, own in (("setpriority", 0), ("ioprio_set", 1)):  # arguments: kind of process, then its number
        yield RefusedCall(name, errno.EPERM, ((0, NOT_EQUAL, own, 0),))
        yield RefusedCall(name, errno.EPERM, ((1, NOT_EQUAL, 0, 0),))
    for number in UNKNOWN:
        yield RefusedCall(number, errno.ENOSYS)


def refuse_calls() -> bool:
    """Refuse the calls of ``_list_refused_calls`` to this process and its children, permanently.

    Return whether that succeeded: without libseccomp, or if it cannot refuse one of them, no call is refused.
    """
    try:
        library = ctypes.CDLL(LIBRARY)
        init, release = library.seccomp_init, library.seccomp_release
        resolve_name, add_rule = library.seccomp_syscall_resolve_name, library.seccomp_rule_add_array
    except (OSError, AttributeError):
        return False
    init.restype, init.argtypes = ctypes.c_void_p, (ctypes.c_uint32,)
    for function in (release, library.seccomp_load):
        function.argtypes = (ctypes.c_void_p,)
    add_rule.argtypes = (ctypes.c_void_p, ctypes.c_uint32, ctypes.c_int, ctypes.c_uint, ctypes.POINTER(ArgumentTest))
    rules = init(ALLOW)
    if not rules:
        return False
    try:
        for refusal in _list_refused_calls():
            number = resolve_name(refusal.call.encode()) if isinstance(refusal.call, str) else refusal.call
            if number == -1:  # the library is older than the call
                number = NEWER.get(str(refusal.call), -1)
            tests = (ArgumentTest * len(refusal.tests))(*(ArgumentTest(*one) for one in refusal.tests))
            action = REFUSE | refusal.error
            if number == -1 or add_rule(rules, action, number, len(tests), tests):
                return False
        return bool(library.seccomp_load(rules) == 0)
    finally:
        release(rules)
