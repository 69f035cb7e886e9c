"""How a run ended, and what can be concluded from one that was cut short.

A run that got to its end or failed by itself is final: where it ended is settled, and so is what no rest of it could
change. One that a clock, its memory or its budget of steps ended might have continued, and so might one whose joint had
come apart: we ended them, not their solver. One that did not get as far as one step of the size it may take has no
motion to judge. These settle only what they had settled.
"""

import json
import math
from functools import cache

import numpy as np

from ...catalogue import registry
from ...results.judgements.claims import Ending
from ...results.provisional import is_provisional
from ...results.records import RunRecord
from ...results.series import Series
from ...types import EndedBy, Status
from .measures import END, MEASURES, reached_end
from .register import Test
from .steps import START_UP

LAST = 0.1  # of the steps taken: the pace of a run is that of these
STUCK = 0.01  # of the step asked for: a pace below it would need more than a hundred times the steps
HOPELESS = 10  # budgets of steps that the rest of the time would take at that pace: fewer, and the run is only slow


def classify_ending(record: RunRecord, series: Series | None = None) -> Ending:
    """How one run ended; the series is needed where ``by_budget``."""
    if by_machine(record):
        return Ending.MACHINE
    if by_budget(record):
        return Ending.FINAL if series is None or is_stuck(record, pace(record, series)) else Ending.SLOW
    if by_open_joint(record):
        return Ending.APART
    return Ending.FINAL if has_started(record) else Ending.NO_START


def has_started(record: RunRecord) -> bool:
    """Whether a run got as far as one step of the size it may take: before, its start is what failed."""
    if reached_end(record) or record.status == Status.REFUSED:
        return True
    return record.steps > 0 and not record.t_reached_s < largest_step(record)


def stops_in_start_up(record: RunRecord) -> bool:
    """Whether a run stopped in the first hundredth of its time, where claims on the time of a stop do not look."""
    return not reached_end(record) and not record.t_reached_s > START_UP * record.t_end_s


def by_open_joint(record: RunRecord) -> bool:
    """Whether the guard that the solvers with error control share ended it: joints open by the length of their arms.

    It calls such a run diverged, or singular where the rows were nearly dependent. Solvers of fixed steps have no such
    guard: what is no longer finite there is their own doing.
    """
    stopped = record.status in (Status.DIVERGED, Status.SINGULAR) and not reached_end(record)
    if not stopped or record.control == "dt" or math.isnan(record.phi_end):
        return False
    return bool(record.phi_end > _longest_arm(record.problem, record.problem_parameters))


@cache
def _longest_arm(problem: str, parameters: str) -> float:
    """The largest component of a joint's arm [m]; infinite where there is no arm."""
    system = registry.make_problem(problem, json.loads(parameters)).system
    longest = max(float(np.max(np.abs(a), initial=0.0)) for a in (system.joint_s_i, system.joint_s_j))
    return longest or math.inf


def by_budget(record: RunRecord) -> bool:
    """Whether the limit on accepted steps ended the run, the same on every machine."""
    return record.status == Status.STALLED and 0 < record.max_steps <= record.steps


def by_machine(record: RunRecord) -> bool:
    """Whether a clock or the memory ended it: stalled with steps left means a clock."""
    stopped = record.status in (Status.UNFINISHED, Status.STALLED) and not by_budget(record)
    unmeasured = record.ended_by == EndedBy.MEASURE_LIMIT
    return stopped or unmeasured or record.status == Status.MEMORY or is_provisional(record)


def pace(record: RunRecord, series: Series) -> float:
    """Time a step over the last tenth of those taken [s]; rows of thinned series stand for equal parts."""
    t = series["t"]
    k = math.floor((1.0 - LAST) * (len(t) - 1))
    return float(t[-1] - t[k]) / (record.steps * (1.0 - k / (len(t) - 1))) if len(t) > 1 else 0.0


def is_stuck(record: RunRecord, pace: float) -> bool:
    """Whether a run at this pace [s a step] has shrunk its steps a hundredfold and is far from its end."""
    rest = record.t_end_s - record.t_reached_s
    return pace < STUCK * largest_step(record) and rest > HOPELESS * record.max_steps * pace


def largest_step(record: RunRecord) -> float:
    """The step that the run may take: its limit or its dt, else the largest it took [s]."""
    return next((s for s in (record.max_step_s, record.dt_s) if not math.isnan(s)), record.step_max_s)


def is_settled(test: Test, record: RunRecord, how: Ending, value: float) -> bool:
    """Whether a run that ended so settles a test of its own number: running on would not change the finding."""
    if in_time(test, record, how):
        return True
    m = MEASURES[test.metric]
    if how is Ending.NO_START:
        return False
    if m.until == "known" and math.isfinite(value):
        return True
    if not m.grows or "_max" not in test.arguments.get("name", "_max"):
        return False
    least = min(value, record.t_reached_s) if m.until == "known" else value  # what has not come yet comes later
    return least > test.band.high or (least >= test.band.low and math.isinf(test.band.high))


def ends_early(test: Test, record: RunRecord, value: float) -> bool:
    """Whether a run that stopped leaves the test open: the rest of it, which there is not, might change its number.

    Its end itself is no early one: a measure ``of_end`` asks for just that.
    """
    if MEASURES[test.metric].of_end or gets_to(test, record):
        return False
    return math.isnan(value) or not is_settled(test, record, Ending.EARLY, value)


def gets_to(test: Test, record: RunRecord) -> bool:
    """Whether the run got to the moment that the test asks about, or to its end where it asks about the whole."""
    until = test.arguments.get("to", test.arguments.get("at", math.inf))
    moment = record.t_end_s if MEASURES[test.metric].until == "end" else min(until, record.t_end_s)
    return bool(record.t_reached_s >= moment * (1.0 - END))  # False for NaN


def in_time(test: Test, record: RunRecord, how: Ending) -> bool:
    """Whether the run is final, or got through the stretch of time that the test looks at."""
    if how is Ending.FINAL:
        return True
    until = test.arguments.get("to", test.arguments.get("at", math.inf))
    return MEASURES[test.metric].until == "to" and record.t_reached_s >= until * (1.0 - END)
