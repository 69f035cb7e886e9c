"""Thresholds of the gate: a committed TOML file, one entry a case and metric, each with its reason.

::

    schema = 1
    suite = "ci"
    [[threshold]]
    case = "heavy_top gc_weak_form dt=0.001"
    metric = "energy_drift_max_J"       # any numeric column of a record
    value = 2.0e-3                      # measured when the threshold was set
    upper = 2.2e-3                      # breached above; or lower = ..., breached below; or both
    unit = "J"
    reason = "deterministic, second order: doubling dt gives 4 times the value"
    expect = "pass"                     # "fail": a known breach; when it passes, that is news (XPASS)
    direction = "smaller"               # is better; said by the bounds: upper, or lower for "larger", or both
    samples = 21                        # the bounds lie around as many runs (gate --spread): one does not move them

What is the same on every machine is compared exactly: ``direction = "equal"`` with ``value`` and no bounds (steps of
a fixed size). What may differ between machines only by rounding gets ``tolerance``, relative to ``value``, as well.

A run is expected to end with status "success", unless an entry without metric says otherwise:
``case``, ``status``, ``reason``.
"""

import json
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, field

from ..catalogue.options import nearest
from ..files import FileError, parse_toml, read_text
from ..results.environment import ROOT
from ..results.records import COLUMNS, RunRecord
from ..shapes import Finite, Shape, Text, shaped
from ..types import Status

UNITS = {
    "energy_drift_max_J": "J", "energy_scale_J": "J", "phi_max": "m", "phi_dot_max": "m/s",
    "position_error_max_m": "m", "orientation_error_max_rad": "rad", "reaction_error_max_N": "N",
}  # fmt: skip
ENDS = {
    "_m_per_s": "m/s",
    "_rad_per_s": "rad/s",
    "_sqrtJ": "sqrt(J)",
    "_MB": "MB",
    "_rad": "rad",
    "_J": "J",
    "_W": "W",
    "_N": "N",
    "_m": "m",
    "_s": "s",
}  # fmt: skip  of a column's name, the longer first
FOLDER = ROOT / "results" / "baselines"
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
IDENTITY = 1e-9  # of the fingerprint: a number that changes by 1e-4 of itself changes it by more
SAME_STEPS = "a fixed step that is never cut: the number of steps is t_end / dt on every machine"
OUTWARDS = {"upper": ROUND_CEILING, "lower": ROUND_FLOOR}  # of a bound: the value it was made for stays within
STOP_TEST = 1e-6  # of the size: below it, a fixed-step solver's |phi_dot| is what its Newton iteration leaves over


def unit_of(metric: str) -> str:
    """Of a column, as the end of its name says."""
    return UNITS.get(metric) or next((unit for end, unit in ENDS.items() if metric.endswith(end)), "")


class Threshold(Shape, frozen=True, kw_only=True):
    """Bounds on one metric of one case."""

    case: Text
    metric: Text
    value: Finite = math.nan
    upper: Finite = math.inf
    lower: Finite = -math.inf
    unit: str = ""
    reason: Text
    expect: Literal["pass", "fail"] = "pass"
    direction: Literal["smaller", "larger", "between", "equal"] | None = None
    tolerance: Annotated[float, Meta(ge=0.0, lt=1.0, description="a number from 0 to 1")] = 0.0
    samples: Annotated[int, Meta(ge=1, description="a whole number from 1")] = 1

    def __post_init__(self) -> None:
        high, low = self.upper < math.inf, self.lower > -math.inf
        if self.metric not in METRICS:
            raise ValueError(f"unknown metric {self.metric!r}{nearest(self.metric, list(METRICS))}")
        if self.unit not in ("", known := unit_of(self.metric)):
            raise ValueError(f"the unit of {self.metric} is {known or 'none'} (got {self.unit!r})")
        if self.is_equal:
            if high or low or math.isnan(self.value):
                raise ValueError("direction equal takes value, and tolerance from 0 to 1, and no bounds")
            return
        if not (high or low):
            raise ValueError("give upper or lower; without a bound nothing is checked")
        fitting = "between" if high and low else "smaller" if high else "larger"
        if self.direction not in (None, fitting) or self.tolerance:
            raise ValueError(
                f"direction must fit the bounds: smaller with upper, larger with lower, between with both, equal "
                f"(and tolerance) with value alone (got {self.direction!r})"
            )
        if self.lower > self.upper:
            raise ValueError("lower is above upper: nothing could pass")

    @property
    def is_equal(self) -> bool:
        """Whether only ``value`` itself passes, or what is within ``tolerance`` of it."""
        return self.direction == "equal"

    def holds(self, measured: float) -> bool:
        """Within the bounds; a measurement that does not exist is not."""
        if self.is_equal:
            return abs(measured - self.value) <= self.tolerance * abs(self.value)
        return self.lower <= measured <= self.upper


class Expectation(Shape, frozen=True):
    """The status a case is expected to end with, where that is not success."""

    case: Text
    status: Status
    reason: Text


class Thresholds(Shape, frozen=True):
    """All of a suite."""

    suite: str
    bounds: tuple[Threshold, ...] = field(name="threshold", default=())
    statuses: tuple[Expectation, ...] = field(name="status", default=())
    schema: Literal[1] = 1

    def __post_init__(self) -> None:
        declared = Counter([*((b.case, b.metric) for b in self.bounds), *((e.case, "status") for e in self.statuses)])
        for key, times in declared.items():
            if times > 1:
                raise ValueError(f"{' '.join(key)} is declared twice")


def read_thresholds(path: Path) -> Thresholds:
    """The file, every entry checked."""
    return parse_thresholds(read_text(path, "thresholds"), path)


def parse_thresholds(text: str, path: Path) -> Thresholds:
    """The text of a thresholds file; ``path`` names it in messages."""
    plain = parse_toml(text, str(path))
    if "schema" not in plain:
        raise FileError(f"{path}: schema = 1 is missing")
    return shaped(plain, Thresholds, str(path))


def write_thresholds(thresholds: Thresholds) -> str:
    """The text of a thresholds file; bounds are rounded outwards to four digits, what must be equal is not."""
    out = ["schema = 1", f"suite = {_toml(thresholds.suite)}"]
    for entry in (*thresholds.statuses, *thresholds.bounds):
        out += ["", "[[status]]" if isinstance(entry, Expectation) else "[[threshold]]"]
        exact = isinstance(entry, Threshold) and entry.is_equal
        for f in msgspec.structs.fields(entry):
            value = getattr(entry, f.name)
            if value != f.default and value == value:
                out.append(f"{f.name} = {_toml(value, exact=exact, towards=OUTWARDS.get(f.name))}")
    return "\n".join(out) + "\n"


def _toml(value: Any, *, exact: bool = False, towards: str | None = None) -> str:
    """A number, or a basic string: as in JSON, but without pairs of surrogates, and with DEL escaped."""
    if isinstance(value, float):
        digits = Context(prec=4, rounding=towards).create_decimal(repr(value))
        return repr(value) if exact else f"{float(digits):.4g}"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def proposed(records: Sequence[RunRecord]) -> list[Threshold]:
    """Bounds for energy, constraints, errors, fixed steps and the problem itself, of every lawful run."""
    return [bound for r in records if Status(r.status).lawful for bound in _of(r)]


def _of(r: RunRecord) -> list[Threshold]:
    out = []
    for metric, unit in UNITS.items():
        value = float(getattr(r, metric))
        if not math.isfinite(value):
            continue
        size = {"J": r.energy_scale_J, "rad": 1.0, "N": r.reaction_size_N}.get(unit, r.length_scale_m)
        # 50 units in the last place, adding up at random
        rounding = 1e-14 * math.sqrt(max(r.steps, 1)) * max(size, 1.0)
        width = ROUNDING if value <= rounding else _width(r, metric, value, size)
        upper = width.factor * max(value, rounding)
        sure = width in (FIXED_STEP, ERROR_CONTROL) and value > ROUNDING.factor * rounding
        lower = value / width.factor if sure else -math.inf  # an error that goes away is news too
        bounds = {"value": value, "upper": upper, "lower": lower, "unit": unit, "reason": width.reason}
        out.append(Threshold(case=r.case, metric=metric, **bounds))  # type: ignore[arg-type]
    if math.isfinite(r.problem_fingerprint):
        same = {"value": r.problem_fingerprint, "direction": "equal", "tolerance": IDENTITY, "reason": SAME_PROBLEM}
        out.append(Threshold(case=r.case, metric="problem_fingerprint", **same))  # type: ignore[arg-type]
    if r.control == "dt" and r.rejected == 0.0:
        fixed = Threshold(case=r.case, metric="steps", value=float(r.steps), reason=SAME_STEPS, direction="equal")
        out.append(fixed)
    return out


def _width(r: RunRecord, metric: str, value: float, size: float) -> Width:
    if r.control != "dt":
        return ERROR_CONTROL
    return LEFT_OVER if metric == "phi_dot_max" and value < STOP_TEST * max(size, 1.0) else FIXED_STEP
