"""How long a suite will still take: from what its runs were expected to take, and what they took so far."""

import contextlib
import heapq
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from ..places import Place
from ..results import store
from ..suites.spec import RunSpec

RUNS = 3  # earlier results folders that are read
PRIOR = 2.0  # [s] of runs as they were expected: what ends first says little about the pace of the rest


def durations(local: Path = store.LOCAL, suite: str = "") -> dict[str, float]:
    """Wall time [s] by ``settings`` in the newest results folders, those of ``suite`` before others."""
    folders = [p for p in local.glob("*") if (Place(p) / "runs").kind() == "a folder" and not p.is_symlink()]
    newest = sorted(folders, key=lambda p: (p.name.startswith(f"{suite}-"), p.stat().st_mtime))[-RUNS:]
    out: dict[str, float] = {}
    for folder in newest:
        with contextlib.suppress(ValueError, OSError):  # a bad folder beside ours only costs the estimate
            out |= {r.settings_id: r.wall_s for r in store.load(folder, check_series=False).records if r.wall_s > 0.0}
    return out


class Estimate:
    """The time that runs will still take, from what was ``expected`` [s] of each and how those that ended compare."""

    def __init__(self, expected: Mapping[str, float]) -> None:
        self.expected = expected
        self.spent = self.foreseen = PRIOR  # [s] of runs that have ended

    def learn(self, spec: RunSpec, seconds: float) -> None:
        """Note the wall time of a run that has ended."""
        self.spent += seconds
        self.foreseen += self.expected.get(spec.settings_id, seconds)

    def guess(self, spec: RunSpec) -> float:
        """Return the wall time [s] of a run, at the pace of those that have ended."""
        return self.expected.get(spec.settings_id, 0.0) * self.spent / self.foreseen

    def rest(self, spec: RunSpec, since: float) -> float:
        """Return what a run will take beyond ``since`` [s]; one that is late takes half as long again."""
        left = self.guess(spec) - since
        return left if left > 0.0 else since / 2.0

    def estimate_left(self, running: Iterable[tuple[RunSpec, float]], waiting: Iterable[RunSpec], size: int) -> float:
        """Return [s] until all is done, ``size`` at a time; ``running`` are runs and since when [s] they run."""
        return schedule_end([self.rest(*run) for run in running], [self.guess(spec) for spec in waiting], size)

    def share_done(self, running: Sequence[tuple[RunSpec, float]], waiting: Iterable[RunSpec]) -> float:
        """Return the share of the work that is done: of seconds of runs, not of their number."""
        done = self.spent - PRIOR + sum(since for _, since in running)
        left = sum(self.rest(*run) for run in running) + sum(self.guess(spec) for spec in waiting)
        return done / (done + left) if done + left > 0.0 else 1.0


def schedule_end(running: Sequence[float], waiting: Sequence[float], size: int) -> float:
    """When the last one ends, if each free place takes the next in order: times left [s] and times [s]."""
    free = [0.0] * max(size - len(running), 0) + list(running)
    if not free:
        return 0.0
    heapq.heapify(free)
    for seconds in waiting:
        heapq.heappush(free, heapq.heappop(free) + seconds)
    return max(free)


COMPILING, REFERENCES = "compiling kernels", "computing references"
PREPARING = f"{REFERENCES} and {COMPILING}"


def describe_wait(doing: str, elapsed: float, usual: float = 0.0) -> str:
    """Describe what is being done and how long it will still take; ``elapsed`` [s] of ``usual`` have passed."""
    left = usual - elapsed
    if left > 0.0:
        return f"{doing}: about {in_words(left)} left (this once, not counted in any run)"
    return f"{doing}: {in_words(elapsed)} so far"


def in_words(seconds: float) -> str:
    """``45 s``, ``3 min 20 s``, ``2 h 5 min``."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s" if whole < 600 else f"{round(whole / 60)} min"
    return f"{whole // 3600} h {whole % 3600 // 60} min"
