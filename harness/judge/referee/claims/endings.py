"""Classify how a run ended, and what can be concluded from one that was cut short.

A run that reached its end or failed by itself is final. A run that a clock, its memory or its budget of steps ended
might have continued, and so might one whose joint had come apart: the harness ended them, not their solver. A run that
stopped before one step of its allowed size has no motion to judge. Such runs decide only those tests whose outcome was
certain when they ended.
"""

import math
from functools import cache

import numpy as np

from ....catalogue import registry
from ....mechanics.types import EndCause, Status
from ....results.judgements.claims import Ending
from ....results.provisional import is_provisional
from ....results.records import RunRecord, parse_settings
from ....results.series import Series
from .measures import END, reached_end
from .metrics import START_UP
from .register import Test

LAST = 0.1  # fraction of the steps, at the end, that define a run's pace
STUCK = 0.01  # fraction of the requested step: a pace below it needs more than a hundred times the steps
HOPELESS = 10  # least number of step budgets for the remaining time; with fewer the run is only slow


def classify_ending(record: RunRecord, series: Series | None = None) -> Ending:
    """Return how one run ended, as far as claims depend on it.

    The series is needed only for a run that its limit on steps ended, ``ended_by_budget``: it is final if its steps
    had become so small that it would not have reached its end. Without the series it counts as final.
    """
    if ended_by_machine(record):
        return Ending.MACHINE
    if ended_by_budget(record):
        # stuck: its steps have shrunk a hundredfold, and its end is far
        pace = 0.0 if series is None else measure_pace(record, series)
        rest = record.t_end_s - record.t_reached_s
        is_stuck = pace < STUCK * find_largest_step(record) and rest > HOPELESS * record.max_steps * pace
        return Ending.FINAL if series is None or is_stuck else Ending.SLOW
    if ended_by_open_joint(record):
        return Ending.APART
    # one that reached its end or was refused is final, and so is one that took a step of its allowed size
    started = record.steps > 0 and not record.t_reached_s < find_largest_step(record)
    return Ending.FINAL if reached_end(record) or record.status == Status.REFUSED or started else Ending.NO_START


def stops_in_start_up(record: RunRecord) -> bool:
    """Return whether a run stopped in the first hundredth of its time, which claims on stops exclude."""
    return not reached_end(record) and not record.t_reached_s > START_UP * record.t_end_s


def ended_by_open_joint(record: RunRecord) -> bool:
    """Return whether the guard against open joints ended the run: a joint had opened by more than the longest arm.

    Solvers with error control have this guard, which calls such a run diverged, or singular if the constraint rows were
    nearly dependent. Solvers with fixed steps have none: values that are no longer finite are their own result.
    """
    stopped = record.status in (Status.DIVERGED, Status.SINGULAR) and not reached_end(record)
    if not stopped or record.control == "dt" or math.isnan(record.phi_end):
        return False
    return bool(record.phi_end > _measure_longest_arm(record.problem, record.problem_parameters))


@cache
def _measure_longest_arm(problem: str, parameters: str) -> float:
    """Return the largest component of any joint's arm in a problem [m]; infinite if all are zero.

    ``parameters`` are those of the problem as in the record's column, JSON text.
    """
    system = registry.make_problem(problem, parse_settings(parameters)).system
    longest = max(float(np.max(np.abs(a), initial=0.0)) for a in (system.joint_s_i, system.joint_s_j))
    return longest or math.inf


def ended_by_budget(record: RunRecord) -> bool:
    """Return whether the limit on accepted steps, equal on every machine, ended the run."""
    return record.status == Status.STALLED and 0 < record.max_steps <= record.steps


def ended_by_machine(record: RunRecord) -> bool:
    """Return whether a limit of the machine, time or memory, ended the run or its measuring.

    A run that is ``stalled`` with steps left was ended by a clock.
    """
    stopped = record.status in (Status.UNFINISHED, Status.STALLED) and not ended_by_budget(record)
    unmeasured = record.ended_by == EndCause.MEASURE_LIMIT
    return stopped or unmeasured or record.status == Status.MEMORY or is_provisional(record)


def measure_pace(record: RunRecord, series: Series) -> float:
    """Return the simulated time per step over the last tenth of the steps [s]; 0 without a step.

    Rows of a thinned series are taken to stand for equal numbers of steps.
    """
    t = series["t"]
    k = math.floor((1.0 - LAST) * (len(t) - 1))
    return float(t[-1] - t[k]) / (record.steps * (1.0 - k / (len(t) - 1))) if len(t) > 1 else 0.0


def find_largest_step(record: RunRecord) -> float:
    """Return the step that the run may take: its limit or its dt, else the largest it took [s]."""
    return next((s for s in (record.max_step_s, record.dt_s) if not math.isnan(s)), record.step_max_s)


def is_final(test: Test, record: RunRecord, how: Ending) -> bool:
    """Return whether a run that ended as ``how`` settles a test: it is final, or completed the test's time interval."""
    if how is Ending.FINAL:
        return True
    return test.measure.until == "to" and record.t_reached_s >= _find_moment(test) * (1.0 - END)


def reaches_time(test: Test, record: RunRecord) -> bool:
    """Return whether the run reached the time of the test, or its end if the test concerns the whole run."""
    moment = math.inf if test.measure.until == "end" else _find_moment(test)
    return bool(record.t_reached_s >= min(moment, record.t_end_s) * (1.0 - END))  # False for NaN


def is_decided(test: Test, record: RunRecord, value: float) -> bool:
    """Return whether a continuation of a run could no longer change the outcome of the test.

    ``value`` is the number so far. The outcome is decided if such a number never changes once it exists, or if it can
    only grow and is beyond the band's upper end, or above the lower end of a band without upper end.
    """
    m = test.measure
    if m.until == "known" and math.isfinite(value):
        return True
    if not m.grows or "_max" not in test.arguments.get("name", "_max"):
        return False
    least = min(value, record.t_reached_s) if m.until == "known" else value  # events that have not happened come later
    return least > test.at_most or (least >= test.at_least and math.isinf(test.at_most))  # False for NaN


def _find_moment(test: Test) -> float:
    """Return the time at which the number of a test is known [s]; infinite if it concerns the whole run."""
    return float(test.arguments.get("to", test.arguments.get("at", math.inf)))
