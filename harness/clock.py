"""CPU time of this process and of process trees, as fine under the sandbox's limits as without them."""

import contextlib
import encodings.ascii  # noqa: F401  here, or at the first look at /proc, which may be within a timed call
import os
import resource
from collections.abc import Collection, Iterator
from pathlib import Path

TICK = os.sysconf("SC_CLK_TCK")  # [1/s] unit of the times in /proc


def cpu_seconds() -> float:
    """User and system time of all threads [s].

    Not ``time.process_time``: once a process has a limit on its CPU time (RLIMIT_CPU, as every run), Linux moves that
    clock by ticks of 4 ms, and most runs of one body take less.
    """
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


_keepers: list[int] = []  # of this process, the last one counts: set once, right after a fork


def set_keeper(pid: int) -> None:
    """The process above this one that takes over what is started here and loses its parent (``sandbox.isolation``)."""
    _keepers.append(pid)


def cpu_seconds_of_tree() -> float:
    """``cpu_seconds``, and the time [s] of all that this process has started."""
    return cpu_seconds() + cpu_seconds_of_others()


def cpu_seconds_of_others() -> float:
    """CPU time [s] of all that this process has started, in whatever session, to 10 ms each.

    Reading it takes 20 times as long as ``cpu_seconds``: time a call with both, ``cpu_seconds`` next to the call.
    Finer clocks may count more of one of those: differences with them are cut at zero. What ends without anybody
    having waited for it is not accounted by the system.
    """
    root = _keepers[-1] if _keepers else os.getpid()
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    others = (_times(pid) for pid in descendants(root) if pid != os.getpid())
    waited_for_by_root = _times(root)[1] if root != os.getpid() else 0.0
    return children.ru_utime + children.ru_stime + waited_for_by_root + sum(map(sum, others))


def cpu_seconds_below(root: int) -> float:
    """CPU time [s] of the process ``root`` and of all below it, those included that ended and were waited for."""
    return sum(sum(_times(pid)) for pid in (root, *descendants(root)))


def cpu_by_process(root: int) -> dict[int, float]:
    """CPU time [s] of each process below ``root``, its own alone."""
    return {pid: _times(pid)[0] for pid in descendants(root)}


def descendants(root: int, spared: Collection[int] = ()) -> list[int]:
    """All processes below ``root``, ended ones that nobody has waited for included; none without /proc.

    Without those ``spared`` and what is below them.
    """
    found, new = list[int](), [root]
    while new:
        pid = new.pop()
        below = [child for child in _children(pid) if child not in spared]
        found += below
        new += below
    return found


def _children(pid: int) -> Iterator[int]:
    """Children of all threads of a process; a thread that ends meanwhile has none."""
    with contextlib.suppress(OSError):
        for task in os.listdir(f"/proc/{pid}/task"):
            with contextlib.suppress(OSError):
                yield from map(int, Path(f"/proc/{pid}/task/{task}/children").read_text(encoding="ascii").split())


def _times(pid: int) -> tuple[float, float]:
    """CPU time of a process [s]: its own, and that of its children that ended and that it waited for."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace")
    except OSError:  # it has ended
        return 0.0, 0.0
    own, system, waited, waited_system = (int(word) for word in text.rpartition(")")[2].split()[11:15])
    return (own + system) / TICK, (waited + waited_system) / TICK
