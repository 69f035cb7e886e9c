"""Plot curves over time: the laws that the exact motion keeps, the step, errors, observables, invariants."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...harness.columns.declaring import find_key, find_series_name
from ...harness.mechanics.types import Law, Status
from ...harness.results.records import DECLARED, find_limit
from ..model.accuracy import find_judged_end
from ..model.curves import SPANS_UPPER, Curve, find_log_limits, find_range
from ..model.motion import MotionCurves, read_curves
from ..model.results import StoredResults, StoredRun
from ..model.words import number, time, unit
from .lines import Line, find_shared_options, make_lines, make_traces
from .spec import MOST, Axis, Chapter, Plot, Trace

BLOWN_UP = 1e-9  # a reference below this fraction of the shown range is zero and gives no scale
# columns whose limits are drawn over time
LIMITED = {Law.ENERGY: "energy_drift_max_J", Law.CONSTRAINT: "phi_max", Law.CONSTRAINT_RATE: "phi_dot_max"}
ALIKE = 0.01  # relative difference below which limits of runs are one line
JUDGED = (Status.SUCCESS, Status.INACCURATE, Status.WRONG)


@dataclass(frozen=True)
class Drawing:
    """The data that all plots over time of a problem share."""

    runs: Sequence[StoredRun]  # all runs of the problem, which give the scales
    lines: Sequence[Line]
    motions: Mapping[str, MotionCurves]
    spans: int = SPANS_UPPER
    focus: tuple[str, ...] = ()  # solvers in colour
    label: str = ""  # label of the runs that findings describe; all runs if no line has it

    @property
    def largest(self) -> str:
        """The words that say which value a point of a magnitude shows."""
        return f"largest in each of {self.spans} spans of time"

    @property
    def axis(self) -> Axis:
        """The time axis up to the longest end time of the runs."""
        ends = [r.t_end_s for c in self.runs if (r := c.record).t_end_s == r.t_end_s]
        return Axis("t", "s", low=0.0, high=1.02 * max(ends, default=1.0), link="time", symbol="t")

    @property
    def known_axis(self) -> Axis:
        """The time axis up to the end of the longest reference."""
        ends = [r.reference_horizon_s for c in self.runs if (r := c.record).reference and r.reference_horizon_s > 0.0]
        return replace(self.axis, high=min(self.axis.high, 1.02 * max(ends, default=math.inf)))

    def find_curves(self, kind: str) -> dict[str, str]:
        """Return the units of the curves whose names begin with ``kind``, by the rest of the name."""
        out: dict[str, str] = {}
        for m in self.motions.values():
            for name in (n for n in m.curves if n.startswith(kind)):
                out.setdefault(name.removeprefix(kind), unit(m.units.get(name, "")))
        return out

    def find_longest(self, name: str) -> Curve | None:
        """Return the curve ``name`` of the run in which it ends last; None if no run has it."""
        found = (m.curves[name] for m in self.motions.values() if name in m.curves)
        return max(found, key=lambda c: float(c.t[-1]), default=None)

    def match_lines(self, name: str, lines: Iterable[Line]) -> list[tuple[Line, Curve]]:
        """Return the lines whose runs have the curve of that name, each with its curve."""
        found = ((line, self.motions[line.run.record.run_id].curves.get(name)) for line in lines)
        return [(line, c) for line, c in found if c is not None]

    def find_extremes(self, name: str, until: float = math.inf) -> list[tuple[float, str]]:
        """Return the smallest and largest peak up to ``until`` [s] of the solvers' finest runs, each with its solver.

        Runs under the drawing's label are compared if it has any. The list has one element for a single run, and none
        if no run has the curve ``name``.
        """
        main = [line for line in self.lines if line.main]
        own = [line for line in main if line.run.record.label == self.label] or main
        found = [
            (float(np.max(c.y[c.t <= until], initial=0.0)), line.run.record.solver)
            for line, c in self.match_lines(name, own)
        ]
        return [min(found), max(found)][: len(found)] if found else []

    def find_scale(self, column: str) -> float:
        """Return the largest value of a column of the records over all runs of the problem; 1 if none has it."""
        values = [getattr(c.record, column) for c in self.runs]
        return max((v for v in values if v == v), default=1.0)

    def plot_log(
        self,
        curve: str,
        name: str,
        title: str,
        caption: str,
        axis: Axis,
        scale: float,
        extra: Sequence[Trace] = (),
        t: Axis | None = None,
        until: float = math.inf,
    ) -> Iterable[Plot]:
        """Yield one plot of the nonnegative quantity ``curve`` over time on a logarithmic axis; none if no run has it.

        ``name``, ``title``, ``caption`` and ``axis`` are the plot's; values far below or above ``scale`` are cut.
        ``extra`` are traces such as a limit, ``t`` replaces the time axis, and peaks after ``until`` [s] do not count
        in the plot's title.
        """
        drawn = self.match_lines(curve, self.lines)
        if drawn:
            low, high = find_log_limits([c for _, c in drawn], scale)
            high = max(high, *(3.0 * v for t in extra for v in t.reach), high)
            own = make_traces(drawn, (0.0, high), low)
            if not any(t.y.any() for t in own):
                caption = f"Exactly zero throughout. {caption}"
            found = self.find_extremes(curve, until)
            finding = f"{title} at the finest settings: {_describe_extremes(found, axis.unit)}"
            focus = tuple(dict.fromkeys([*(solver for _, solver in found), *self.focus]))[:MOST]
            axis = replace(axis, log=True, low=low, high=high)
            yield Plot(
                name,
                title,
                caption,
                t or self.axis,
                axis,
                [*own, *extra],
                focus=focus if self.focus else (),
                finding=finding if found else "",
            )


def _describe_extremes(found: Sequence[tuple[float, str]], unit_name: str) -> str:
    """Return the smallest and largest values in words, each with its solver: ``1.2 m (a) to 3.4 m (b)``."""
    return " to ".join(" ".join(filter(None, (number(value), unit_name, f"({solver})"))) for value, solver in found)


def draw_runs(results: StoredResults, runs: Sequence[StoredRun], all_runs: Sequence[StoredRun]) -> Drawing:
    """Return the drawing with a line for each of ``runs``; ``all_runs`` are all runs of the problem, for the scales."""
    motions = {c.record.run_id: read_curves(c, results.readable_series(c)) for c in runs}
    return Drawing(all_runs, make_lines(runs, find_shared_options(runs)), motions)


def plot_laws(d: Drawing) -> Chapter | None:
    """Return the chapter with plots of energy error, |phi|, |phi_dot| and step; None if no run has any of them."""
    energy, length = d.find_scale("energy_scale_J"), d.find_scale("length_scale_m")
    runs = [line.run for line in d.lines]
    limits = {law: make_limit_line(runs, name, d.axis.high) for law, name in LIMITED.items()}
    return _make_chapter(
        "Laws and step",
        "Quantities that the exact motion conserves, and the accepted steps.",
        [
            *d.plot_log(
                "energy_error",
                "energy",
                "Energy error",
                f"Magnitude, {d.largest}; the work of dampers, loads, user forces and drives is subtracted. Above its "
                "limit a run is wrong.",
                Axis("|E − E₀|", "J", symbol="|E-E_0|"),
                energy,
                limits[Law.ENERGY],
            ),
            *d.plot_log(
                "phi_norm",
                "phi",
                "Constraints",
                f"Norm of the constraint residual, {d.largest}; axis rows have no unit and count as metres.",
                Axis("|φ|", "m", symbol=r"\|\phi\|"),
                length,
                limits[Law.CONSTRAINT],
            ),
            *d.plot_log(
                "phi_dot_norm",
                "phi-dot",
                "Constraint rates",
                f"Norm of its rate, {d.largest}.",
                Axis("|φ̇|", "m/s", symbol=r"\|\dot\phi\|"),
                length,
                limits[Law.CONSTRAINT_RATE],
            ),
            *d.plot_log(
                "dt",
                "step",
                "Step",
                "Median of each span, in a band from smallest to largest.",
                Axis("Δt", "s", symbol=r"\Delta t"),
                d.axis.high,
            ),
        ],
    )


def plot_declared(d: Drawing) -> Chapter | None:
    """Return the chapter with a plot of each record's column that declares a figure; None if no run has any of them."""
    plots: list[Plot] = []
    for name, declared in DECLARED.items():
        if declared.figure:
            series = find_series_name(name, declared)
            sizes = [float(c.y.max()) for _, c in d.match_lines(series, d.lines)]
            plots += d.plot_log(
                series,
                find_key(name, declared).replace("_", "-"),
                declared.head,
                f"{declared.figure}: {d.largest}.",
                Axis(declared.head, declared.unit),
                max((size for size in sizes if math.isfinite(size)), default=1.0) or 1.0,
                make_limit_line([line.run for line in d.lines], name, d.axis.high),
            )
    return _make_chapter("Further quantities", "Quantities that columns declare.", plots)


def plot_errors(d: Drawing) -> Chapter | None:
    """Return the chapter with plots of the distance from the exact motion; None if no run has any of them."""
    length, until, own = d.find_scale("length_scale_m"), find_judged_end(d.runs), d.find_longest("reference_own_error")
    floor = [] if own is None else [Trace("the reference's stated error", own.t, own.y, dash=2)]
    far = f"Worst body, {d.largest}, up to the end of the reference."
    t, judged_to = d.known_axis, until or math.inf
    position, turn = Axis("|r − r exact|", "m"), Axis("∠(R, R exact)", "rad")
    plots = [
        *d.plot_log("position_error", "position", "Position error", far, position, length, floor, t, judged_to),
        *d.plot_log("orientation_error", "orientation", "Orientation error", far, turn, 1.0, t=t, until=judged_to),
    ]
    note = "Distance from the exact motion."
    if until is not None:
        plots = [replace(p, marks={"judged up to here": [until]}) for p in plots]  # the plane needs no reference
        note += f" Errors are judged up to {time(until)} s (dotted line); beyond it the motion is chaotic."
    plane = "Worst body's distance from the plane that the exact motion stays in."
    plots += d.plot_log("out_of_plane", "plane", "Out of the plane", plane, Axis("distance", "m"), length)
    return _make_chapter("Errors against the reference", note, plots)


def plot_observables(d: Drawing) -> Chapter | None:
    """Return the chapter with plots of each observable and its distance from the reference; None if there are none."""
    plots: list[Plot] = []
    for name, in_unit in d.find_curves("obs_").items():
        exact, drawn = d.find_longest(f"ref_{name}"), d.match_lines(f"obs_{name}", d.lines)
        low, high = find_value_limits([c for _, c in drawn], exact)
        known = [] if exact is None else [Trace("reference", exact.t, exact.y, reach=find_range(exact, (low, high)))]
        caption = f"Smallest and largest of each span; {'the thin line is the' if known else 'there is no'} reference."
        # cut at an axis's length beyond either end, so that a line that leaves the axis leaves it steeply
        own = make_traces(drawn, (2 * low - high, 2 * high - low))
        axis = Axis(name, in_unit, low=low, high=high)
        off = _describe_extremes(d.find_extremes(f"away_{name}"), in_unit)
        finding = f"{name} at the finest settings: off by {off}" if off else ""
        plots.append(
            Plot(
                f"obs-{name}",
                name,
                caption,
                d.known_axis if known else d.axis,
                axis,
                [*own, *known],
                focus=d.focus,
                finding=finding,
            )
        )
        plots += d.plot_log(
            f"away_{name}",
            f"away-{name}",
            f"{name}: distance from the reference",
            f"Magnitude, {d.largest}.",
            Axis("|difference|", in_unit),
            high - low,
            t=d.known_axis,
        )
    return _make_chapter("Observables", "Quantities that the problem defines for comparison.", plots)


def plot_invariants(d: Drawing) -> Chapter | None:
    """Return the chapter with plots of the departure of each invariant from its start; None without invariants."""
    plots: list[Plot] = []
    for name, in_unit in d.find_curves("inv_").items():
        starts = [abs(c.record.invariants[name].start) for c in d.runs if name in c.record.invariants]
        size = max((s for s in starts if 0.0 < s < float("inf")), default=1.0)
        caption = f"Departure from the start ({number(size)} {in_unit}), {d.largest}."
        plots += d.plot_log(f"inv_{name}", f"inv-{name}", name, caption, Axis(f"|{name} − start|", in_unit), size)
    return _make_chapter("Invariants", "Quantities beside energy that the exact motion conserves.", plots)


def _make_chapter(title: str, note: str, plots: Sequence[Plot]) -> Chapter | None:
    """Return the plots as a chapter; None if there are none."""
    return Chapter(title, note, tuple(plots)) if plots else None


def find_value_limits(shown: Sequence[Curve], exact: Curve | None, reach: float = np.inf) -> tuple[float, float]:
    """Return limits of a linear axis around all values of the curves ``shown`` and the reference ``exact``.

    If a curve diverged, limits are around the reference, or without one within ``reach`` of the first curve's start.
    """
    values = [c.y for c in shown] + ([exact.y] if exact is not None else [])
    low, high = min((float(v.min()) for v in values), default=0.0), max((float(v.max()) for v in values), default=1.0)
    if exact is not None and len(exact):
        size = max(float(np.ptp(exact.y)), float(np.abs(exact.y).max()))
        if size > BLOWN_UP * (high - low):
            low, high = max(low, float(exact.y.min()) - size), min(high, float(exact.y.max()) + size)
    elif shown:
        start = float(shown[0].y[0])
        low, high = max(low, start - reach), min(high, start + reach)
    margin = 0.08 * (high - low) or 0.08 * abs(high) or 1.0
    return low - margin, high + margin


def make_limit_line(runs: Sequence[StoredRun], column: str, end: float) -> list[Trace]:
    """Return the line from 0 to ``end`` that a column of ``runs`` must not cross; none if no run has a limit.

    Each run is judged by its own size: if limits differ, the least is drawn and named so.
    """
    unit = DECLARED[column].unit
    found = [at for r in runs if r.status in JUDGED and (at := find_limit(r.record, column)) > 0.0]
    if not found:
        return []
    at, alike = min(found), max(found) <= (1.0 + ALIKE) * min(found)
    words = f"limit {number(at)} {unit}" if alike else f"least limit {number(at)} {unit}, each run its own"
    return [Trace(words, np.array([0.0, end]), np.full(2, at), dash=1, reach=(at, at))]
