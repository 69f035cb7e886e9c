"""Measure how far a run is from the exact motion by one number, the same kind for all runs of a problem."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ...harness.columns.declared.errors import find_judged_reference_error
from ...harness.results.least_cost import choose_error
from ...harness.results.misleading import TO_THE_END
from ...harness.results.words import select_judged_error
from .results import StoredRun


@dataclass(frozen=True)
class ErrorMeasure:
    """The error by which runs are compared, with its words and its unit."""

    what: str  # in words
    name: str  # prefix of its columns
    unit: str
    own: float  # the reference's stated error in that unit; NaN if not known
    until: float | None = None  # [s] errors are judged up to here, if that is before the end

    def of(self, run: StoredRun) -> float:
        """Return the error of a run, in ``unit``, up to the time to which errors are judged; NaN if it has none."""
        return select_judged_error(run.record, self.name, self.unit)


def choose_measure(runs: Sequence[StoredRun]) -> ErrorMeasure | None:
    """Choose the error that judges a problem: the position error, or None without a reference.

    Where all positions are exact (a body that only turns), the orientation error is used.
    """
    known = [c for c in runs if not math.isnan(c.record.position_error_max_m)]
    if not known:
        return None
    length = max((c.record.length_scale_m for c in known if c.record.length_scale_m > 0.0), default=1.0)
    own = max((e for c in known if not math.isnan(e := c.record.reference_own_error_m)), default=math.nan)
    until = find_judged_end(known)
    words = "" if until is None else f" to {until:.4g} s"
    if until is not None:
        own = max((e for c in known if not math.isnan(e := find_judged_reference_error(c.record))), default=math.nan)
    name, unit = choose_error([c.record for c in known])
    return ErrorMeasure(f"{name.replace('_', ' ')}{words}", name, unit, own if unit == "m" else own / length, until)


def find_judged_end(runs: Sequence[StoredRun]) -> float | None:
    """Return the time up to which errors are judged [s]; None if it is the end of the reference or of the longest run.

    A time within 2 % of that end counts as the end.
    """
    times = [c.record.judged_to_s for c in runs if not math.isnan(c.record.judged_to_s)]
    ends = [min(c.record.t_reached_s, c.record.reference_horizon_s) for c in runs if c.record.reference]
    if not times or not ends or max(times) > TO_THE_END * max(ends):
        return None
    return max(times)


def is_drifting(run: StoredRun) -> bool | None:
    """Return whether the energy error drifts rather than oscillates; None if undecided.

    It drifts if its mean shifts from the first to the last quarter by more than a third of the largest error (a linear
    drift shifts by three quarters, an oscillation by nothing) and by more than rounding.
    """
    r = run.record
    shift = abs(r.energy_mean_last_quarter_J - r.energy_mean_first_quarter_J)
    if math.isnan(shift) or not math.isfinite(r.energy_drift_max_J):
        return None
    rounding = 1e-13 * (r.energy_scale_J if r.energy_scale_J > 0.0 else 1.0)
    return shift > max(r.energy_drift_max_J / 3.0, rounding)


def energy_kind(run: StoredRun) -> str:
    """Return "drifts" or "bounded" for the energy error of a run; an empty string if undecided."""
    return {None: "", True: "drifts", False: "bounded"}[is_drifting(run)]
