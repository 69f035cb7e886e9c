"""Two or more solvers on one problem, one after the other and again, in one process: times to be compared.

CPU time of the integration alone, in turns (A B A B), so that a machine that slows down slows all. One run before the
clock starts compiles and warms; one after it records what an engine that is timed without output does not show.
"""

import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ..metrics.measure import measure
from ..metrics.summary import columns
from ..types import Problem, Status, Trajectory

MEASURED = ("energy_drift_max_J", "energy_drift_end_J", "phi_dot_max", "position_error_judged_m", "judged_to_s")


@dataclass(frozen=True)
class Runner:
    """A solver or engine: ``warm`` a short run, ``timed`` the one that counts, ``shown`` the one that is measured."""

    name: str
    warm: Callable[[], Trajectory]
    timed: Callable[[], Trajectory]
    shown: Callable[[], Trajectory] | None  # None: the first timed one


@dataclass(frozen=True)
class Result:
    """What came of one of them; NaN where it has nothing to show."""

    name: str
    status: str
    message: str
    notes: str
    cpu_s: tuple[float, ...]
    energy_drift_max_J: float  # this and the next are ``MEASURED``, in its order
    energy_drift_end_J: float
    phi_dot_max: float
    position_error_m: float  # up to ``judged_to_s``
    judged_to_s: float

    @property
    def median_s(self) -> float:
        """Of the CPU times."""
        return statistics.median(self.cpu_s) if self.cpu_s else math.nan


def race(problem: Problem, runners: Sequence[Runner], repeats: int, budget: float) -> list[Result]:
    """All of them in turns; one whose next run would pass ``budget`` [s] of CPU in all is not repeated."""
    times: dict[str, list[float]] = {r.name: [] for r in runners}
    shown: dict[str, Trajectory] = {}
    for r in runners:
        r.warm()
    for _ in range(repeats):
        for r in runners:
            spent = times[r.name]
            failed = r.name in shown and shown[r.name].status is not Status.SUCCESS
            if failed or (spent and sum(spent) + spent[-1] > budget):
                continue
            trajectory = r.timed()
            shown.setdefault(r.name, trajectory)
            spent.append(trajectory.cpu_time)
    for r in runners:
        if r.shown is not None and shown[r.name].status is Status.SUCCESS:
            shown[r.name] = r.shown()
    return [_result(problem, r.name, shown[r.name], times[r.name]) for r in runners]


def _result(problem: Problem, name: str, trajectory: Trajectory, times: Sequence[float]) -> Result:
    numbers: dict[str, float] = {}
    if len(trajectory.t) > 1:
        numbers = columns(problem, trajectory, measure(problem, trajectory))
    found = [numbers.get(k, math.nan) for k in MEASURED]
    return Result(name, str(trajectory.status), trajectory.message, "; ".join(trajectory.notes), tuple(times), *found)
