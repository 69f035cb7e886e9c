"""Memory of a tree of processes, each page once, though shared or inherited by a fork.

The system's limit (RLIMIT_DATA) is on the private memory of each process alone.
"""

import contextlib
import os
from collections.abc import Iterable
from pathlib import Path

PAGE = os.sysconf("SC_PAGE_SIZE") / 2.0**20  # [MB]
KEPT = ("Pss_Anon:", "Pss_Shmem:", "SwapPss:")  # without what files hold, which the system can drop
KILO = 2.0**-10  # [MB] in a kB


def own_megabytes() -> float:
    """Memory [MB] of this process that no file holds: what a fork of it begins with, and shares as long as it can."""
    return _pages("self")[1] * PAGE


def megabytes_at_most(processes: Iterable[int]) -> float:
    """Memory [MB] of all of them, what they share counted for each: no process is held up to tell it."""
    return sum(_pages(pid)[0] for pid in processes) * PAGE


def megabytes(processes: Iterable[int]) -> float:
    """Memory [MB] of all of them that no file holds, each page once; of one that hides its pages all count."""
    total = 0.0
    for pid in processes:
        try:
            lines = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii").splitlines()
        except OSError:  # gone, or shut by prctl(PR_SET_DUMPABLE)
            total += _pages(pid)[0] * PAGE
        else:
            total += sum(int(line.split()[1]) * KILO for line in lines if line.startswith(KEPT))
    return total


def _pages(pid: int | str) -> tuple[int, int]:
    """Pages in memory, all and those of no file."""
    with contextlib.suppress(OSError):
        resident, shared = Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1:3]
        return int(resident), int(resident) - int(shared)
    return 0, 0
