"""Anatomy of drift: a long run's energy error as an oscillation, a trend and a random walk, with intervals.

The motion's own period is found from its most regular observable; means over whole periods take the oscillation out,
and means over blocks of periods go to ``harness.referee.trend``. A verdict is a test of equivalence, not of
significance: a run is bounded when the 95 % interval of the trend, over the whole span, stays below a tenth of the
oscillation.
Integrals are of the straight lines through the kept steps: a thinned series keeps points of the curve, extremes among
them, so that a mean of points would be wrong and the integral is not.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from ...results import store
from ...results.records import RunRecord
from ...results.series import Series
from .trend import FEWEST, Drift, drift

PERIODS = 50  # fewer are no long run
BLOCKS = 40  # at most: their means must span several periods
BAND = 0.1  # of the range of an observable, about its middle: it must cross all of it to count as a crossing
MATTERS = 0.1  # of the oscillation: a trend that over the whole span adds less is none that matters
ROUNDING = 1e-12  # of the energy scale: changes over a whole run below that are rounding


@dataclass(frozen=True)
class Anatomy:
    """Parts of an energy error [J]."""

    periods: int
    span: float  # [s] of whole periods looked at
    oscillation: float  # [J] half the range within a period, median over periods
    drift: Drift


def anatomy(folder: Path, records: Iterable[RunRecord]) -> list[dict[str, Any]]:
    """One entry a long run, as in ``drift.json``; runs of fewer than ``PERIODS`` periods are left out."""
    out = []
    for r in sorted(records, key=lambda r: (r.problem, r.problem_parameters, r.solver, r.case)):
        if r.label != "long" and r.t_end_s < 100.0:
            continue
        series = store.series_of(folder, r)
        found = None if series is None else dissect(series)
        if found is None and r.label != "long":
            continue
        out.append(_entry(r, found))
    return out


def dissect(s: Series) -> Anatomy | None:
    """The parts of the energy error of one run; None if it is too short to tell."""
    t, e = s["t"], s["energy_error"]
    if not np.all(np.isfinite(e)):
        return None
    marks = period_marks(t, s.named("obs_"))
    if marks is None or len(marks) <= PERIODS:
        return None
    return split(t, e, marks)


def split(t: Float[np.ndarray, " nt"], e: Float[np.ndarray, " nt"], marks: Float[np.ndarray, " n+1"]) -> Anatomy:
    """Oscillation, trend and walk of ``e`` over the periods between ``marks`` [s]."""
    n = len(marks) - 1
    size = max(n // BLOCKS, 1)
    blocks = n // size
    if blocks < FEWEST:
        raise ValueError(f"at least {FEWEST} periods are needed (got {n})")
    marks = marks[n - blocks * size :]  # the odd ones at the start go
    total = _integral(t, e, marks[::size])
    means = np.diff(total) / np.diff(marks[::size])
    span = float(marks[-1] - marks[0])
    found = drift(means, span / blocks)
    level = e - found.trend * t
    at = np.searchsorted(t, marks)
    halves = [0.5 * np.ptp(level[a : b + 1]) for a, b in pairwise(at) if b > a]
    return Anatomy(blocks * size, span, float(np.median(halves)), found)


def period_marks(
    t: Float[np.ndarray, " nt"], observables: dict[str, Float[np.ndarray, " nt"]]
) -> Float[np.ndarray, " n"] | None:
    """Times at which the most regular observable rises through its middle; None if none comes round often."""
    best: tuple[float, np.ndarray] | None = None
    for _, a in sorted(observables.items()):
        if not np.all(np.isfinite(a)) or np.ptp(a) == 0.0:
            continue
        marks = _rises(t, a)
        if len(marks) <= PERIODS:
            continue
        gaps = np.diff(marks)
        uneven = float(np.std(gaps) / np.mean(gaps))
        if best is None or uneven < best[0]:
            best = uneven, marks
    return None if best is None or best[0] > 0.2 else best[1]


def _rises(t: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Rises through the middle of the range, each between a visit to the lower and to the upper edge of a band."""
    low, high = np.quantile(a, (0.02, 0.98))
    middle, half = 0.5 * (low + high), 0.5 * BAND * (high - low)
    side = np.where(a > middle + half, 1, np.where(a < middle - half, -1, 0))
    seen = np.flatnonzero(side)
    ups = np.flatnonzero((side[seen[:-1]] == -1) & (side[seen[1:]] == 1))
    marks = []
    for begin, end in zip(seen[ups], seen[ups + 1], strict=True):
        k = begin + int(np.argmax(a[begin : end + 1] >= middle))  # the first at or above the middle
        share = (middle - a[k - 1]) / (a[k] - a[k - 1])
        marks.append(t[k - 1] + share * (t[k] - t[k - 1]))
    return np.array(marks)


def _integral(t: np.ndarray, e: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Of the straight lines through (t, e), from the start to ``at``."""
    h = np.diff(t)
    whole = np.concatenate(([0.0], np.cumsum(0.5 * h * (e[1:] + e[:-1]))))
    k = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
    x = at - t[k]
    return whole[k] + x * e[k] + 0.5 * x**2 * (e[k + 1] - e[k]) / h[k]


def _entry(r: RunRecord, found: Anatomy | None) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "problem": r.problem,
        "variant": r.case.split(" ")[0],
        "solver": r.solver,
        "case": r.case,
        "run": r.settings_id,
    }
    if found is None or r.claimed != "success":
        names = (
            "oscillation_J",
            "trend_W",
            "trend_low_W",
            "trend_high_W",
            "walk_J_per_sqrt_s",
            "walk_low",
            "walk_high",
        )
        failed = r.claimed != "success"
        words = (
            f"it ended with {r.status} at {r.t_reached_s:.4g} s"
            if failed
            else f"no motion that comes round more than {PERIODS} times in it"
        )
        nothing = dict.fromkeys(names, math.nan)
        return {**entry, "periods": 0, "span_s": r.t_reached_s, **nothing,
                "verdict": "failed" if failed else "too short", "words": words}  # fmt: skip
    verdict, words = _told(r, found)
    d = found.drift
    return {
        **entry,
        "periods": found.periods,
        "span_s": found.span,
        "oscillation_J": found.oscillation,
        "trend_W": d.trend,
        "trend_low_W": d.trend_low,
        "trend_high_W": d.trend_high,
        "walk_J_per_sqrt_s": d.walk,
        "walk_low": d.walk_low,
        "walk_high": d.walk_high,
        "verdict": verdict,
        "words": words,
    }


def _told(r: RunRecord, a: Anatomy) -> tuple[str, str]:
    d = a.drift
    most = max(abs(d.trend_low), abs(d.trend_high))
    over = f"{a.periods} periods ({a.span:.4g} s)"
    matters = max(MATTERS * a.oscillation, ROUNDING * r.energy_scale_J) / a.span
    seen = d.trend_low > 0.0 or d.trend_high < 0.0
    wander = f"; it wanders by {d.walk:.1e} J/sqrt(s) ({d.walk_low:.1e} to {d.walk_high:.1e})" if d.walk > 0.0 else ""
    swing = f"swings by {a.oscillation:.2e} J"
    if most <= matters:
        detail = f"no trend: |trend| < {most:.1e} W at 95 %"
        if seen:
            detail = f"no trend that matters: {d.trend:.1e} W ({d.trend_low:.1e} to {d.trend_high:.1e})"
        return "bounded", f"{swing}; {detail}, that is at most {most * a.span:.1e} J over {over}{wander}"
    if seen:
        adds = f"{d.trend:.2e} W ({d.trend_low:.2e} to {d.trend_high:.2e}), {d.trend * a.span:.2e} J over {over}"
        return "trend", f"trend of {adds}; {swing}{wander}"
    if d.walk > 0.0:
        return "wanders", f"{swing}; no trend told from zero: |trend| < {most:.1e} W at 95 %, {over}{wander}"
    return "undecided", f"{swing}; no trend seen, but it may be as large as {most:.1e} W at 95 % over {over}"
