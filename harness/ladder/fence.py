"""What a submission may write to, as Linux keeps it (landlock(7)): one folder, no network by TCP."""

import ctypes
import os
import sys
from pathlib import Path

from ..sandbox.isolation import CREATE_RULESET, RESTRICT_SELF

ADD_RULE, BENEATH = 445, 1  # system call, kind of rule
WRITE, TRUNCATE, REFER = 1 << 1, 1 << 14, 1 << 13
REMOVE_AND_MAKE = sum(1 << k for k in range(4, 13))  # folders, files, links, pipes, sockets, devices
TCP = 0b11  # bind and connect
VERSIONS = ((3, TRUNCATE), (2, REFER), (1, WRITE | REMOVE_AND_MAKE))  # the first that has the right


class _Beneath(ctypes.Structure):
    _pack_ = 1
    _fields_ = (("allowed", ctypes.c_uint64), ("parent", ctypes.c_int32))


def keep_in_folder(folder: Path) -> bool:
    """Let this process and all that it starts write below ``folder`` alone; False where the system cannot."""
    if not sys.platform.startswith("linux"):
        return False
    system = ctypes.CDLL(None).syscall
    version = system(CREATE_RULESET, None, ctypes.c_size_t(0), 1)
    if version < 1:
        return False
    rights = sum(right for since, right in VERSIONS if version >= since)
    handled = (ctypes.c_uint64 * 2)(rights, TCP if version >= 4 else 0)
    ruleset = system(CREATE_RULESET, handled, ctypes.c_size_t(ctypes.sizeof(handled)), 0)
    for place, allowed in ((folder, rights), (Path(os.devnull), rights & (WRITE | TRUNCATE))):
        parent = os.open(place, os.O_PATH)
        rule = _Beneath(allowed, parent)
        system(ADD_RULE, ruleset, BENEATH, ctypes.byref(rule), 0)
        os.close(parent)
    done = system(RESTRICT_SELF, ruleset, 0) == 0
    os.close(ruleset)
    return done
