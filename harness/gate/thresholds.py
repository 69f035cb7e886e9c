"""Thresholds of the gate: bounds on the measured quantities of a run, each with its reason; their file: ``baseline``.

A run is expected to end with status "success", unless an ``Expectation`` says otherwise.
"""

import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

from msgspec import Meta
from msgspec.structs import replace

from ..catalogue.options import nearest
from ..results.records import COLUMNS, RunRecord
from ..shapes import Finite, Shape, Text
from ..types import Status

UNITS = {
    "energy_drift_max_J": "J", "energy_scale_J": "J", "phi_max": "m", "phi_dot_max": "m/s",
    "position_error_max_m": "m", "orientation_error_max_rad": "rad", "reaction_error_max_N": "N",
}  # fmt: skip
ERRORS = tuple(name for name in UNITS if name != "energy_scale_J")  # which are better if smaller
ENDS = re.compile(r"_(m_per_s|rad_per_s|MB|rad|J|W|N|m|s)$")  # of a column's name: its unit
METRICS = tuple(c.name for c in COLUMNS if c.type in (float, int))


@dataclass(frozen=True)
class Width:
    """How far above its value a bound lies, and why there."""

    factor: float
    reason: str


FIXED_STEP = Width(1.2, "fixed step: only rounding may move it; twice the step gives about 4 times the value")
ERROR_CONTROL = Width(
    2.5,
    "error control: another libm may change which steps are accepted; 10 times the tolerance gives about 10 times it",
)
LEFT_OVER = Width(
    5.0, "left over by Newton's stop test: one correction more or less changes it; a looser tolerance by far more"
)
ROUNDING = Width(10.0, "rounding only, which differs between machines; anything above is a real error")
SAME_PROBLEM = "the problem's numbers, the same on every machine but for rounding: another one is another problem"
FINGERPRINT = "problem_fingerprint"
IDENTITY = 1e-9  # of the fingerprint: a number that changes by 1e-4 of itself changes it by more
SAME_STEPS = "a fixed step that is never cut: the number of steps is t_end / dt on every machine"
STOP_TEST = 1e-6  # of the size: below it, a fixed-step solver's |phi_dot| is what its Newton iteration leaves over


class Bound(Shape, frozen=True, kw_only=True):
    """Bounds on one quantity and their reason."""

    value: Finite = math.nan  # measured when the bounds were set
    upper: Finite = math.inf
    lower: Finite = -math.inf
    reason: Text
    expect: Literal["pass", "fail"] = "pass"  # "fail": a known breach; when it passes, that is news (XPASS)
    tolerance: Annotated[float, Meta(ge=0.0, lt=1.0, description="a number from 0 to 1")] | None = None
    samples: Annotated[int, Meta(ge=1, description="a whole number from 1")] = 1  # runs that the bounds lie around

    def __post_init__(self) -> None:
        bounded = self.upper < math.inf or self.lower > -math.inf
        if self.tolerance is not None and (bounded or math.isnan(self.value)):
            raise ValueError("tolerance is relative to value (0: exactly that), without upper and lower")
        if self.tolerance is None and not bounded:
            raise ValueError("give upper or lower; without a bound nothing is checked")
        if self.lower > self.upper:
            raise ValueError("lower is above upper: nothing could pass")

    def holds(self, measured: float) -> bool:
        """Within the bounds; a measurement that does not exist is not."""
        if self.tolerance is not None:
            return abs(measured - self.value) <= self.tolerance * abs(self.value)
        return self.lower <= measured <= self.upper


class Threshold(Bound, frozen=True, kw_only=True):
    """Bounds on one metric of one case."""

    case: Text
    metric: Text

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.metric not in METRICS:
            raise ValueError(f"unknown metric {self.metric!r}{nearest(self.metric, list(METRICS))}")

    @property
    def unit(self) -> str:
        """The unit of its column, as the end of its name says."""
        ending = ENDS.search(self.metric)
        return UNITS.get(self.metric) or (ending[1].replace("_per_", "/") if ending else "")


class Expectation(Shape, frozen=True):
    """The status a case is expected to end with, where that is not success."""

    case: Text
    status: Status
    reason: Text


class Spread(Shape, frozen=True):
    """How far rounding alone was measured to move the runs: the reason why bounds of fixed steps are as narrow."""

    samples: Annotated[int, Meta(ge=2, description="a whole number from 2")]  # runs of each case, the unchanged one too
    kinds: tuple[Text, ...]  # of rounding, each by itself
    fixed_step: Annotated[float, Meta(ge=1.0, description="a number from 1")]  # largest over least value, the most
    case: str = ""  # where that is, and of what; numbers that are nothing but rounding do not count


class Thresholds(Shape, frozen=True):
    """All of a suite."""

    suite: str
    bounds: tuple[Threshold, ...] = ()
    statuses: tuple[Expectation, ...] = ()
    spread: Spread | None = None

    def __post_init__(self) -> None:
        declared = Counter([*((b.case, b.metric) for b in self.bounds), *((e.case, "status") for e in self.statuses)])
        for key, times in declared.items():
            if times > 1:
                raise ValueError(f"{' '.join(key)} is declared twice")


def propose_bounds(records: Sequence[RunRecord]) -> list[Threshold]:
    """Bounds for energy, constraints, errors, fixed steps and the problem itself, of every lawful run."""
    return [bound for r in records if Status(r.status).lawful for bound in _of(r)]


def four_digits(x: float) -> float:
    """``x`` as it is stored."""
    return float(f"{x:.4g}")


def bound_by_rule(case: str, metric: str, value: float, width: Width) -> Threshold:
    """From ``value`` divided by the width to ``value`` times it; LEFT_OVER has no lower bound."""
    lower = -math.inf if width is LEFT_OVER else four_digits(value / width.factor)
    upper = four_digits(value * width.factor)
    return Threshold(case=case, metric=metric, value=value, upper=upper, lower=lower, reason=width.reason)


def same_steps(case: str, steps: float) -> Threshold:
    """The number of fixed steps, exactly."""
    return Threshold(case=case, metric="steps", value=steps, reason=SAME_STEPS, tolerance=0.0)


def same_problem(case: str, value: float) -> Threshold:
    """The fingerprint of the problem's numbers, but for rounding."""
    return Threshold(case=case, metric=FINGERPRINT, value=value, tolerance=IDENTITY, reason=SAME_PROBLEM)


def _of(r: RunRecord) -> list[Threshold]:
    out = []
    for metric, unit in UNITS.items():
        value = four_digits(float(getattr(r, metric)))
        if not math.isfinite(value):
            continue
        size = {"J": r.energy_scale_J, "rad": 1.0, "N": r.reaction_size_N}.get(unit, r.length_scale_m)
        # 50 units in the last place, adding up at random
        rounding = 1e-14 * math.sqrt(max(r.steps, 1)) * max(size, 1.0)
        width = ROUNDING if value <= rounding else _width(r, metric, value, size)
        bound = bound_by_rule(r.case, metric, max(value, rounding), width)
        lower = bound.lower if value > ROUNDING.factor * rounding else -math.inf  # above it, no error is news too
        out.append(replace(bound, value=value, lower=lower))
    if math.isfinite(r.problem_fingerprint):
        out.append(same_problem(r.case, r.problem_fingerprint))
    if r.control == "dt" and r.rejected == 0.0:
        out.append(same_steps(r.case, float(r.steps)))
    return out


def _width(r: RunRecord, metric: str, value: float, size: float) -> Width:
    if r.control != "dt":
        return ERROR_CONTROL
    return LEFT_OVER if metric == "phi_dot_max" and value < STOP_TEST * max(size, 1.0) else FIXED_STEP
