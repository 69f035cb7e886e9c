"""Values that ``refuses`` and ``solve`` may return; a breach costs one run and names the author's file and line."""

import inspect
import math
import statistics
import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import CodeType
from typing import Any, NamedTuple

import numpy as np

from ..catalogue import registry
from ..catalogue.options import format_value
from ..types import Problem, Solver, Status, StepControl, Trajectory
from .presenting import PresentedSolver

CLOCK = 0.05  # [s] by which readings of clocks may differ
EXPLAINED = 0.5  # of the CPU time of a call without set-up, or of the first repeat
SHORT = 0.02  # [s] of integration, below which a single timing scatters by more than codes differ
GROUP = 1e-4  # [s] that are timed together at least: 100 times what the clock moves by (1 us)
FEWEST = 3  # groups: fewer have no quartiles


class Breach(TypeError):
    """Something that a solver may not return."""


def refusal(solver: Solver | PresentedSolver, problem: Problem, control: StepControl) -> str:
    """Why the solver cannot take the problem; empty if it can."""
    given = solver.refuses(problem, control)
    if given is not None and not isinstance(given, str):
        raise Breach(f"refuses must return a reason or None (got {format_value(given)}){_at(solver, 'refuses')}")
    return given or ""


def check_trajectory(found: object, solver: Solver | PresentedSolver, problem: Problem) -> Trajectory:
    """``found`` if it is a trajectory of the problem's bodies, of the types that it declares."""
    where = _at(solver, "solve")
    if not isinstance(found, Trajectory):
        raise Breach(f"solve must return a Trajectory (got {type(found).__name__}){where}")
    if found.states.nb != problem.system.nb:
        raise Breach(f"solve must return {problem.system.nb} bodies (got {found.states.nb}){where}")
    nt = len(found.t)
    series = {"reaction": found.reaction, **{f"diagnostics[{k!r}]": a for k, a in found.diagnostics.items()}}
    for name, a in series.items():
        wanted = (nt, problem.system.nrows) if name == "reaction" else (nt,)
        if a is not None and getattr(a, "shape", None) != wanted:
            raise Breach(f"{name} must have the shape {wanted} (got {getattr(a, 'shape', format_value(a))}){where}")
    for name, value, kind, words in (
        ("status", found.status, Status, "a Status"), ("message", found.message, str, "text"),
        ("counters", found.counters, Mapping, "a mapping of whole numbers"),
    ):  # fmt: skip
        if not isinstance(value, kind):
            raise Breach(f"{name} must be {words} (got {format_value(value)}){where}")
    for name, count in found.counters.items():
        if isinstance(count, bool) or not hasattr(count, "__index__") or not -(2**63) <= int(count) < 2**63:
            raise Breach(f"counters[{name!r}] must be a whole number of 64 bits (got {format_value(count)}){where}")
    if any(not isinstance(n, str) for n in found.notes) or any(not isinstance(e, Mapping) for e in found.events):
        raise Breach(f"notes must be texts and events mappings{where}")
    return found


class Cost(NamedTuple):
    """CPU time of a call [s]."""

    integration: float
    set_up: float  # the rest of the call
    code: float  # the part of set-up in which code was made

    @property
    def call(self) -> float:
        """Of all but code."""
        return self.integration + self.set_up - self.code


def split_cost(claimed: Trajectory, spent: float, code: float, wall: float, solver: Solver | PresentedSolver) -> Cost:
    """The cost of a call that took ``spent`` [s], of which the meter counts ``code`` as making code.

    Of a plugin all else counts as integration that it does not call set-up, which is shown beside it; what it calls
    set-up may hold the making of code, or not: the larger of the two is left out. Solvers of ``solvers/`` time their
    own integration; where that leaves most of the call unexplained, the call counts.
    """
    spent = max(spent, code)  # of a finer clock
    own, set_up = float(claimed.cpu_time), float(claimed.setup_time)
    known = 0.0 if math.isnan(set_up) else set_up
    if not (math.isnan(own) or 0.0 <= own <= spent + CLOCK) or not 0.0 <= known <= max(spent, wall) + CLOCK:
        said = f"cpu_time {own:.3g} s and setup_time {set_up:.3g} s"
        raise Breach(f"{said} do not fit the {spent:.3g} s of CPU time that the call took{_at(solver, 'solve')}")
    cost = max(spent - max(known, code), 0.0)
    if _is_ours(solver) and own >= EXPLAINED * cost - CLOCK:
        cost = min(own, spent - code)
    return Cost(cost, spent - cost, code)


def repeated_cost(times: Sequence[float]) -> Sequence[float]:
    """The repeats that count: the first alone where a later one took less than half as long, having been prepared."""
    return times if min(times) >= EXPLAINED * times[0] - CLOCK else times[:1]


def looped_cost(times: Sequence[float], solver: object, reading: float) -> Sequence[float]:
    """The costs [s] of a loop that count: means over groups of solves that take ``GROUP`` together.

    The first solve warms up and does not count: it touches memory and code that the others find in the caches. Where
    later ones of a plugin took less than half as long, nobody knows whether it was that or the answer was kept: the
    first alone counts. ``reading`` [s] is what a reading of the clock adds to each solve.
    """
    first, later = times[0], times[1:]
    middle = statistics.median(later)
    if middle < EXPLAINED * first and not _is_ours(solver):
        return [first]
    size = max(min(math.ceil(GROUP / max(middle, reading, 1e-9)), len(later) // FEWEST), 1)
    groups = np.reshape(later[len(later) % size :], (-1, size))
    return [max(float(mean) - reading, 0.0) for mean in np.mean(groups, axis=1)]


def cost_columns(times: Sequence[float], repeats: int) -> dict[str, Any]:
    """The columns of the costs [s] that count, of ``repeats`` solves. The quartiles of three are the outer two."""
    lower, middle, upper = (float(x) for x in np.quantile(times, [0.25, 0.5, 0.75], method="weibull"))
    return {"repeats": repeats, "cpu_min_s": min(times), "cpu_q1_s": lower, "cpu_median_s": middle,
            "cpu_q3_s": upper, "cpu_max_s": max(times)}  # fmt: skip


def _is_ours(solver: object) -> bool:
    made = solver.solver if isinstance(solver, PresentedSolver) else solver
    return registry.is_own_class(type(made))


def raised_at(error: BaseException, solver: object) -> str:
    """`` (mysolver.py:12)``: the last line of the solver's own file that the exception passed through."""
    own = _code(solver, "solve")
    frames = [f for f in traceback.extract_tb(error.__traceback__) if own and f.filename == own.co_filename]
    return f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""


def _at(solver: object, method: str) -> str:
    code = _code(solver, method)
    return f" ({Path(code.co_filename).name}:{code.co_firstlineno})" if code else ""


def _code(solver: object, method: str) -> CodeType | None:
    made = solver.solver if isinstance(solver, PresentedSolver) else solver
    return getattr(inspect.unwrap(getattr(type(made), method, None) or len), "__code__", None)
