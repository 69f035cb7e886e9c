"""The panels of a figure as plots: the chosen runs' series in a window, and the exact motion in ink."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...harness.results.records import RunRecord
from ...harness.results.series import Series
from ..model import curves
from ..model.curves import Curve
from ..model.results import group_by
from ..model.words import number
from ..plots.lines import all_lines, describe_end, shared_options
from ..plots.spec import Axis, Plot, Trace, end_of
from .limits import is_rounding, limits_of
from .picking import Chosen
from .spec import Panel

MISSING = "not in these results"


@dataclass(frozen=True)
class Line:
    """A run that a figure draws, with its series."""

    chosen: Chosen
    series: Series | None
    dash: int = 0

    @property
    def words(self) -> str:
        """The paper's name, ours, the settings, and how it ended or that the run or its series is missing."""
        run = self.chosen.run
        words = f"{self.chosen.role} ({self.chosen.asked.solver}), {self.chosen.settings}"
        if run is None:
            return f"{words}: {MISSING}"
        if self.series is None and run.record.series:
            return f"{words}: its series cannot be read"
        return f"{words}{describe_end(run)}"


def lines_of(chosen: Sequence[Chosen], series: Mapping[str, Series | None]) -> list[Line]:
    """In the order of the picks; ``series`` by run."""
    runs = [c.run for c in chosen if c.run]
    dash = {k.run.record.run_id: k.dash for k in all_lines(runs, shared_options(runs))}
    found = [(c, c.run.record.run_id) if c.run else (c, "") for c in chosen]
    return [Line(c, series.get(run), dash.get(run, 0)) for c, run in found]


def select_lines(panel: Panel, lines: Sequence[Line]) -> list[Line]:
    """Those that the panel asks for."""
    if not panel.tightest:
        return list(lines)
    asked = group_by((k.chosen.asked for k in lines), lambda a: a.solver)
    least = {solver: min(a.control.rtol or 0.0 for a in own) for solver, own in asked.items()}
    return [k for k in lines if (k.chosen.asked.control.rtol or 0.0) == least[k.chosen.asked.solver]]


def plot_of(panel: Panel, lines: Sequence[Line]) -> Plot:
    """All of it but its letter; the caption says what a line does not show by itself."""
    found = [(k, curve(k, name, panel)) for k in select_lines(panel, lines) for name in panel.of]
    made = [(k, c) for k, c in found if c is not None and len(c)]
    drawn, exact, known = [c for _, c in made], exact_of(panel, lines), records_of(lines)
    units = {k.series.units.get(name, "") for k in lines if k.series is not None for name in panel.of}
    low, high = limits_of(panel, known, units, drawn, exact)
    traces = []
    for k, c in made:
        run = k.chosen.run
        ends = run and run.record.t_reached_s <= panel.window[1] * (1.0 + 1e-9) and (run.stopped or len(panel.of) == 1)
        end = end_of(run.status) if run and ends else ""
        solver = k.chosen.asked.solver
        traces.append(Trace(k.words, c.t, np.clip(c.y, low, high), solver=solver, dash=k.dash, end=end))
    if exact is not None:
        traces.append(Trace("exact motion", exact.t, np.clip(exact.y, low, high)))
    room = 0.015 * (panel.window[1] - panel.window[0])
    time = Axis("t", "s", low=panel.window[0], high=panel.window[1] + room, symbol="t")
    words = _remark(panel, drawn, (low, high), known, units)
    return Plot(panel.title, panel.title, words, time, replace(panel.axis, low=low, high=high), traces)


def curve(line: Line, name: str, panel: Panel) -> Curve | None:
    """A series in the panel's window, made small with its peaks kept; magnitudes on a logarithmic axis."""
    if line.series is None or name not in line.series:
        return None
    t, a = line.series["t"], line.series[name]
    if name == "dt" and line.chosen.run is not None and not line.chosen.run.stopped and len(t) > 2:
        t, a = t[:-1], a[:-1]  # the last step may be cut to end at t_end; of a failure it is the point
    return within(t, a, panel.window, largest=panel.axis.log and name != "dt")


def within(t: np.ndarray, a: np.ndarray, window: tuple[float, float], *, largest: bool = False) -> Curve:
    """Rows of the window, and one beyond each edge, as far as it goes; with ``largest`` the peaks of |a| alone."""
    first = max(int(np.searchsorted(t, window[0])) - 1, 0)
    last = int(np.searchsorted(t, window[1], side="right")) + 1
    kind = curves.upper if largest else curves.signed_curve
    cut = kind(t[first:last] - window[0], a[first:last], window[1] - window[0])
    return Curve(cut.t + window[0], cut.y)


def exact_of(panel: Panel, lines: Sequence[Line]) -> Curve | None:
    """The reference's series from the line that has it to the latest time."""
    found = [
        k.series for k in select_lines(panel, lines) if panel.exact and k.series is not None and panel.exact in k.series
    ]
    longest = max(found, key=lambda s: np.max(s["t"], where=np.isfinite(s[panel.exact]), initial=-np.inf), default=None)
    return None if longest is None else within(longest["t"], longest[panel.exact], panel.window)


def _remark(panel: Panel, drawn: Sequence[Curve], limits: tuple[float, float], records: Sequence[RunRecord],
            units: set[str]) -> str:  # fmt: skip
    """Notes on what a line does not show by itself: rounding, values beyond the axis; that there is none."""
    if not drawn:
        return "none of the runs recorded this"
    top = max(float(np.abs(c.y).max()) for c in drawn)
    if panel.axis.log or panel.of == ("dt",):
        return ""
    if is_rounding(records, units, drawn):
        return f"zero to rounding: at most {number(top)} m"
    beyond = any(c.y.max() > limits[1] or c.y.min() < limits[0] for c in drawn)
    return f"beyond the axis: to {number(top)}" if beyond else ""


def records_of(lines: Sequence[Line]) -> list[RunRecord]:
    """Records of the lines that have a run."""
    return [k.chosen.run.record for k in lines if k.chosen.run]
