"""What runs beside the mechanism: energy error, |phi|, |phi_dot| and step size, least and largest per span of time."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ....harness.results.series import Series
from ...model.results import Run

SPANS = 1200  # a strip is about 500 pixels wide, and can be stretched


@dataclass(frozen=True)
class Strip:
    """A quantity of the series; ``signed``: it has a sign, ``both``: its smallest values matter too."""

    name: str
    symbol: str
    unit: str
    signed: bool = False
    both: bool = False


STRIPS = (
    Strip("energy_error", "E − E₀", "J", signed=True, both=True),
    Strip("phi_norm", "|φ|", "m"),
    Strip("phi_dot_norm", "|φ̇|", "m/s"),
    Strip("dt", "step", "s", both=True),
)


def strip(
    t: Float[np.ndarray, " nt"], a: Float[np.ndarray, " nt"], t_end: float, spans: int = SPANS
) -> Float[np.ndarray, "2 spans"]:
    """Smallest and largest value in each of ``spans`` equal spans of [0, t_end]; NaN in a span without a number."""
    low, high = np.full(spans, np.nan), np.full(spans, np.nan)
    good = np.isfinite(t) & np.isfinite(a)
    k = np.clip(np.asarray(t[good] / t_end * spans), 0, spans - 1).astype(int)
    np.fmin.at(low, k, a[good])
    np.fmax.at(high, k, a[good])
    return np.stack((low, high))


def strips_of(series: Series, run: Run, t_end: float, spans: int = SPANS) -> Float[np.ndarray, "n spans"]:
    """All strips of a run in the order of ``STRIPS``: smallest values, where they matter, and largest ones."""
    t, out = series["t"], []
    for kind in STRIPS:
        name = kind.name
        a = series[name] if name in series else np.full(len(t), np.nan)
        if name == "dt" and len(a) > 2 and not run.stopped:
            a = a[:-1]  # cut to end at t_end; of a failure it is the point
        low_high = strip(t[: len(a)], a, t_end, spans)
        out += list(low_high) if kind.both else [low_high[1]]
    return np.stack(out)
