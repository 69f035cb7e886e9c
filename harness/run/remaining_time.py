"""Estimate how long a suite will still take, from the expected times of its runs and the times so far."""

import contextlib
import heapq
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..base.confined_paths import ConfinedPath
from ..catalogue.suites.spec import RunSpec
from ..results import store

RUNS = 3  # results folders that are read: more cost the reading of their records, and older ones have older code
QUICK = 1.0  # [s] of compilation that is too short to be reported
# [s] of imagined runs that took as long as expected: without it the first to end, which say little, would set the pace
PRIOR = 2.0


def read_durations(local: Path = store.LOCAL, suite: str = "") -> dict[str, float]:
    """Return wall times [s] of runs by ``settings_id`` from the newest ``RUNS`` results folders in ``local``.

    Folders of ``suite`` count as newer than all others; a newer time replaces an older one. Damaged folders are left
    out.
    """
    folders = [p for p in local.glob("*") if (ConfinedPath(p) / "runs").kind() == "a folder" and not p.is_symlink()]
    newest = sorted(folders, key=lambda p: (p.name.startswith(f"{suite}-"), p.stat().st_mtime))[-RUNS:]
    out: dict[str, float] = {}
    for folder in newest:
        with contextlib.suppress(ValueError, OSError):  # a damaged folder may only make the estimate worse
            out |= {r.settings_id: r.wall_s for r in store.load(folder, check_series=False).records if r.wall_s > 0.0}
    return out


@dataclass
class Expectation:
    """The expected wall times [s] of runs on this machine, and of the preparations before the first.

    Times of runs are scaled by the pace so far: the time that the ended runs took over the time expected of them.
    """

    runs: Mapping[str, float]  # by ``settings_id``
    loading: float = 0.0
    once: float = 0.0  # to compile kernels and compute references that no cache holds
    jobs: int = 1  # at a time
    pages: float = 0.0  # [s] to judge the runs and write reports, by other commands; 0 where that is not announced
    spent: float = PRIOR  # [s] that runs took that have ended
    foreseen: float = PRIOR  # [s] that was expected of them

    @property
    def seconds(self) -> float:
        """Wall time from the call to the last result [s]."""
        return self.loading + self.once + schedule_end([], list(self.runs.values()), self.jobs)

    @property
    def words(self) -> str:
        """Text such as ``about 9 min 20 s, of it 1 min 5 s to compile kernels and compute references, this once``.

        With ``pages``, these count, and the text says so.
        """
        once = f", of it {format_duration(self.once)} to compile kernels and compute references, this once"
        pages = ", judging and reports included" if self.pages else ""
        return f"about {format_duration(self.seconds + self.pages)}{pages}{once * self.is_cold}"

    @property
    def words_after_count(self) -> str:
        """Words to be added to a number of runs, such as ``, 2 at a time: about 9 min``; empty if none is expected."""
        return f", {self.jobs} at a time: {self.words}" if self.runs else ""

    @property
    def is_cold(self) -> bool:
        """True if something has to be compiled or computed that later calls find in the caches."""
        return self.once >= QUICK

    def note_time(self, spec: RunSpec, seconds: float) -> None:
        """Add the wall time [s] of a run that has ended to the times by which the pace is estimated."""
        self.spent += seconds
        self.foreseen += self.runs.get(spec.settings_id, seconds)

    def estimate_run(self, spec: RunSpec) -> float:
        """Return the expected wall time [s] of a run at the pace so far; 0 if none was expected."""
        return self.runs.get(spec.settings_id, 0.0) * self.spent / self.foreseen

    def estimate_remaining(self, spec: RunSpec, since: float) -> float:
        """Return the time [s] that a run will still take, ``since`` [s] after its start.

        A run that has exceeded its expected time is assumed to take half as long again as it has taken so far.
        """
        left = self.estimate_run(spec) - since
        return left if left > 0.0 else since / 2.0

    def estimate_time_left(
        self, running: Iterable[tuple[RunSpec, float]], waiting: Iterable[RunSpec], jobs: int
    ) -> float:
        """Return the time [s] until all runs have ended, with ``jobs`` runs at a time.

        ``running`` pairs each run in progress with the time [s] since its start; ``waiting`` runs have not begun.
        """
        return schedule_end(
            [self.estimate_remaining(*run) for run in running], [self.estimate_run(spec) for spec in waiting], jobs
        )

    def compute_done_fraction(self, running: Sequence[tuple[RunSpec, float]], waiting: Iterable[RunSpec]) -> float:
        """Return the fraction of the work that is done, measured by the time of runs, not by their number.

        ``running`` pairs each run in progress with the time [s] since its start. Without any work it is 1.
        """
        done = self.spent - PRIOR + sum(since for _, since in running)
        left = sum(self.estimate_remaining(*run) for run in running) + sum(self.estimate_run(spec) for spec in waiting)
        return done / (done + left) if done + left > 0.0 else 1.0


def schedule_end(running: Sequence[float], waiting: Sequence[float], jobs: int) -> float:
    """Return the time [s] until the last run ends, if a waiting run starts whenever fewer than ``jobs`` run.

    ``running`` are the times [s] that the runs in progress will still take, ``waiting`` those of the others in order.
    """
    free = [0.0] * max(jobs - len(running), 0) + list(running)
    if not free:
        return 0.0
    heapq.heapify(free)
    for seconds in waiting:
        heapq.heappush(free, heapq.heappop(free) + seconds)
    return max(free)


COMPILING, REFERENCES = "compiling kernels", "computing references"
PREPARING = f"{REFERENCES} and {COMPILING}"


def describe_wait(doing: str, elapsed: float, usual: float = 0.0) -> str:
    """Describe a stage in words, such as ``compiling kernels: about 9 s left (...)``.

    The time left is that of the ``usual`` duration [s]; once that is over, the ``elapsed`` time [s] is given.
    """
    left = usual - elapsed
    if left > 0.0:
        return f"{doing}: about {format_duration(left)} left (this once, not counted in any run)"
    return f"{doing}: {format_duration(elapsed)} so far"


def describe_motion(name: str, t: float, t_end: float) -> str:
    """Describe how far a simulation has got: its time ``t`` of ``t_end`` [s]."""
    decimals = max(0, 3 - math.floor(math.log10(t_end)))  # a thousandth of the whole, in a width that does not change
    return f"{name}: {t:.{decimals}f} of {t_end:g} s simulated"


def format_duration(seconds: float) -> str:
    """Return a duration [s] as text, such as ``45 s``, ``3 min 20 s``, ``2 h 5 min``."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s" if whole < 600 else f"{round(whole / 60)} min"
    return f"{whole // 3600} h {whole % 3600 // 60} min"
