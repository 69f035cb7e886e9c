"""Measure numbers of runs for claims: each a plain function, of which ``@measure`` makes a metric of that name.

What each depends on, and when a run has no such number, is said in module measures.
"""

import math
from itertools import pairwise
from typing import Any

import numpy as np

from ....results.records import RunRecord
from ....results.series import Series
from .measures import END, NAN, measure, measure_values, reached_end

COMPARED = ("position_error", "orientation_error")  # errors against a reference; NaN beyond its horizon
START_UP = 0.01  # fraction of t_end after which step sizes are judged


def cut_interval(
    record: RunRecord, s: Series, series: str, begin: float = 0.0, to: float = NAN, partial: bool = False
) -> np.ndarray | None:
    """Return the values of a series from ``begin`` to ``to`` [s], by default the requested end; None if there are none.

    A run that ends before ``to`` gives None or, with ``partial``, the values that exist. Errors are cut to where a
    reference exists.
    """
    a, t = s.get(series), s["t"]
    end = record.t_end_s if math.isnan(to) else to
    if a is None or (not partial and t[-1] < end * (1.0 - END)):
        return None
    inside = a[(t >= begin) & (t <= end * (1.0 + END))]
    if series in COMPARED:
        inside = inside[~np.isnan(inside)]
    return inside if len(inside) else None


def cut_steps(
    record: RunRecord, s: Series, begin: float = NAN, to: float = NAN, partial: bool = False
) -> np.ndarray | None:
    """Return the sizes [s] of the accepted steps between ``begin`` and ``to`` [s], without the run's last one.

    By default they begin after ``START_UP`` of the requested time and end with it. None if the run stopped before
    ``to``, unless ``partial``, or if there are fewer than three.
    """
    t, dt = s["t"][:-1], s["dt"][:-1]
    begin = START_UP * record.t_end_s if math.isnan(begin) else begin
    end = record.t_end_s if math.isnan(to) else to
    if not partial and s["t"][-1] < end * (1.0 - END):
        return None
    inside = dt[(t > begin) & (t <= end) & (dt > 0.0)]
    return inside if len(inside) > 2 else None


def guard_against_nan(a: np.ndarray, found: Any) -> float:
    """Return ``found``, a number that was computed from ``a``; infinite if a value of ``a`` is NaN.

    Thus a motion that became NaN never has a small error.
    """
    return math.inf if np.any(np.isnan(a)) else float(found)


# a series over an interval of time


@measure_values(cut_interval, grows=True)
def largest(a: np.ndarray) -> float:
    """Return max |a| over an interval; infinite if a value is NaN."""
    return guard_against_nan(a, np.max(np.abs(a)))


@measure_values(cut_interval, grows=True)
def highest(a: np.ndarray) -> float:
    """Return the signed maximum over an interval."""
    return guard_against_nan(a, np.max(a))


@measure_values(cut_interval)
def lowest(a: np.ndarray) -> float:
    """Return the signed minimum over an interval."""
    return guard_against_nan(a, np.min(a))


@measure_values(cut_interval, grows=True)
def extent(a: np.ndarray) -> float:
    """Return maximum minus minimum over an interval."""
    return guard_against_nan(a, np.ptp(a))


@measure_values(cut_interval, grows=True)
def swing(a: np.ndarray) -> float:
    """Return the smaller of the largest rise and the largest fall: zero for a monotonic drift."""
    rise, fall = np.max(a - np.minimum.accumulate(a)), np.max(np.maximum.accumulate(a) - a)
    return guard_against_nan(a, min(rise, fall))


@measure_values(cut_interval, natural="one")
def peak_over_median(a: np.ndarray) -> float:
    """Return max |a| over the median of |a|: how far a peak stands out; NaN if that median is zero."""
    known = np.abs(a[np.isfinite(a)])
    return float(np.max(known) / np.median(known)) if np.any(known) and np.median(known) > 0.0 else NAN


@measure(grows=True)
def rise(record: RunRecord, s: Series, series: str, begin: float, to: float, partial: bool = False) -> float:
    """Return how far a series rises: its maximum from ``from`` to ``to`` [s], minus its value at ``from``."""
    a = cut_interval(record, s, series, begin, to, partial)
    return NAN if a is None else guard_against_nan(a, np.max(a)) - value(record, s, series, begin)


@measure(grows=True)
def away(record: RunRecord, s: Series, of: str, begin: float = 0.0, to: float = NAN, partial: bool = False) -> float:
    """Return max |observable - its reference| of the observable named ``of``, over an interval of time."""
    own, exact = (cut_interval(record, s, f"{k}_{of}", begin, to, partial) for k in ("obs", "ref"))
    if own is None or exact is None:
        return NAN
    known = ~np.isnan(exact)  # NaN beyond the reference's horizon
    return (
        guard_against_nan(own[known], np.max(np.abs(own[known] - exact[known]), initial=0.0)) if np.any(known) else NAN
    )


@measure(until="end", natural="one")
def grows(record: RunRecord, s: Series, series: str, floor: float = 0.0) -> float:
    """Return max |series| in the last quarter of the requested time over that in the first quarter.

    It is 1 if both are at most ``floor``, and infinite if the first is zero or the last is not finite.
    """
    quarter = 0.25 * record.t_end_s
    first, last = cut_interval(record, s, series, to=quarter), cut_interval(record, s, series, 3.0 * quarter)
    if first is None or last is None:
        return NAN
    a, b = float(np.max(np.abs(last))), float(np.max(np.abs(first)))
    return 1.0 if max(a, b) <= floor else math.inf if b == 0.0 or not math.isfinite(a) else a / b


@measure(until="end", natural="one")
def keeps_growing(record: RunRecord, s: Series, series: str) -> float:
    """Return the smallest ratio of max |series| in one quarter of the requested time to that in the quarter before.

    Above 1 the series grows in every quarter.
    """
    edges = [0.25 * k * record.t_end_s for k in range(5)]
    quarters = [cut_interval(record, s, series, a, b) for a, b in pairwise(edges)]
    if any(q is None for q in quarters) or not reached_end(record):
        return NAN
    sizes = [float(np.max(np.abs(q))) for q in quarters if q is not None]
    return min(b / a if a > 0.0 else math.inf for a, b in pairwise(sizes))


@measure(until="end")
def beginning(record: RunRecord, s: Series, series: str, to: float) -> float:
    """Return max |series| up to the time ``to`` [s] over that of the whole run: small for gradual growth."""
    first, whole = cut_interval(record, s, series, to=to), cut_interval(record, s, series)
    if first is None or whole is None or not np.max(np.abs(whole)) > 0.0:
        return NAN
    return float(np.max(np.abs(first)) / np.max(np.abs(whole)))


@measure(grows=True, natural="one", reads=("energy",))
def energy_ratio(record: RunRecord, s: Series) -> float:
    """Return the ratio of the largest mechanical energy to the initial one, over as much of the run as exists."""
    E = s["energy"]
    return guard_against_nan(E, np.max(E)) / float(E[0]) if E[0] != 0.0 else NAN


# a series at an instant


@measure()
def value(record: RunRecord, s: Series, series: str, at: float) -> float:
    """Return the value of a series at the time ``at`` [s], interpolated linearly; NaN if the run stopped before it."""
    t, a = s["t"], s.get(series)
    return NAN if a is None or at > t[-1] * (1.0 + END) else float(np.interp(at, t, a))


@measure()
def change(record: RunRecord, s: Series, series: str, begin: float, to: float) -> float:
    """Return the value of a series at ``to`` minus that at ``from`` [s], signed."""
    return value(record, s, series, to) - value(record, s, series, begin)


@measure(until="known")
def rate(record: RunRecord, s: Series, series: str, at: float) -> float:
    """Return |d series/dt| over the first step that ends after ``at`` [s]; NaN if the run stopped before it."""
    t, a = s["t"], s.get(series)
    if a is None or at >= t[-1]:
        return NAN
    k = int(np.searchsorted(t, at, side="right"))
    return float(abs((a[k] - a[k - 1]) / (t[k] - t[k - 1])))


@measure(grows=True, until="known")
def leaves_at(record: RunRecord, s: Series, series: str, limit: float) -> float:
    """Return the first time |series| exceeds a limit [s]; infinite if it never does."""
    a = s.get(series)
    if a is None:
        return NAN
    beyond = np.flatnonzero(~(np.abs(a) <= limit))
    return float(s["t"][beyond[0]]) if len(beyond) else math.inf


@measure(until="known")
def drop_at_lowest(record: RunRecord, s: Series, series: str, low: str, within: float) -> float:
    """Return how far ``series`` drops around the first local minimum of the series ``low``, as a negative number.

    It is the least value within ``within`` [s] of that minimum, minus the first value there. NaN if the run ends
    earlier.
    """
    a, turn, t = s.get(series), _find_first_minimum(s, low), s["t"]
    if a is None or turn is None or t[-1] < (t[turn] + within) * (1.0 - END):
        return NAN
    near = a[np.abs(t - t[turn]) <= within]
    return float(np.min(near) - near[0])


@measure()
def peak_after_lowest(record: RunRecord, s: Series, series: str, low: str, to: float = NAN) -> float:
    """Return the time [s] between the maximum of |series| up to ``to`` [s] and the first minimum of series ``low``."""
    a, turn = cut_interval(record, s, series, to=to), _find_first_minimum(s, low)
    return NAN if a is None or turn is None else float(abs(s["t"][int(np.argmax(np.abs(a)))] - s["t"][turn]))


def _find_first_minimum(s: Series, low: str) -> int | None:
    """Return the row of the first local minimum of series ``low``; None if it has none."""
    h = s.get(low)
    if h is None:
        return None
    turns = np.flatnonzero((h[1:-1] < h[:-2]) & (h[1:-1] <= h[2:])) + 1
    return int(turns[0]) if len(turns) else None


# accepted steps, after the start-up and without the last one


@measure_values(cut_steps, grows=True, natural="one")
def step_ratio(dt: np.ndarray) -> float:
    """Return the largest accepted step over the smallest."""
    return float(np.max(dt) / np.min(dt))


@measure_values(cut_steps)
def irregularity(dt: np.ndarray) -> float:
    """Return the mean absolute change of log10 of the step from one step to the next: 0 for a fixed step."""
    return float(np.mean(np.abs(np.diff(np.log10(dt)))))


@measure_values(cut_steps)
def typical_step(dt: np.ndarray) -> float:
    """Return the median accepted step [s]."""
    return float(np.median(dt))


@measure_values(cut_steps)
def smallest_step(dt: np.ndarray) -> float:
    """Return the smallest accepted step [s]."""
    return float(np.min(dt))


# the record of a whole run


@measure(needs_series=False, until="end", grows=True)
def column(record: RunRecord, series: Series | None, name: str, partial: bool = False) -> float:
    """Return the number in column ``name`` of the record; NaN if the run did not reach its end, unless ``partial``.

    A column without a number gives NaN, too.
    """
    found = getattr(record, name, NAN)
    return float(found) if (partial or reached_end(record)) and isinstance(found, int | float) else NAN


@measure(needs_series=False, of_end=True)
def loss(record: RunRecord, series: Series | None) -> float:
    """Return the largest position error [m] while the motion is predictable; infinite if the run stopped early.

    Claims on losses say "or does not end".
    """
    return record.position_error_judged_m if reached_end(record) else math.inf


@measure(needs_series=False, of_end=True)
def orientation_loss(record: RunRecord, series: Series | None) -> float:
    """Return the largest orientation error [rad] while the motion is predictable; infinite if it stopped early."""
    return record.orientation_error_judged_rad if reached_end(record) else math.inf


@measure(needs_series=False, until="end")
def corrections_per_step(record: RunRecord, series: Series | None) -> float:
    """Return Newton's corrections per step of a run that reached its end."""
    return record.newton_iterations / record.steps if reached_end(record) and record.steps else NAN


@measure(needs_series=False, until="end")
def evaluations_per_step(record: RunRecord, series: Series | None) -> float:
    """Return the evaluations of the equations per step of a run that reached its end."""
    return record.evaluations / record.steps if reached_end(record) and record.steps else NAN


@measure(needs_series=False)
def late_energy(record: RunRecord, series: Series | None) -> float:
    """Return |time mean of the energy error over the last quarter| [J] of a run that reached its end."""
    return abs(record.energy_mean_last_quarter_J) if reached_end(record) else NAN


@measure(needs_series=False, grows=True, of_end=True, natural="firm")
def reached(record: RunRecord, series: Series | None) -> float:
    """Return the fraction of the requested time that the run reached; 1 is the end."""
    return min(stops_at(record, series) / record.t_end_s, 1.0)


@measure(needs_series=False, grows=True, of_end=True, natural="end")
def stops_at(record: RunRecord, series: Series | None) -> float:
    """Return the time at which the run stopped before its end [s]; infinite if it did not."""
    if reached_end(record):
        return math.inf
    return 0.0 if math.isnan(record.t_reached_s) else record.t_reached_s


@measure(needs_series=False, of_stopped=True, of_end=True)
def stop_time(record: RunRecord, series: Series | None, by: float = math.inf) -> float:
    """Return the time at which the run stopped [s]; NaN if it reached its end or stopped after ``by`` [s]."""
    time = stops_at(record, series)
    return NAN if reached_end(record) or time > by else time


# two runs together


@measure(of_pair=True)
def apart(
    record: RunRecord, s: Series, other_record: RunRecord, other: Series, series: list[str], to: float = math.inf
) -> float:
    """Return the largest distance of two runs: the norm of the differences of the named ``series``.

    It is evaluated at the steps of the first run, up to ``to`` [s] if given, with the other one interpolated linearly.
    NaN if a run stopped before that time or its end, or lacks a series.
    """
    t = s["t"][s["t"] <= to]
    whole = all(r.t_reached_s >= min(r.t_end_s, to) * (1.0 - END) for r in (record, other_record))
    if not whole or t[-1] > other["t"][-1] * (1.0 + END) or not all(k in s and k in other for k in series):
        return NAN
    gaps = [s[k][: len(t)] - np.interp(t, other["t"], other[k]) for k in series]
    distance = np.sqrt(np.sum(np.square(gaps), axis=0))
    return guard_against_nan(distance, np.max(distance))
