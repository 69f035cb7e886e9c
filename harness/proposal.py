"""Bounds proposed for new thresholds, each with the reason for its width."""

import math
from collections.abc import Sequence

from harness.records import RunRecord
from harness.thresholds import Threshold
from harness.types import Status

UNITS = {"energy_drift_max_J": "J", "phi_max": "m", "phi_dot_max": "m/s", "position_error_max_m": "m"}
FIXED_STEP = 1.2
ERROR_CONTROL = 2.5
# Drift and |phi| of an error-controlled run are the sum of thousands of local errors that share a sign only by chance;
# another compiler or libm moves accepted steps. Ten times the tolerance moves them by about ten.
REASONS = {
    FIXED_STEP: "fixed step, same arithmetic: only rounding may move it; twice the step gives about 4 times the value",
    ERROR_CONTROL: "error control: another libm may change which steps are accepted; "
    "10 times the tolerance gives about 10 times the value",
}
FLOORS = {"energy_drift_max_J": 1e-13, "phi_max": 1e-15, "phi_dot_max": 1e-14, "position_error_max_m": 1e-14}
ROUNDING = 10.0  # rounding is not reproducible between machines: its sum over the steps may grow by this factor
ROUNDING_REASON = "rounding only: other machines round differently; anything above is a real error"


def proposed(records: Sequence[RunRecord]) -> list[Threshold]:
    """Bounds for energy drift, |phi|, |phi_dot| and the error, of every cell that succeeded."""
    return [bound for r in records if r.status == Status.SUCCESS for bound in _of(r)]


def _of(r: RunRecord) -> list[Threshold]:
    out = []
    sizes = {
        "energy_drift_max_J": r.energy_scale_J, "phi_max": r.length_scale_m,
        "phi_dot_max": r.length_scale_m, "position_error_max_m": r.length_scale_m,
    }  # fmt: skip
    for metric, unit in UNITS.items():
        value = float(getattr(r, metric))
        if not math.isfinite(value):
            continue
        rounding = 1e-16 * math.sqrt(max(r.steps, 1)) * max(sizes[metric], 1.0) * 100.0
        if value <= rounding:
            upper, reason = max(ROUNDING * rounding, FLOORS[metric]), ROUNDING_REASON
        else:
            factor = FIXED_STEP if r.control == "dt" else ERROR_CONTROL
            upper, reason = factor * value, REASONS[factor]
        out.append(Threshold(r.case, metric, value, upper, -math.inf, unit, reason))
    return out
