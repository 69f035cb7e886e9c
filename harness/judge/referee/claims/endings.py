"""Classify how a run ended, and what can be concluded from one that was cut short.

A run that reached its end or failed by itself is final. A run that a clock, its memory or its budget of steps ended
might have continued, and so might one whose joint had come apart: the harness ended them, not their solver. A run that
stopped before one step of its allowed size has no motion to judge. Such runs decide only those tests whose outcome was
certain when they ended.
"""

import json
import math
from functools import cache

import numpy as np

from ....catalogue import registry
from ....mechanics.types import EndCause, Status
from ....results.judgements.claims import Ending
from ....results.provisional import is_provisional
from ....results.records import RunRecord
from ....results.series import Series
from .measures import END, MEASURES, reached_end
from .register import Test
from .steps import START_UP

LAST = 0.1  # fraction of the steps, at the end, that define a run's pace
STUCK = 0.01  # fraction of the requested step: a pace below it needs more than a hundred times the steps
HOPELESS = 10  # least number of step budgets for the remaining time; with fewer the run is only slow


def classify_ending(record: RunRecord, series: Series | None = None) -> Ending:
    """Return how one run ended, as far as claims depend on it; the series is needed if ``ended_by_budget``."""
    if ended_by_machine(record):
        return Ending.MACHINE
    if ended_by_budget(record):
        return Ending.FINAL if series is None or is_stuck(record, measure_pace(record, series)) else Ending.SLOW
    if ended_by_open_joint(record):
        return Ending.APART
    return Ending.FINAL if has_started(record) else Ending.NO_START


def has_started(record: RunRecord) -> bool:
    """Return whether a run took one step of its allowed size, reached its end, or was refused.

    Else its start failed.
    """
    if reached_end(record) or record.status == Status.REFUSED:
        return True
    return record.steps > 0 and not record.t_reached_s < largest_step(record)


def stops_in_start_up(record: RunRecord) -> bool:
    """Return whether a run stopped in the first hundredth of its time, which claims on stops exclude."""
    return not reached_end(record) and not record.t_reached_s > START_UP * record.t_end_s


def ended_by_open_joint(record: RunRecord) -> bool:
    """Return whether the guard of solvers with error control ended the run, because a joint opened by its arm's length.

    The guard calls such a run diverged, or singular if the rows were nearly dependent. Solvers with fixed steps have no
    guard: values that are no longer finite are their own result.
    """
    stopped = record.status in (Status.DIVERGED, Status.SINGULAR) and not reached_end(record)
    if not stopped or record.control == "dt" or math.isnan(record.phi_end):
        return False
    return bool(record.phi_end > _longest_arm(record.problem, record.problem_parameters))


@cache
def _longest_arm(problem: str, parameters: str) -> float:
    """Return the largest component of a joint's arm [m]; infinite without an arm."""
    system = registry.make_problem(problem, json.loads(parameters)).system
    longest = max(float(np.max(np.abs(a), initial=0.0)) for a in (system.joint_s_i, system.joint_s_j))
    return longest or math.inf


def ended_by_budget(record: RunRecord) -> bool:
    """Return whether the limit on accepted steps, equal on every machine, ended the run."""
    return record.status == Status.STALLED and 0 < record.max_steps <= record.steps


def ended_by_machine(record: RunRecord) -> bool:
    """Return whether a clock or the memory ended the run: stalled with steps left means a clock."""
    stopped = record.status in (Status.UNFINISHED, Status.STALLED) and not ended_by_budget(record)
    unmeasured = record.ended_by == EndCause.MEASURE_LIMIT
    return stopped or unmeasured or record.status == Status.MEMORY or is_provisional(record)


def measure_pace(record: RunRecord, series: Series) -> float:
    """Return the simulated time per step over the last tenth of the steps [s]; rows of thinned series count equally."""
    t = series["t"]
    k = math.floor((1.0 - LAST) * (len(t) - 1))
    return float(t[-1] - t[k]) / (record.steps * (1.0 - k / (len(t) - 1))) if len(t) > 1 else 0.0


def is_stuck(record: RunRecord, pace: float) -> bool:
    """Return whether a run has shrunk its steps a hundredfold and is far from its end, at ``pace`` [s] a step."""
    rest = record.t_end_s - record.t_reached_s
    return pace < STUCK * largest_step(record) and rest > HOPELESS * record.max_steps * pace


def largest_step(record: RunRecord) -> float:
    """Return the step that the run may take: its limit or its dt, else the largest it took [s]."""
    return next((s for s in (record.max_step_s, record.dt_s) if not math.isnan(s)), record.step_max_s)


def is_settled(test: Test, record: RunRecord, how: Ending, value: float) -> bool:
    """Return whether a run that ended as ``how`` settles a test: continuing it could not change whether the test holds.

    ``value`` is the number that the test measures on the run.
    """
    if covers_interval(test, record, how):
        return True
    m = MEASURES[test.metric]
    if how is Ending.NO_START:
        return False
    if m.until == "known" and math.isfinite(value):
        return True
    if not m.grows or "_max" not in test.arguments.get("name", "_max"):
        return False
    least = min(value, record.t_reached_s) if m.until == "known" else value  # events that have not happened come later
    return least > test.band.high or (least >= test.band.low and math.isinf(test.band.high))


def ends_early(test: Test, record: RunRecord, value: float) -> bool:
    """Return whether an early stop leaves the test open, because the missing rest might change its number ``value``.

    Measures ``of_end`` concern the end itself and are decided by it.
    """
    if MEASURES[test.metric].of_end or reaches_time(test, record):
        return False
    return math.isnan(value) or not is_settled(test, record, Ending.EARLY, value)


def reaches_time(test: Test, record: RunRecord) -> bool:
    """Return whether the run reached the time of the test, or its end if the test concerns the whole run."""
    until = test.arguments.get("to", test.arguments.get("at", math.inf))
    moment = record.t_end_s if MEASURES[test.metric].until == "end" else min(until, record.t_end_s)
    return bool(record.t_reached_s >= moment * (1.0 - END))  # False for NaN


def covers_interval(test: Test, record: RunRecord, how: Ending) -> bool:
    """Return whether a run that ended as ``how`` is final, or completed the interval of time of the test."""
    if how is Ending.FINAL:
        return True
    until = test.arguments.get("to", test.arguments.get("at", math.inf))
    return MEASURES[test.metric].until == "to" and record.t_reached_s >= until * (1.0 - END)
