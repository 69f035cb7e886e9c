"""Where the axes of a panel end: all that was recorded, unless one line would hide the others."""

from collections.abc import Sequence

import numpy as np

from ...harness.results.records import RunRecord
from ..model.curves import Curve, log_limits
from ..plots.laws import value_limits
from .spec import Panel

NOTHING = 1e-9  # of the problem's size: displacements below it are rounding, and give no scale
CUT = 30.0  # of the energy that the problem has to exchange, or of its size: what is beyond is cut at the edge
START = 0.01  # of the window: first steps of error-controlled solvers are tiny and do not stretch the axis


def limits_of(panel: Panel, records: Sequence[RunRecord], units: set[str], drawn: Sequence[Curve],
              exact: Curve | None) -> tuple[float, float]:  # fmt: skip
    """Lowest and highest value shown."""
    size = _largest(records, "length_scale_m", 1.0)
    if not drawn:
        return (1e-3, 1.0) if panel.axis.log else (0.0, 1.0)
    if panel.of == ("dt",):
        return _step_limits(panel, drawn)
    if panel.axis.log:
        return log_limits(drawn, size)
    if is_rounding(records, units, drawn):
        return -1e-3 * size, 1e-3 * size
    reach = size if units == {"m"} else np.inf
    if panel.of == ("energy",):
        reach = _largest(records, "energy_scale_J", np.inf)
    return value_limits(drawn, exact, CUT * reach)


def is_rounding(records: Sequence[RunRecord], units: set[str], drawn: Sequence[Curve]) -> bool:
    """A length that stays zero but for rounding."""
    top = max(float(np.abs(c.y).max()) for c in drawn)
    return units == {"m"} and top < NOTHING * _largest(records, "length_scale_m", 1.0)


def _step_limits(panel: Panel, drawn: Sequence[Curve]) -> tuple[float, float]:
    """Every step but the first ones; the last of each line always, which of a failure is the point."""
    late = panel.window[0] + START * (panel.window[1] - panel.window[0])
    kept = np.concatenate([np.append(c.y[c.t > late], c.y[-1]) for c in drawn if len(c)])
    kept = kept[kept > 0.0]
    return (0.6 * float(kept.min()), 1.8 * float(kept.max())) if len(kept) else (1e-3, 1.0)


def _largest(records: Sequence[RunRecord], column: str, default: float) -> float:
    return max((v for r in records if (v := getattr(r, column)) > 0.0), default=default)
