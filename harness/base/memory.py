"""Measure the memory of a tree of processes, each page once, even if shared or inherited by a fork.

The system's limit (RLIMIT_DATA) is on the private memory of each process only.
"""

import contextlib
import os
from collections.abc import Iterable
from pathlib import Path

PAGE = os.sysconf("SC_PAGE_SIZE") / 2.0**20  # [MB]
KEPT = ("Pss_Anon:", "Pss_Shmem:", "SwapPss:")  # without pages of files, which the system can drop
KILO = 2.0**-10  # [MB] in a kB


def measure_own_memory() -> float:
    """Return the resident memory [MB] of this process without pages of files.

    A fork begins with this memory and shares it.
    """
    return _count_pages("self")[1] * PAGE


def bound_memory(processes: Iterable[int]) -> float:
    """Return an upper bound on the memory [MB] of all processes, quickly: it counts files, and shared pages in each."""
    return sum(_count_pages(pid)[0] for pid in processes) * PAGE


def measure_memory(processes: Iterable[int]) -> float:
    """Return the memory [MB] of all processes without files; each page counts once, hidden ones in each process.

    A process hides its pages by ``isolation.protect_process``.
    """
    total = 0.0
    for pid in processes:
        try:
            lines = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii").splitlines()
        except OSError:  # ended, or hidden by prctl(PR_SET_DUMPABLE)
            total += _count_pages(pid)[0] * PAGE
        else:
            total += sum(int(line.split()[1]) * KILO for line in lines if line.startswith(KEPT))
    return total


def _count_pages(pid: int | str) -> tuple[int, int]:
    """Return how many pages of a process are resident, and how many of those belong to no file; zeros once ended."""
    with contextlib.suppress(OSError):
        resident, shared = Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1:3]
        return int(resident), int(resident) - int(shared)
    return 0, 0
