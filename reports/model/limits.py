"""Limits of logarithmic axes that one motion which blew up, or one that is exact, must not take from the others."""

from collections.abc import Iterable

import numpy as np

from .curves import Curve

CAP = 1e4  # a motion that blew up is cut at so many times the problem's own scale, or others could not be seen
SELDOM = 0.05  # of a line may lie below the lower edge: all errors begin at zero
ROUNDING = 1e-17  # of that scale: what is below is drawn at the lower edge


def log_limits(curves: Iterable[Curve | None], scale: float) -> tuple[float, float]:
    """Limits for a logarithmic axis: from rounding (of ``scale``) at the lowest to a cap at the highest."""
    size = scale if np.isfinite(scale) and scale > 0.0 else 1.0
    values = [e for c in curves if c is not None for e in (c.y, c.low, c.high) if e is not None]
    seen = [v[v > size * ROUNDING] for v in values]
    seen = [v for v in seen if len(v)]
    if not seen:
        return size * ROUNDING, size * ROUNDING * 1e3
    top = min(max(float(np.max(v)) for v in seen), size * CAP)
    low = min(float(np.quantile(v, SELDOM)) for v in seen)
    return max(min(low, top) / 2.0, size * ROUNDING), top * 3.0
