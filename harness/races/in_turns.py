"""Two or more solvers on one problem, one after the other and again, in one process: times to be compared.

CPU time of the integration alone, in turns (A B A B), so that a machine that slows down slows all. One short run of
each before the clock starts compiles and warms.
"""

import dataclasses
import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..metrics.measure import measure
from ..metrics.summary import columns
from ..types import Problem, Solver, Status, StepControl, Trajectory

MEASURED = ("energy_drift_max_J", "energy_drift_end_J", "phi_dot_max", "position_error_judged_m", "judged_to_s")
WARM_STEPS = 3


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


def race(
    problem: Problem, control: StepControl, solvers: Mapping[str, Solver], repeats: int, budget: float
) -> list[Result]:
    """All of them in turns; one whose next run would pass ``budget`` [s] of CPU in all is not repeated."""
    assert control.dt is not None  # solvers of fixed step
    times: dict[str, list[float]] = {name: [] for name in solvers}
    shown: dict[str, Trajectory] = {}
    short = dataclasses.replace(problem, t_end=min(problem.t_end, WARM_STEPS * control.dt))
    for solver in solvers.values():
        solver.solve(short, control)
    for _ in range(repeats):
        for name, solver in solvers.items():
            spent = times[name]
            failed = name in shown and shown[name].status is not Status.SUCCESS
            if failed or (spent and sum(spent) + spent[-1] > budget):
                continue
            trajectory = solver.solve(problem, control)
            shown.setdefault(name, trajectory)
            spent.append(trajectory.cpu_time)
    return [_result(problem, name, shown[name], times[name]) for name in solvers]


def _result(problem: Problem, name: str, trajectory: Trajectory, times: Sequence[float]) -> Result:
    numbers: dict[str, float] = {}
    if len(trajectory.t) > 1:
        numbers = columns(problem, trajectory, measure(problem, trajectory))
    found = [numbers.get(k, math.nan) for k in MEASURED]
    return Result(name, str(trajectory.status), trajectory.message, "; ".join(trajectory.notes), tuple(times), *found)
