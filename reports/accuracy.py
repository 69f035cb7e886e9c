"""One number for how far a cell is from the exact motion, the same kind for all cells of a problem."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from reports.reading import Cell

EXACT = 1e-12  # of the mechanism's size: positions that everybody has to rounding compare nothing


@dataclass(frozen=True)
class Measure:
    """Which error, with its words and its unit."""

    what: str
    column: str
    unit: str
    own: float  # the reference's own error in that unit; NaN if not known

    def of(self, cell: Cell) -> float:
        """The error of a cell; NaN where it has none."""
        return float(getattr(cell.record, self.column))


def measure_for(cells: Sequence[Cell]) -> Measure | None:
    """Position error; orientation where all positions are exact (a body that only turns); None without a reference."""
    known = [c.record for c in cells if not math.isnan(c.record.position_error_max_m)]
    if not known:
        return None
    own = max((r.reference_own_error_m for r in known if not math.isnan(r.reference_own_error_m)), default=math.nan)
    length = max((r.length_scale_m for r in known if r.length_scale_m > 0.0), default=1.0)
    if max(r.position_error_max_m for r in known) > EXACT * length:
        return Measure("position error", "position_error_max_m", "m", own)
    return Measure("orientation error", "orientation_error_max_rad", "rad", own / length)


def drifts(cell: Cell) -> bool | None:
    """Whether the energy error wanders off rather than swings: its mean shifts from first to last quarter.

    True when the shift is over a third of the largest error (a straight line shifts by three quarters, a swing by
    nothing) and above rounding; None when it cannot be told.
    """
    r = cell.record
    shift = abs(r.energy_mean_last_quarter_J - r.energy_mean_first_quarter_J)
    if math.isnan(shift) or not math.isfinite(r.energy_drift_max_J):
        return None
    rounding = 1e-13 * (r.energy_scale_J if r.energy_scale_J > 0.0 else 1.0)
    return shift > max(r.energy_drift_max_J / 3.0, rounding)
