"""How long a suite will still take: from what its runs took so far, and in earlier results folders."""

import contextlib
import heapq
import statistics
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from ..places import Place
from ..results import store
from ..suites.spec import RunSpec

RUNS = 3  # earlier results folders that are read


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
    """Learns from runs as they end; a guess for each that has not."""

    def __init__(self, earlier: Mapping[str, float]) -> None:
        self.earlier = earlier
        self.ratios: list[float] = []  # of what runs took now to what they took earlier: another machine, another load
        self.by_solver: dict[tuple[str, str], list[float]] = {}
        self.all: list[float] = []

    def learn(self, spec: RunSpec, seconds: float) -> None:
        """A run has ended."""
        if spec.settings_id in self.earlier:
            self.ratios.append(seconds / max(self.earlier[spec.settings_id], 1e-3))
        self.by_solver.setdefault((spec.problem, spec.solver), []).append(seconds)
        self.all.append(seconds)

    def guess(self, spec: RunSpec) -> float | None:
        """[s], or None where nothing is known yet."""
        earlier = self.earlier.get(spec.settings_id)
        if earlier is not None:
            return min(earlier * (statistics.median(self.ratios) if self.ratios else 1.0), spec.cpu_limit)
        alike = self.by_solver.get((spec.problem, spec.solver)) or self.all
        return min(statistics.fmean(alike), spec.cpu_limit) if alike else None

    def estimate_left(
        self, running: Iterable[tuple[RunSpec, float]], waiting: Iterable[RunSpec], size: int
    ) -> float | None:
        """[s] until all is done with ``size`` runs at a time; ``running`` are runs and since when [s] they run."""
        begun = [(self.guess(c), since) for c, since in running]
        guesses = [self.guess(c) for c in waiting]
        if any(g is None for g, _ in begun) or any(g is None for g in guesses):
            return None
        return schedule_end([max((g or 0.0) - since, 0.0) for g, since in begun], [g or 0.0 for g in guesses], size)


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
USUALLY = {COMPILING: 25.0, REFERENCES: 10.0, PREPARING: 45.0}  # [s] the first time on an idle core; then none


def describe_wait(doing: str, elapsed: float) -> str:
    """Describe what is being done and how long it will still take; ``elapsed`` [s] have passed."""
    usual = USUALLY.get(doing)
    if usual is None:
        return f"{doing}: {in_words(elapsed)} so far"
    left = usual - elapsed
    when = f"about {in_words(left)} left" if left > 0.0 else f"{in_words(elapsed)} so far, longer than usual"
    return f"{doing}: {when} (the first time only, not counted in any run)"


def in_words(seconds: float) -> str:
    """``45 s``, ``3 min 20 s``, ``2 h 5 min``."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s" if whole < 600 else f"{round(whole / 60)} min"
    return f"{whole // 3600} h {whole % 3600 // 60} min"
