"""What is measured beside the paper's words: numbers of records and series, each with the sentence that says it."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..model.words import listed, number, signed, time
from ..plots.style import plain
from .lines import Line
from .spec import Says

Values = Mapping[str, float]


@dataclass(frozen=True)
class Fact:
    """A sentence and its numbers; ``differs`` where the run ends otherwise than the paper says."""

    text: str
    values: Mapping[str, Values] = field(default_factory=dict)  # by key of the pick, then by name
    differs: bool = False


def measured(says: Says, lines: Sequence[Line]) -> Fact:
    """``says`` tried on its picks; those without a run or without steps are named as such."""
    asked = [k for k in lines if not says.picks or k.key in says.picks]
    there = [k for k in asked if k.chosen.run is not None]
    fact = MEASURES[says.measure](says, there) if there else Fact("")
    absent = [k.name for k in asked if k.chosen.run is None]
    words = [fact.text] if fact.text else []
    words += [f"not in this run: {listed(absent)}"] if absent else []
    text = "; ".join(words)
    return Fact(f"The paper: {says.words}. Here: {text}." if says.words else f"{text}.", fact.values, fact.differs)


def _record(says: Says, lines: Sequence[Line], names: Mapping[str, str], write: Callable[..., str]) -> Fact:
    """A sentence from columns of the record."""
    values = {k.key: {n: float(getattr(_run(k).record, n)) for n in names} for k in lines}
    return Fact(listed([f"{k.name} {write(*values[k.key].values())}" for k in lines], 12), values)


def end(says: Says, lines: Sequence[Line]) -> Fact:
    """How and when a run ended, against the paper's failure or success."""
    words, differs, values = [], False, {}
    for k in lines:
        run = _run(k)
        r = run.record
        values[k.key] = {"t_reached_s": r.t_reached_s, "t_end_s": r.t_end_s}
        why = plain(run.reasons[0]) if run.reasons else ""
        if run.succeeded:
            said = f"reaches {time(r.t_end_s)} s, and nothing contradicts it"
        elif run.status == "wrong":
            said = f"reaches {time(r.t_end_s)} s, wrong ({why})"
        elif run.stopped:
            said = f"stops at {time(round(r.t_reached_s, 4))} s, {run.status.replace('_', ' ')} ({why})"
        else:
            said = f"{run.status} ({why})"
        fails = says.fails_at is not None
        differs |= (fails and not run.stopped) or (says.runs and run.stopped)
        words.append(f"{k.name} {said}")
    return Fact(listed(words, 12) + (", which differs" if differs else ""), values, differs)


def drift(says: Says, lines: Sequence[Line]) -> Fact:
    """Largest energy error and that at the end."""
    names = {"energy_drift_max_J": "", "energy_drift_end_J": ""}
    return _record(says, lines, names, lambda a, b: f"at most {number(a)} J, {signed(b)} J at its end")


def error(says: Says, lines: Sequence[Line]) -> Fact:
    """Largest distance from the exact motion."""
    names = {"position_error_max_m": "", "orientation_error_max_rad": ""}
    fact = _record(says, lines, names, lambda a, b: f"{number(a)} m and {number(b)} rad")
    return Fact(f"largest error of position and orientation: {fact.text}", fact.values)


def step(says: Says, lines: Sequence[Line]) -> Fact:
    """Least and largest step, and the decades between."""
    if says.window is None:
        names = {"step_min_s": "", "step_max_s": ""}
        return _record(says, lines, names, _decades)
    values = {}
    for k in lines:
        dt = _rows(k, "dt", says)[1]
        values[k.key] = {"least": float(np.nanmin(dt[1:], initial=np.inf)), "most": float(np.nanmax(dt, initial=0.0))}
    return Fact(listed([f"{k.name} {_decades(*values[k.key].values())}" for k in lines], 12), values)


def energy(says: Says, lines: Sequence[Line]) -> Fact:
    """Largest energy against the first one, in joule and as a multiple."""
    words, values = [], {}
    for k in lines:
        start, worst = _run(k).record.energy_start_J, _run(k).record.energy_drift_max_J
        values[k.key] = {"energy_drift_max_J": worst, "energy_start_J": start}
        words.append(f"{k.name} departs by at most {number(worst)} J from {number(start)} J")
    return Fact(listed(words, 12), values)


def axis(says: Says, lines: Sequence[Line]) -> Fact:
    """Angle between the first axis of rotation and that at the end."""
    values = {k.key: {"axis_deg": float(np.rad2deg(_rows(k, "obs_axis_error", says)[1][-1]))} for k in lines}
    words = [f"{k.name} {number(values[k.key]['axis_deg'])} deg" for k in lines]
    return Fact(f"axis at the end off the first one by {listed(words, 12)}", values)


def largest(says: Says, lines: Sequence[Line]) -> Fact:
    """Largest magnitude of a series."""
    values = {k.key: {"largest": _largest(k, says)} for k in lines}
    words = [f"{k.name} {number(values[k.key]['largest'])}" for k in lines]
    return Fact(f"largest {_name(says, lines)} of {listed(words, 12)}", values)


def order(says: Says, lines: Sequence[Line]) -> Fact:
    """From the largest to the smallest."""
    values = {k.key: {"largest": _largest(k, says)} for k in lines}
    ranked = sorted(lines, key=lambda k: -values[k.key]["largest"])
    words = [f"{k.name} {number(values[k.key]['largest'])}" for k in ranked]
    return Fact(f"{_name(says, lines)} from largest to smallest: {listed(words, 12)}", values)


def deepest(says: Says, lines: Sequence[Line]) -> Fact:
    """The largest energy error with its sign and time, and when E is first at its lowest."""
    words, values = [], {}
    for k in lines:
        t, gap = _rows(k, "energy_error", says)
        _, height = _rows(k, "obs_E_y", says)
        at, low = int(np.argmax(np.nan_to_num(np.abs(gap)))), _first_low(height)
        values[k.key] = {"energy_error_J": float(gap[at]), "t_s": float(t[at]), "t_lowest_s": float(t[low])}
        words.append(
            f"{k.name} {signed(float(gap[at]))} J at {time(round(float(t[at]), 4))} s"
            f" (E lowest at {time(round(float(t[low]), 4))} s)"
        )
    return Fact(f"largest energy error {listed(words, 12)}", values)


def recovery(says: Says, lines: Sequence[Line]) -> Fact:
    """The largest energy error in the window, and what is left of it at its end."""
    words, values = [], {}
    for k in lines:
        _, gap = _rows(k, "energy_error", says)
        values[k.key] = {"largest": _peak(gap), "end": float(gap[-1])}
        words.append(f"{k.name} {number(values[k.key]['largest'])} J, then {signed(float(gap[-1]))} J")
    return Fact(f"largest energy error and that at the end of the window: {listed(words, 12)}", values)


def away(says: Says, lines: Sequence[Line]) -> Fact:
    """Largest distance of an observable from the exact one, of the record."""
    name = says.series.removeprefix("obs_")
    found = {k.key: _run(k).observable_errors.get(name, {}) for k in lines}
    values = {key: {"max": float(f.get("max", math.nan))} for key, f in found.items()}
    unit = next((str(f["unit"]) for f in found.values() if "unit" in f), "")
    words = [f"{k.name} {number(values[k.key]['max'])} {unit}" for k in lines]
    return Fact(f"largest distance of {name} from the exact one: {listed(words, 12)}", values)


MEASURES: Mapping[str, Callable[[Says, Sequence[Line]], Fact]] = {
    f.__name__: f for f in (end, drift, error, step, energy, axis, largest, order, deepest, recovery, away)
}
NAMES = {"phi_norm": "|phi| [m]", "phi_dot_norm": "|phi_dot| [m/s]", "energy_error": "energy error [J]"}


def _name(says: Says, lines: Sequence[Line]) -> str:
    units = next((k.series.units for k in lines if k.series is not None), {})
    name = says.series.removeprefix("obs_")
    return NAMES.get(says.series) or f"|{name}| [{units.get(says.series, '')}]"


def _run(line: Line):  # type: ignore[no-untyped-def]
    assert line.chosen.run is not None  # lines without a run were sorted out before
    return line.chosen.run


def _decades(least: float, most: float) -> str:
    if not (0.0 < least < math.inf and 0.0 < most < math.inf):
        return "no step"
    return f"{number(least)} to {number(most)} s ({math.log10(most / least):.1f} decades)"


def _rows(line: Line, name: str, says: Says) -> tuple[np.ndarray, np.ndarray]:
    """Times and values in the window; one row of NaN where the series is not there."""
    nothing = np.full(1, np.nan)
    if line.series is None or name not in line.series or not len(line.series["t"]):
        return nothing, nothing
    t, a = line.series["t"], line.series[name]
    inside = (t >= says.window[0]) & (t <= says.window[1]) if says.window else np.ones(len(t), bool)
    return (t[inside], a[inside]) if inside.any() else (nothing, nothing)


def _largest(line: Line, says: Says) -> float:
    return _peak(_rows(line, says.series, says)[1])


def _peak(values: np.ndarray) -> float:
    """Largest magnitude; NaN where there is no number."""
    return float(np.abs(values[np.isfinite(values)]).max(initial=-1.0)) if np.isfinite(values).any() else math.nan


def _first_low(height: np.ndarray) -> int:
    """The first lowest point: where it first turns upwards."""
    up = np.flatnonzero(np.diff(height) > 0.0)
    return int(up[0]) if len(up) else len(height) - 1
