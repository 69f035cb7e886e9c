"""Define thresholds of the gate: bounds on the measured quantities of a run, with reasons.

A run is expected to end with status "success", unless an ``ExpectedStatus`` says otherwise. Module ``baseline`` reads
and writes their file.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

from msgspec import Meta
from msgspec.structs import replace

from ...base.hints import suggest_name
from ...base.shapes import Finite, Shape, Text
from ...columns.declaring import find_unit
from ...mechanics.types import Status
from ...results.records import COLUMNS, DECLARED, RunRecord

BOUNDED = (  # metrics of every lawful run that get bounds
    "energy_drift_max_J",
    "energy_scale_J",
    "phi_max",
    "phi_dot_max",
    "position_error_max_m",
    "orientation_error_max_rad",
    "reaction_error_max_N",
)
ERRORS = tuple(name for name in BOUNDED if DECLARED[name].better == "less")
METRICS = tuple(c.name for c in COLUMNS if c.type in (float, int))


@dataclass(frozen=True)
class BoundWidth:
    """A factor between a value and its bounds, and the reason for it."""

    factor: float
    reason: str


FIXED_STEP = BoundWidth(1.2, "fixed step: only rounding may move it; twice the step gives about 4 times the value")
ERROR_CONTROL = BoundWidth(
    2.5,
    "error control: another libm may change which steps are accepted; 10 times the tolerance gives about 10 times it",
)
LEFT_OVER = BoundWidth(
    5.0, "left over by Newton's stop test: one correction more or less changes it; a looser tolerance by far more"
)
ROUNDING = BoundWidth(10.0, "rounding only, which differs between machines; anything above is a real error")
SAME_PROBLEM = "the problem's numbers, the same on every machine but for rounding: another one is another problem"
FINGERPRINT = "problem_fingerprint"
IDENTITY = 1e-9  # relative tolerance of the fingerprint: a change of a number by 1e-4 of itself exceeds it
SAME_STEPS = "a fixed step that is never cut: the number of steps is t_end / dt on every machine"
STOP_TEST = 1e-6  # fraction of the size: a fixed-step solver's smaller |phi_dot| is left over by its Newton iteration


class QuantityBound(Shape, frozen=True, kw_only=True):
    """The bounds on one quantity and their reason."""

    value: Finite = math.nan  # value measured when the bounds were set
    upper: Finite = math.inf
    lower: Finite = -math.inf
    reason: Text
    expect: Literal["pass", "fail"] = "pass"  # "fail": a known breach; passing is reported (XPASS)
    tolerance: Annotated[float, Meta(ge=0.0, lt=1.0, description="a number from 0 to 1")] | None = None
    # number of runs that the bounds enclose
    samples: Annotated[int, Meta(ge=1, description="a whole number from 1")] = 1

    def __post_init__(self) -> None:
        """Raise ValueError unless there is either a bound or a tolerance, and something can pass."""
        bounded = self.upper < math.inf or self.lower > -math.inf
        if self.tolerance is not None and (bounded or math.isnan(self.value)):
            raise ValueError("tolerance is relative to value (0: equal); give value, without upper and lower")
        if self.tolerance is None and not bounded:
            raise ValueError("give upper or lower; without a bound nothing is checked")
        if self.lower > self.upper:
            raise ValueError("lower is above upper: nothing could pass")

    def holds(self, measured: float) -> bool:
        """Return whether ``measured`` is within the bounds; False if it is NaN."""
        if self.tolerance is not None:
            return abs(measured - self.value) <= self.tolerance * abs(self.value)
        return self.lower <= measured <= self.upper


class Threshold(QuantityBound, frozen=True, kw_only=True):
    """The bounds on one metric of one case."""

    case: Text
    metric: Text

    def __post_init__(self) -> None:
        """Raise ValueError for invalid bounds or an unknown metric."""
        super().__post_init__()
        if self.metric not in METRICS:
            raise ValueError(f"unknown metric {self.metric!r}{suggest_name(self.metric, list(METRICS))}")

    @property
    def unit(self) -> str:
        """The unit of the metric, empty if it has none."""
        return find_unit(self.metric, DECLARED[self.metric])


class ExpectedStatus(Shape, frozen=True):
    """The status, other than success, that a case is expected to end with."""

    case: Text
    status: Status
    reason: Text


class Spread(Shape, frozen=True):
    """The measured effect of rounding on the runs, which justifies the narrow bounds at fixed steps."""

    # runs of each case, including the unchanged one
    samples: Annotated[int, Meta(ge=2, description="a whole number from 2")]
    kinds: tuple[Text, ...]  # kinds of rounding, applied one at a time
    # largest ratio, over all numbers at fixed steps, of the largest to the least value
    fixed_step: Annotated[float, Meta(ge=1.0, description="a number from 1")]
    case: str = ""  # case and metric of that number; numbers that are only rounding do not count


class Thresholds(Shape, frozen=True):
    """All thresholds of a suite, and the statuses that differ from success."""

    suite: str
    bounds: tuple[Threshold, ...] = ()
    statuses: tuple[ExpectedStatus, ...] = ()
    spread: Spread | None = None

    def __post_init__(self) -> None:
        """Raise ValueError if a metric or the status of a case is declared twice."""
        declared = Counter([*((b.case, b.metric) for b in self.bounds), *((e.case, "status") for e in self.statuses)])
        for key, times in declared.items():
            if times > 1:
                raise ValueError(f"{' '.join(key)} is declared twice")


def propose_bounds(records: Sequence[RunRecord]) -> list[Threshold]:
    """Return bounds around the numbers of every lawful run: energy, constraints, errors, fixed steps, fingerprint."""
    return [bound for r in records if Status(r.status).lawful for bound in _bound_record(r)]


def round_to_four_digits(x: float) -> float:
    """Round ``x`` to four significant digits, as stored."""
    return float(f"{x:.4g}")


def bound_by_rule(case: str, metric: str, value: float, width: BoundWidth) -> Threshold:
    """Return bounds from ``value`` divided by the width to ``value`` times it; with LEFT_OVER only the upper one."""
    lower = -math.inf if width is LEFT_OVER else round_to_four_digits(value / width.factor)
    upper = round_to_four_digits(value * width.factor)
    return Threshold(case=case, metric=metric, value=value, upper=upper, lower=lower, reason=width.reason)


def require_same_steps(case: str, steps: float) -> Threshold:
    """Return the threshold that fixes the number of steps exactly."""
    return Threshold(case=case, metric="steps", value=steps, reason=SAME_STEPS, tolerance=0.0)


def require_same_problem(case: str, value: float) -> Threshold:
    """Return the threshold that fixes the fingerprint of the problem's numbers up to rounding."""
    return Threshold(case=case, metric=FINGERPRINT, value=value, tolerance=IDENTITY, reason=SAME_PROBLEM)


def _bound_record(r: RunRecord) -> list[Threshold]:
    """Return bounds on all metrics that a record has, on the problem's fingerprint and, for fixed steps, their number.

    A value of the size of rounding gets only an upper bound, ten times that size.
    """
    out = []
    for metric in BOUNDED:
        unit = find_unit(metric, DECLARED[metric])
        value = round_to_four_digits(float(getattr(r, metric)))
        if not math.isfinite(value):
            continue
        size = {"J": r.energy_scale_J, "rad": 1.0, "N": r.reaction_size_N}.get(unit, r.length_scale_m)
        # 50 units in the last place per step, accumulating randomly
        rounding = 1e-14 * math.sqrt(max(r.steps, 1)) * max(size, 1.0)
        width = ROUNDING if value <= rounding else _choose_width(r, metric, value, size)
        bound = bound_by_rule(r.case, metric, max(value, rounding), width)
        # above rounding, a vanishing error is reported too
        lower = bound.lower if value > ROUNDING.factor * rounding else -math.inf
        out.append(replace(bound, value=value, lower=lower))
    if math.isfinite(r.problem_fingerprint):
        out.append(require_same_problem(r.case, r.problem_fingerprint))
    if r.control == "dt" and r.rejected == 0.0:
        out.append(require_same_steps(r.case, float(r.steps)))
    return out


def _choose_width(r: RunRecord, metric: str, value: float, size: float) -> BoundWidth:
    """Return the width of a bound: that of the step control, or ``LEFT_OVER`` for a |phi_dot| within the stop test.

    ``size`` is the scale of the metric, in its unit.
    """
    if r.control != "dt":
        return ERROR_CONTROL
    return LEFT_OVER if metric == "phi_dot_max" and value < STOP_TEST * max(size, 1.0) else FIXED_STEP
