"""Check what ``refuses`` and ``solve`` return, and derive the cost of a solve from CPU times.

A breach fails one run, and its message names the line of the solver's author.
"""

import inspect
import math
import statistics
import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import CodeType
from typing import Any, NamedTuple

import numpy as np

from ..base.hints import format_value
from ..catalogue import registry
from ..mechanics.types import Problem, Solver, Status, StepControl, Trajectory
from .presenting import PresentedSolver

CLOCK = 0.05  # [s] by which two clocks may differ
# fraction of a call that a stated time must explain; a repeat below it of the first has skipped work
EXPLAINED = 0.5
SHORT = 0.02  # [s] of integration below which a single timing scatters by more than codes differ
GROUP = 1e-4  # [s] that a group of solves takes at least: 100 times the resolution of the clock (1 us)
FEWEST = 3  # groups at least: fewer have no quartiles


class Breach(TypeError):
    """Signal a value that a solver may not return."""


def find_refusal(solver: Solver | PresentedSolver, problem: Problem, control: StepControl) -> str:
    """Return the reason why the solver refuses the problem; empty if it does not; raise Breach for a wrong answer."""
    given = solver.refuses(problem, control)
    if given is not None and not isinstance(given, str):
        raise Breach(
            f"refuses must return a reason or None (got {format_value(given)}){_locate_method(solver, 'refuses')}"
        )
    return given or ""


def check_trajectory(found: object, solver: Solver | PresentedSolver, problem: Problem) -> Trajectory:
    """Return ``found``, what ``solve`` returned, if it is a valid trajectory of the problem; else raise Breach.

    Checked are the number of bodies, the shapes of reactions and diagnostics, and the types of all other fields.
    """
    where = _locate_method(solver, "solve")
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
        ("status", found.status, Status, "a Status"),
        ("message", found.message, str, "text"),
        ("counters", found.counters, Mapping, "a mapping of whole numbers"),
    ):
        if not isinstance(value, kind):
            raise Breach(f"{name} must be {words} (got {format_value(value)}){where}")
    for name, count in found.counters.items():
        if isinstance(count, bool) or not hasattr(count, "__index__") or not -(2**63) <= int(count) < 2**63:
            raise Breach(f"counters[{name!r}] must be a whole number of 64 bits (got {format_value(count)}){where}")
    if any(not isinstance(n, str) for n in found.notes) or any(not isinstance(e, Mapping) for e in found.events):
        raise Breach(f"notes must be texts and events mappings{where}")
    return found


class Cost(NamedTuple):
    """Hold the CPU time of one call [s], split into integration and set-up."""

    integration: float
    set_up: float  # CPU time of the call outside integration
    code: float  # the part of set-up in which code was generated

    @property
    def call(self) -> float:
        """CPU time of all but code generation."""
        return self.integration + self.set_up - self.code


def split_cost(claimed: Trajectory, spent: float, code: float, wall: float, solver: Solver | PresentedSolver) -> Cost:
    """Return the cost of a call that took ``spent`` [s] of CPU time and ``wall`` [s] of wall time.

    ``code`` [s] of the CPU time was code generation, and ``claimed`` states the solver's own times. The integration of
    a plugin is ``spent`` less the larger of ``code`` and the set-up time it states, which may include code generation.
    Solvers of ``solvers/`` time their own integration, which counts unless it leaves more than half of the call
    unexplained. Raise Breach if a stated time exceeds the measured one.
    """
    spent = max(spent, code)  # ``code`` is measured by a finer clock
    own, set_up = float(claimed.cpu_time), float(claimed.setup_time)
    known = 0.0 if math.isnan(set_up) else set_up
    if not (math.isnan(own) or 0.0 <= own <= spent + CLOCK) or not 0.0 <= known <= max(spent, wall) + CLOCK:
        said = f"cpu_time {own:.3g} s and setup_time {set_up:.3g} s"
        raise Breach(
            f"{said} do not fit the {spent:.3g} s of CPU time that the call took{_locate_method(solver, 'solve')}"
        )
    cost = max(spent - max(known, code), 0.0)
    if _is_ours(solver) and own >= EXPLAINED * cost - CLOCK:
        cost = min(own, spent - code)
    return Cost(cost, spent - cost, code)


def select_repeat_times(times: Sequence[float]) -> Sequence[float]:
    """Return the CPU times [s] of repeats that count: all, or the first alone if any took less than half as long.

    In that case the first seems to have stored what the others need.
    """
    return times if min(times) >= EXPLAINED * times[0] - CLOCK else times[:1]


def average_loop_times(times: Sequence[float], solver: object, reading: float) -> Sequence[float]:
    """Return the costs [s] of a solve from the ``times`` [s] of a loop of solves: means over groups of them.

    A group takes at least ``GROUP`` together. The first solve does not count, since it brings memory and code into the
    caches. If the median of a plugin's later solves is less than half of it, this cannot be distinguished from a stored
    answer, and only the first counts. ``reading`` [s] is the time that a reading of the clock adds to each solve; it is
    subtracted from the means.
    """
    first, later = times[0], times[1:]
    middle = statistics.median(later)
    if middle < EXPLAINED * first and not _is_ours(solver):
        return [first]
    size = max(min(math.ceil(GROUP / max(middle, reading, 1e-9)), len(later) // FEWEST), 1)
    groups = np.reshape(later[len(later) % size :], (-1, size))
    return [max(float(mean) - reading, 0.0) for mean in np.mean(groups, axis=1)]


def make_cost_columns(times: Sequence[float], repeats: int) -> dict[str, Any]:
    """Return a record's columns of costs: ``repeats``, and minimum, quartiles, median and maximum of ``times`` [s].

    ``times`` are the CPU times that count. Quartiles are Weibull's: those of three times are the outer two.
    """
    lower, middle, upper = (float(x) for x in np.quantile(times, [0.25, 0.5, 0.75], method="weibull"))
    return {
        "repeats": repeats,
        "cpu_min_s": min(times),
        "cpu_q1_s": lower,
        "cpu_median_s": middle,
        "cpu_q3_s": upper,
        "cpu_max_s": max(times),
    }


def _is_ours(solver: object) -> bool:
    """Return whether the solver, which may be wrapped in a presentation, is one of ``solvers/``."""
    made = solver.solver if isinstance(solver, PresentedSolver) else solver
    return registry.is_own_class(type(made))


def locate_error(error: BaseException, solver: object) -> str:
    """Return the last line in the file of the solver's ``solve`` that an exception passed: `` (mysolver.py:12)``.

    Empty if it passed none.
    """
    own = _find_code(solver, "solve")
    frames = [f for f in traceback.extract_tb(error.__traceback__) if own and f.filename == own.co_filename]
    return f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""


def _locate_method(solver: object, method: str) -> str:
    """Return where a method of the solver begins, such as `` (mysolver.py:12)``; empty if it is not in Python."""
    code = _find_code(solver, method)
    return f" ({Path(code.co_filename).name}:{code.co_firstlineno})" if code else ""


def _find_code(solver: object, method: str) -> CodeType | None:
    """Return the code object of a solver's method as its author wrote it, without wrappers; None if not in Python."""
    made = solver.solver if isinstance(solver, PresentedSolver) else solver
    return getattr(inspect.unwrap(getattr(type(made), method, None) or len), "__code__", None)
