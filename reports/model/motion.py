"""The curves of one run by name: its series, read once and dropped."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...harness.results.series import Series
from .curves import SPANS_UPPER, Curve, band, signed_curve, upper
from .results import Run

NORMS = ("energy_error", "phi_norm", "phi_dot_norm", "position_error", "orientation_error", "out_of_plane")


@dataclass(frozen=True)
class Motion:
    """A run and those of its curves that have a point, by name.

    Norms, invariants (``inv_``) and distances of observables from the reference (``away_``) are largest magnitudes,
    observables (``obs_``) and references (``ref_``) have their sign, ``dt`` is a band.
    """

    run: Run
    bodies: int = 0
    curves: Mapping[str, Curve] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)  # by full name, as in the series file
    events: tuple[Mapping[str, Any], ...] = ()  # what the solver reported on its way

    @property
    def has_steps(self) -> bool:
        """It has at least one step to draw."""
        return any(name in self.curves for name in NORMS)


def motion_of(run: Run, series: Series | None, spans: int = SPANS_UPPER) -> Motion:
    """The curves of a run over ``spans`` of time; without a series file there are none."""
    if series is None or "t" not in series or len(series["t"]) == 0:
        return Motion(run)
    t, t_end = series["t"], 0.0 if run.has_stopped else run.record.t_end_s  # who stopped is drawn up to there, as fine
    observables, exact = series.select("obs_"), series.select("ref_")
    norms = {n: series[n] for n in (*NORMS, "reference_own_error") if n in series}
    norms |= {f"inv_{n}": a for n, a in series.select("inv_").items()}
    norms |= {f"away_{n}": a - exact[n] for n, a in observables.items() if n in exact}
    signed = {f"obs_{n}": a for n, a in observables.items()} | {f"ref_{n}": a for n, a in exact.items()}
    curves = {n: upper(t, a, t_end, spans) for n, a in norms.items()}
    curves |= {n: signed_curve(t, a, t_end, 3 * spans // 4) for n, a in signed.items()}
    if "dt" in series:
        curves["dt"] = _steps(t, series["dt"], run.has_stopped, t_end, spans)
    there = {n: c for n, c in curves.items() if len(c)}
    return Motion(run, bodies_in(series), there, series.units, series.events)


def bodies_in(series: Series) -> int:
    """How many bodies the system has; 0 if the file does not say."""
    return len(series.body_names) or (len(series["end_r"]) if "end_r" in series else 0)


def _steps(t: np.ndarray, dt: np.ndarray, stopped: bool, t_end: float, spans: int) -> Curve:
    if len(dt) < 3:
        return band(t, dt, t_end, spans)
    whole = band(t[:-1], dt[:-1], t_end, spans)  # the last step may be cut to end at t_end
    if not stopped or whole.low is None or whole.high is None:
        return whole
    last = [np.append(e, dt[-1]) for e in (whole.y, whole.low, whole.high)]  # of a failure it is the point
    return Curve(np.append(whole.t, t[-1]), *last)
