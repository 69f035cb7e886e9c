"""Confine a submission by means of Linux: one folder to write to, no answers, no socket, no other process.

landlock(7) restricts files, TCP and abstract sockets; calls that it leaves open are refused (module ``calls``). Memory
and signals of other processes are out of reach already: ``isolate_process`` separates every run's process from them.
"""

import ctypes
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from ...base.isolation import CREATE_RULESET, RESTRICT_SELF
from .calls import refuse_calls

ADD_RULE, BENEATH = 445, 1  # system call, kind of rule
WRITE, READ, TRUNCATE, REFER = 1 << 1, 1 << 2, 1 << 14, 1 << 13
REMOVE_AND_MAKE = sum(1 << k for k in range(4, 13))  # folders, files, links, pipes, sockets, devices
TCP = 0b11  # bind and connect
NEW_USERS_AND_IPC = 0x10000000 | 0x08000000  # namespaces(7): keyrings, shared memory and queues of System V
SIGNALS, ABSTRACT = 6, 1  # the first version that restricts signals (``base.isolation``); abstract Unix sockets
VERSIONS = ((3, TRUNCATE), (2, REFER), (1, READ | WRITE | REMOVE_AND_MAKE))  # the first version that has the right


class _PathBeneath(ctypes.Structure):
    """The kernel's landlock_path_beneath_attr: rights below the folder with file descriptor ``parent``."""

    _pack_ = 1
    _fields_ = (("allowed", ctypes.c_uint64), ("parent", ctypes.c_int32))


def confine_to_folder(folder: Path, hidden: Sequence[Path]) -> bool:
    """Confine this process and its children: they write below ``folder`` only, and read no file below ``hidden``.

    They may still read and write the null device, and read all other files. Sockets other than pairs of streams are
    refused, as are changes of files' attributes, System V memory, and priorities of other processes. Call it in a
    process that ``isolate_process`` separated.

    Return whether the system enforces all of that and of ``isolate_process``, which takes Linux 6.12 for signals. If
    not, what it does enforce stays in force. A process of root counts as confined only in a user namespace of its own,
    where it has lost root's rights over everything outside.
    """
    if not sys.platform.startswith("linux"):
        return False
    system, is_root = ctypes.CDLL(None).syscall, os.getuid() == 0
    in_namespace = _isolate_memory()
    version = system(CREATE_RULESET, None, ctypes.c_size_t(0), 1)
    if version < 1:
        return False
    rights = sum(right for since, right in VERSIONS if version >= since)
    handled = (ctypes.c_uint64 * 3)(rights, TCP if version >= 4 else 0, ABSTRACT if version >= SIGNALS else 0)
    ruleset = system(CREATE_RULESET, handled, ctypes.c_size_t(ctypes.sizeof(handled)), 0)
    places = [
        (folder, rights),
        (Path(os.devnull), READ | WRITE),
        *((p, READ) for p in _list_all_but(hidden, Path("/"))),
    ]
    for place, allowed in places:
        try:
            parent = os.open(place, os.O_PATH)
        except OSError:  # it was removed, or must not be read
            continue
        rule = _PathBeneath(allowed, parent)
        system(ADD_RULE, ruleset, BENEATH, ctypes.byref(rule), 0)
        os.close(parent)
    done = system(RESTRICT_SELF, ruleset, 0) == 0
    os.close(ruleset)
    refused = refuse_calls()
    return done and refused and version >= SIGNALS and (in_namespace or not is_root)


def _isolate_memory() -> bool:
    """Move this process to new namespaces, without the System V memory of others and without root's rights.

    Return whether that succeeded.
    """
    user, group = os.getuid(), os.getgid()
    if ctypes.CDLL(None).unshare(NEW_USERS_AND_IPC):
        return False
    try:
        for name, line in (("setgroups", "deny"), ("uid_map", f"{user} {user} 1"), ("gid_map", f"{group} {group} 1")):
            Path(f"/proc/self/{name}").write_text(line, encoding="ascii")
    except OSError:  # a process that is not dumpable, or a system that gives no rights in a namespace
        return False
    return True


def _list_all_but(hidden: Sequence[Path], folder: Path) -> Iterator[Path]:
    """Yield the fewest paths below ``folder`` that together contain everything except ``hidden``."""
    for place in (folder / name for name in os.listdir(folder)):
        if any(h.is_relative_to(place) for h in hidden):
            if place not in hidden:
                yield from _list_all_but(hidden, place)
        else:
            yield place
