"""Where the axes of a panel end: all that was recorded, unless one line would hide the others."""

from collections.abc import Sequence

import numpy as np

from ...harness.results.records import RunRecord
from ..model.curves import Curve, log_limits
from .spec import Panel

FAR = 3.0  # the exact motion's range, so many times: a line that leaves it by more is cut at the edge
NOTHING = 1e-9  # of the problem's size: displacements below it are rounding, and give no scale
CUT = 30.0  # of the energy that the problem has to exchange, or of its size: what is beyond is cut at the edge
START = 0.01  # of the window: first steps of error-controlled solvers are tiny and do not stretch the axis


def limits_of(
    panel: Panel, records: Sequence[RunRecord], units: set[str], drawn: Sequence[Curve], exact: Curve | None
) -> tuple[float, float]:
    """Lowest and highest value shown."""
    every = [c for c in (*drawn, exact) if c is not None and len(c)]
    if not every:
        return (1e-3, 1.0) if panel.log else (0.0, 1.0)
    if panel.of == ("dt",):
        return _step_limits(panel, drawn)
    size = _size(records)
    if panel.log:
        return log_limits(drawn, size)
    low, high = min(float(c.y.min()) for c in every), max(float(c.y.max()) for c in every)
    if is_rounding(panel, records, units, every):
        return -1e-3 * size, 1e-3 * size
    if exact is not None and len(exact) and (size := float(np.ptp(exact.y))) > 1e-9 * (high - low):
        low, high = max(low, float(exact.y.min()) - FAR * size), min(high, float(exact.y.max()) + FAR * size)
    elif exact is None:
        reach = CUT * _reach(panel, records, units)
        low, high = (max(low, float(drawn[0].y[0]) - reach), min(high, float(drawn[0].y[0]) + reach))
    margin = 0.07 * (high - low) or max(0.05 * abs(high), 1e-12)
    return low - margin, high + margin


def _step_limits(panel: Panel, drawn: Sequence[Curve]) -> tuple[float, float]:
    """Every step but the first ones; the last of each line always, which of a failure is the point."""
    late = panel.window[0] + START * (panel.window[1] - panel.window[0])
    kept = np.concatenate([np.append(c.y[c.t > late], c.y[-1]) for c in drawn if len(c)])
    kept = kept[kept > 0.0]
    return (0.6 * float(kept.min()), 1.8 * float(kept.max())) if len(kept) else (1e-3, 1.0)


def _reach(panel: Panel, records: Sequence[RunRecord], units: set[str]) -> float:
    """How far a linear panel without an exact line can sensibly go from its start, in its own unit."""
    if panel.of != ("energy",):
        return _size(records) if units == {"m"} else np.inf
    return max((r.energy_scale_J for r in records if r.energy_scale_J > 0.0), default=np.inf)


def _size(records: Sequence[RunRecord]) -> float:
    """[m] of the mechanism."""
    return max((r.length_scale_m for r in records if r.length_scale_m > 0.0), default=1.0)


def is_rounding(panel: Panel, records: Sequence[RunRecord], units: set[str], every: Sequence[Curve]) -> bool:
    """A length that stays zero but for rounding."""
    return units == {"m"} and max(float(np.abs(c.y).max()) for c in every) < NOTHING * _size(records)
