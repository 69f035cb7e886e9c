"""One number for how far a run is from the exact motion, the same kind for all runs of a problem."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ...harness.results.records import judged_own
from ...harness.results.words import judged_error
from .results import Run

EXACT = 1e-12  # of the mechanism's size: position errors below it are rounding


@dataclass(frozen=True)
class Measure:
    """Which error, with its words and its unit."""

    what: str
    name: str  # of the columns
    unit: str
    own: float  # the reference's stated error in that unit; NaN if not known
    until: float | None = None  # [s] errors are judged to here where that is before the end

    def of(self, run: Run) -> float:
        """The error of a run; NaN where it has none."""
        return judged_error(run.record, self.name, self.unit)


def measure_for(runs: Sequence[Run]) -> Measure | None:
    """Position error; orientation where all positions are exact (a body that only turns); None without a reference."""
    known = [c for c in runs if not math.isnan(c.record.position_error_max_m)]
    if not known:
        return None
    length = max((c.record.length_scale_m for c in known if c.record.length_scale_m > 0.0), default=1.0)
    own = max((e for c in known if not math.isnan(e := c.record.reference_own_error_m)), default=math.nan)
    until = judged_until(known)
    words = "" if until is None else f" to {until:.4g} s"
    if until is not None:
        own = max((e for c in known if not math.isnan(e := judged_own(c.record))), default=math.nan)
    position = Measure(f"position error{words}", "position_error", "m", own, until)
    if max(map(position.of, known)) > EXACT * length:
        return position
    return Measure(f"orientation error{words}", "orientation_error", "rad", own / length, until)


def judged_until(runs: Sequence[Run]) -> float | None:
    """[s] the time up to which errors are judged, if that is before the reference or the longest run ends."""
    times = [c.record.judged_to_s for c in runs if not math.isnan(c.record.judged_to_s)]
    ends = [min(c.record.t_reached_s, c.record.reference_horizon_s) for c in runs if c.record.reference]
    if not times or not ends or max(times) > 0.98 * max(ends):
        return None
    return max(times)


def drifts(run: Run) -> bool | None:
    """Whether the energy error wanders off rather than swings: its mean shifts from first to last quarter.

    True when the shift is over a third of the largest error (a straight line shifts by three quarters, a swing by
    nothing) and above rounding; None when it cannot be decided.
    """
    r = run.record
    shift = abs(r.energy_mean_last_quarter_J - r.energy_mean_first_quarter_J)
    if math.isnan(shift) or not math.isfinite(r.energy_drift_max_J):
        return None
    rounding = 1e-13 * (r.energy_scale_J if r.energy_scale_J > 0.0 else 1.0)
    return shift > max(r.energy_drift_max_J / 3.0, rounding)


def energy_kind(run: Run) -> str:
    """The same as a word; empty when it cannot be decided."""
    return {None: "", True: "drifts", False: "bounded"}[drifts(run)]
