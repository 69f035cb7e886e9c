"""Read the curves of one run by name; its series is read once and dropped."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...harness.columns.declaring import find_series_name
from ...harness.results.records import DECLARED
from ...harness.results.series import Series
from .curves import SPANS_UPPER, Curve, find_band, find_extrema, find_maxima
from .results import StoredRun

# series of columns that declare a figure, and those of which there is a plot anyway
DECLARED_NORMS = tuple(find_series_name(name, d) for name, d in DECLARED.items() if d.figure)
NORMS = (
    "energy_error",
    "phi_norm",
    "phi_dot_norm",
    "position_error",
    "orientation_error",
    "out_of_plane",
    *DECLARED_NORMS,
)


@dataclass(frozen=True)
class MotionCurves:
    """A run and its curves with at least one point, by name.

    Norms, invariants (``inv_``) and distances of observables from the reference (``away_``) are largest magnitudes,
    observables (``obs_``) and references (``ref_``) are signed, and ``dt`` is a band.
    """

    run: StoredRun
    bodies: int = 0
    curves: Mapping[str, Curve] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)  # by full name, as in the series file
    events: tuple[Mapping[str, Any], ...] = ()  # events that the solver reported

    @property
    def has_steps(self) -> bool:
        """True if there is at least one step to draw."""
        return any(name in self.curves for name in NORMS)


def read_curves(run: StoredRun, series: Series | None, spans: int = SPANS_UPPER) -> MotionCurves:
    """Return the curves of a run, reduced to ``spans`` spans of time, with units and events; none without a series."""
    if series is None or "t" not in series or len(series["t"]) == 0:
        return MotionCurves(run)
    # a run that stopped gets all spans up to its stop
    t, t_end = series["t"], 0.0 if run.has_stopped else run.record.t_end_s
    norms = {n: series.points(n) for n in (*NORMS, "reference_own_error") if n in series}
    norms |= {f"inv_{n}": series.points(f"inv_{n}") for n in series.names("inv_")}
    observables, exact = series.names("obs_"), series.names("ref_")
    norms |= {f"away_{n}": _compute_difference(series, n) for n in observables if n in exact}
    signed = {n: series.points(n) for n in (*(f"obs_{n}" for n in observables), *(f"ref_{n}" for n in exact))}
    curves = {n: find_maxima(*points, t_end, spans) for n, points in norms.items()}
    curves |= {n: find_extrema(*points, t_end, 3 * spans // 4) for n, points in signed.items()}
    if "dt" in series:
        curves["dt"] = _find_step_band(t, series["dt"], run.has_stopped, t_end, spans)
    drawable = {n: c for n, c in curves.items() if len(c)}
    return MotionCurves(run, count_bodies(series), drawable, series.units, series.events)


def count_bodies(series: Series) -> int:
    """Return the number of bodies that a series file names or stores an end pose of; 0 if it does neither."""
    return len(series.body_names) or (len(series["end_r"]) if "end_r" in series else 0)


def _compute_difference(series: Series, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the times [s] and the difference of observable ``name`` from its reference, as stored or else computed."""
    if f"away_{name}" in series:
        return series.points(f"away_{name}")
    return series["t"], series[f"obs_{name}"] - series[f"ref_{name}"]


def _find_step_band(t: np.ndarray, dt: np.ndarray, stopped: bool, t_end: float, spans: int) -> Curve:
    """Return the band of step sizes [s] without the last step, which may be cut to end at ``t_end``.

    If the run ``stopped``, its last step is a point of its own. A run of two steps or fewer keeps all.
    """
    if len(dt) < 3:
        return find_band(t, dt, t_end, spans)
    whole = find_band(t[:-1], dt[:-1], t_end, spans)
    if not stopped or whole.low is None or whole.high is None:
        return whole
    last = [np.append(e, dt[-1]) for e in (whole.y, whole.low, whole.high)]  # the last step of a failure is of interest
    return Curve(np.append(whole.t, t[-1]), *last)
