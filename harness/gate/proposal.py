"""Bounds proposed for new thresholds, each with the reason for its width."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ..results.records import RunRecord
from ..types import Status
from .thresholds import Threshold

UNITS = {
    "energy_drift_max_J": "J", "phi_max": "m", "phi_dot_max": "m/s", "position_error_max_m": "m",
    "orientation_error_max_rad": "rad",
}  # fmt: skip


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
SAME_STEPS = "a fixed step that is never cut: the number of steps is t_end / dt on every machine"
STOP_TEST = 1e-6  # of the size: below it, a fixed-step solver's |phi_dot| is what its Newton iteration leaves over


def proposed(records: Sequence[RunRecord]) -> list[Threshold]:
    """Bounds for energy drift, |phi|, |phi_dot|, the errors and fixed steps, of every run that succeeded."""
    return [bound for r in records if r.status == Status.SUCCESS for bound in _of(r)]


def _of(r: RunRecord) -> list[Threshold]:
    out = []
    for metric, unit in UNITS.items():
        value = float(getattr(r, metric))
        if not math.isfinite(value):
            continue
        size = {"J": r.energy_scale_J, "rad": 1.0}.get(unit, r.length_scale_m)
        # 50 units in the last place, adding up at random
        rounding = 1e-14 * math.sqrt(max(r.steps, 1)) * max(size, 1.0)
        width = ROUNDING if value <= rounding else _width(r, metric, value, size)
        upper = width.factor * max(value, rounding)
        out.append(Threshold(case=r.case, metric=metric, value=value, upper=upper, unit=unit, reason=width.reason))
    if r.control == "dt" and r.rejected == 0.0:
        fixed = Threshold(case=r.case, metric="steps", value=float(r.steps), reason=SAME_STEPS, direction="equal")
        out.append(fixed)
    return out


def _width(r: RunRecord, metric: str, value: float, size: float) -> Width:
    if r.control != "dt":
        return ERROR_CONTROL
    return LEFT_OVER if metric == "phi_dot_max" and value < STOP_TEST * max(size, 1.0) else FIXED_STEP
