"""The series of one run for figures, decimated, by name; read once and dropped."""

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
    """A run and its curves; ``norms`` are largest magnitudes, ``observables`` values with their sign."""

    run: Run
    bodies: int = 0
    norms: Mapping[str, Curve] = field(default_factory=dict)
    invariants: Mapping[str, Curve] = field(default_factory=dict)
    step: Curve | None = None
    own_error: Curve | None = None  # stated by the reference
    observables: Mapping[str, Curve] = field(default_factory=dict)
    exact: Mapping[str, Curve] = field(default_factory=dict)
    away: Mapping[str, Curve] = field(default_factory=dict)  # |observable - exact|
    units: Mapping[str, str] = field(default_factory=dict)  # by full name, as in the series file
    symbols: Mapping[str, str] = field(default_factory=dict)
    events: tuple[Mapping[str, Any], ...] = ()  # what the solver reported on its way

    @property
    def moved(self) -> bool:
        """It has at least one step to draw."""
        return any(len(c) > 0 for c in self.norms.values())


def motion_of(run: Run, series: Series | None, spans: int = SPANS_UPPER) -> Motion:
    """The curves of a run over ``spans`` of time; without a series file there are none."""
    if series is None or "t" not in series or len(series["t"]) == 0:
        return Motion(run)
    t, t_end = series["t"], 0.0 if run.stopped else run.record.t_end_s  # who stopped is drawn up to there, as fine
    observables, exact = series.named("obs_"), series.named("ref_")
    return Motion(
        run, bodies_in(series), {n: upper(t, series[n], t_end, spans) for n in NORMS if n in series},
        {n: upper(t, a, t_end, spans) for n, a in series.named("inv_").items()}, _steps(series, run, spans),
        upper(t, series["reference_own_error"], t_end, spans) if "reference_own_error" in series else None,
        {n: signed_curve(t, a, t_end, 3 * spans // 4) for n, a in observables.items()},
        {n: signed_curve(t, a, t_end, 3 * spans // 4) for n, a in exact.items() if np.any(np.isfinite(a))},
        {n: upper(t, a - exact[n], t_end, spans) for n, a in observables.items() if n in exact}, series.units,
        series.symbols, series.events,
    )  # fmt: skip


def bodies_in(series: Series) -> int:
    """How many bodies the system has; 0 if the file does not say."""
    return len(series.body_names) or (len(series["end_r"]) if "end_r" in series else 0)


def _steps(series: Series, run: Run, spans: int) -> Curve | None:
    if "dt" not in series:
        return None
    t, dt, t_end = series["t"], series["dt"], 0.0 if run.stopped else run.record.t_end_s
    if len(dt) < 3:
        return band(t, dt, t_end, spans)
    whole = band(t[:-1], dt[:-1], t_end, spans)  # the last step may be cut to end at t_end
    if not run.stopped or whole.low is None or whole.high is None:
        return whole
    last = [np.append(e, dt[-1]) for e in (whole.y, whole.low, whole.high)]  # of a failure it is the point
    return Curve(np.append(whole.t, t[-1]), *last)
