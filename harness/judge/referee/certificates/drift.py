"""Split a long run's energy error into an oscillation, a trend and a random walk, with intervals.

The motion's own period is found from its most regular observable; means over whole periods remove the oscillation, and
means over blocks of periods are passed to module trend. A run is bounded if the 95 % interval of the trend, over the
whole span, stays below a tenth of the oscillation (``law.judge_trend``).

Integrals are of the straight lines through the kept steps: a thinned series keeps points of the curve, extremes among
them, so that a mean of points would be wrong and the integral is not.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ....results import store
from ....results.judgements.runs import Drift
from ....results.records import RunRecord
from ....results.series import MARKS, Series
from ...law import judge_trend
from ...metrics.periods import PERIODS, find_periods
from .trend import FEWEST, Trend, fit_trend

LONG = 100.0  # [s] of simulated time
READS = ("energy_error", MARKS)  # series that are judged
BLOCKS = 40  # most blocks: each must span several periods


@dataclass(frozen=True)
class Anatomy:
    """The parts of an energy error: oscillation, trend and random walk."""

    periods: int  # number of whole periods analysed
    span: float  # [s] span of the whole periods analysed
    oscillation: float  # [J] half the range within a period, median over periods
    trend: Trend  # slope [W] and random walk [J/sqrt(s)] of the means over periods


def analyse_drift(folder: Path, records: Iterable[RunRecord]) -> tuple[Drift, ...]:
    """Return the drift of the energy error of each long run among ``records``, from its series in ``folder``.

    A run with fewer than ``PERIODS`` periods is left out, or called too short if it has the label ``long``.
    """
    out = []
    for r in sorted(records, key=lambda r: (r.problem, r.problem_parameters, r.solver, r.case)):
        if not is_long(r.label, r.t_end_s):
            continue
        series = store.read_run_series(folder, r)
        found = None if series is None else split_energy_error(series)
        if found is not None or r.label == "long":
            out.append(_judge_run(r, found))
    return tuple(out)


def is_long(label: str, t_end: float) -> bool:
    """Return whether a run has its drift analysed: it has the label ``long``, or lasts ``LONG`` seconds or more."""
    return label == "long" or not t_end < LONG


def split_energy_error(s: Series) -> Anatomy | None:
    """Return the parts of the energy error of one run; None if it is not finite or spans too few periods.

    The ends of the periods are read from the series, or found in the observables.
    """
    t, e = s["t"], s["energy_error"]
    if not np.all(np.isfinite(e)):
        return None
    marks = s[MARKS] if MARKS in s else find_periods(t, s.select("obs_"))
    if len(marks) <= PERIODS:
        return None
    return split_error(t, e, marks)


def split_error(t: Float[np.ndarray, " nt"], e: Float[np.ndarray, " nt"], marks: Float[np.ndarray, " ends"]) -> Anatomy:
    """Return oscillation, trend and random walk of an error ``e`` [J] at times ``t`` [s].

    ``marks`` are the ends of the motion's periods [s], which are joined into at most ``2 * BLOCKS`` blocks of equal
    numbers of periods. Raise ValueError if there are fewer than ``FEWEST`` periods.
    """
    n = len(marks) - 1
    size = max(n // BLOCKS, 1)
    blocks = n // size
    if blocks < FEWEST:
        raise ValueError(f"at least {FEWEST} periods are needed (got {n})")
    marks = marks[n - blocks * size :]  # surplus periods at the start are dropped
    total = _integrate(t, e, marks[::size])
    means = np.diff(total) / np.diff(marks[::size])
    span = float(marks[-1] - marks[0])
    found = fit_trend(means, span / blocks)
    level = e - found.slope * t
    at = np.searchsorted(t, marks)
    halves = [0.5 * np.ptp(level[a : b + 1]) for a, b in pairwise(at) if b > a]
    return Anatomy(blocks * size, span, float(np.median(halves)), found)


def _integrate(t: np.ndarray, e: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return the integral of the straight lines through (t, e) from the first time to each time in ``at`` [J s]."""
    from scipy.integrate import cumulative_trapezoid  # here: it takes a third of a second to load

    whole = cumulative_trapezoid(e, t, initial=0)
    k = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
    return whole[k] + 0.5 * (at - t[k]) * (e[k] + np.interp(at, t, e))


def _judge_run(r: RunRecord, found: Anatomy | None) -> Drift:
    """Return the drift of a run; ``found`` are the parts of its energy error, None if the run is too short.

    A run that did not claim success has the verdict ``failed``.
    """
    head = (r.problem, r.case.split(" ")[0], r.solver, r.case, r.settings_id, r.status)
    if found is None or r.claimed != "success":
        return Drift(*head, "failed" if r.claimed != "success" else "too short", r.t_reached_s)
    t = found.trend
    return Drift(
        *head,
        verdict=judge_trend(t.low * found.span, t.high * found.span, t.walk, found.oscillation, r.energy_scale_J),
        span_s=found.span,
        periods=found.periods,
        oscillation_J=found.oscillation,
        trend_W=t.slope,
        trend_low_W=t.low,
        trend_high_W=t.high,
        walk_J_per_sqrt_s=t.walk,
        walk_low=t.walk_low,
        walk_high=t.walk_high,
    )
