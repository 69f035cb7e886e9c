"""Measure the CPU time of this process and of process trees, with the same resolution under the sandbox's limits."""

import contextlib
import encodings.ascii  # noqa: F401  else imported at the first read of /proc, perhaps in a timed call
import os
import resource
from collections.abc import Collection, Iterator
from pathlib import Path

TICK = os.sysconf("SC_CLK_TCK")  # [1/s] unit of the times in /proc


def cpu_seconds() -> float:
    """Return the CPU time of this process so far [s]: user and system time of all its threads.

    ``time.process_time`` does not serve: once a process has a limit on its CPU time (RLIMIT_CPU, as every run), Linux
    advances that clock by ticks of 4 ms, and most runs of one body take less.
    """
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


_keepers: list[int] = []  # the last one counts; set once, right after a fork


def set_subreaper(pid: int) -> None:
    """Set the ancestor process that adopts orphans of processes started here (``isolation``)."""
    _keepers.append(pid)


def cpu_seconds_of_tree() -> float:
    """Return the CPU time of this process and of all processes that it has started [s]."""
    return cpu_seconds() + cpu_seconds_of_others()


def cpu_seconds_of_others() -> float:
    """Return the CPU time of all processes started from here, without this one's, to 10 ms for each [s].

    Processes that have left this one's session count, too; one that ended without being waited for does not. Reading
    the time takes 20 times as long as ``cpu_seconds``: to time a call, read both, with ``cpu_seconds`` next to the
    call. A finer clock may show more time of the same processes; clip differences between the two at zero.
    """
    root = _keepers[-1] if _keepers else os.getpid()
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    others = (_read_times(pid) for pid in list_descendants(root) if pid != os.getpid())
    waited_for_by_root = _read_times(root)[1] if root != os.getpid() else 0.0
    return children.ru_utime + children.ru_stime + waited_for_by_root + sum(map(sum, others))


def cpu_seconds_below(root: int) -> float:
    """Return the CPU time of the process ``root`` and its descendants, also ended ones that were waited for [s]."""
    return sum(sum(_read_times(pid)) for pid in (root, *list_descendants(root)))


def cpu_by_process(root: int) -> dict[int, float]:
    """Return the CPU time of each descendant of ``root``, without that of its children [s], by process id."""
    return {pid: _read_times(pid)[0] for pid in list_descendants(root)}


def list_descendants(root: int, spared: Collection[int] = ()) -> list[int]:
    """Return the ids of all descendants of the process ``root``, including zombies; empty without /proc.

    Processes in ``spared`` and their descendants are left out.
    """
    found, new = list[int](), [root]
    while new:
        pid = new.pop()
        below = [child for child in _list_children(pid) if child not in spared]
        found += below
        new += below
    return found


def _list_children(pid: int) -> Iterator[int]:
    """Yield the ids of the children of all threads of a process; a thread that ends meanwhile is skipped."""
    with contextlib.suppress(OSError):
        for task in os.listdir(f"/proc/{pid}/task"):
            with contextlib.suppress(OSError):
                yield from map(int, Path(f"/proc/{pid}/task/{task}/children").read_text(encoding="ascii").split())


def _read_times(pid: int) -> tuple[float, float]:
    """Return the CPU time [s] of a process and of its ended children that it waited for; zeros once it has ended."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace")
    except OSError:  # it has ended
        return 0.0, 0.0
    own, system, waited, waited_system = (int(word) for word in text.rpartition(")")[2].split()[11:15])
    return (own + system) / TICK, (waited + waited_system) / TICK
