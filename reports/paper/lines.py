"""The panels of a figure as plots: the chosen runs' series in a window, and the exact motion in ink.

A run that a figure asks for and that is not in the results stays in the list, to be named.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from ...harness.results.records import RunRecord
from ...harness.results.series import Series
from ...harness.types import StepControl
from ..model.curves import Curve, log_limits, signed_curve, upper
from ..model.results import Run, format_name, group_by
from ..model.words import number
from ..plots.laws import value_limits
from ..plots.lines import all_lines, describe_end, shared_options
from ..plots.spec import Axis, Plot, Trace, end_of
from .catalogue import FIGURES, Panel, PaperFigure, Pick

NOTHING = 1e-9  # of the problem's size: displacements below it are rounding, and give no scale
CUT = 30.0  # of the energy that the problem has to exchange, or of its size: what is beyond is cut at the edge
START = 0.01  # of the window: first steps of error-controlled solvers are tiny and do not stretch the axis
ROLES = {
    "gc_weak_form": "ODE-GC", "gc_augmented_lagrangian": "ODE-GC (AL)", "rk45_strong_form": "ODE-45",
    "ida_index1": "DAE-FI", "ndf_index1": "DAE-SE", "ida_index3": "index 3",
}  # fmt: skip
MISSING = "not in these results"
DIRECTIONS = {"a": "c_R = a/(a·a)", "translation": "c_R = (e_R, 0)", "mass": "c_R by mass"}  # Eq. (31)


class Asked(Protocol):
    """A run of the suite ``paper``; reports read no suites, the caller hands them over."""

    @property
    def problem(self) -> str: ...
    @property
    def parameters(self) -> Mapping[str, Any]: ...
    @property
    def solver(self) -> str: ...
    @property
    def options(self) -> Mapping[str, Any]: ...
    @property
    def control(self) -> StepControl: ...
    @property
    def label(self) -> str: ...
    @property
    def settings_id(self) -> str: ...
    @property
    def case(self) -> str: ...


@dataclass(frozen=True)
class Line:
    """A run asked for and the one found, with its series; None where the results have none with these settings."""

    asked: Asked
    run: Run | None
    settings: str  # step or tolerance, and in what else it differs from the figure's other runs of the solver
    series: Series | None = None
    dash: int = 0

    @property
    def role(self) -> str:
        """Whose part in the paper the solver plays: ODE-GC by the label of its record, which has the gauge."""
        role = ROLES[self.asked.solver]
        return (role.startswith("ODE-GC") and self.run and self.run.record.paper_label) or role

    @property
    def words(self) -> str:
        """The paper's name, ours, the settings, and how it ended or that the run or its series is missing."""
        words = f"{self.role} ({self.asked.solver}), {self.settings}"
        if self.run is None:
            return f"{words}: {MISSING}"
        if self.series is None and self.run.record.series:
            return f"{words}: its series cannot be read"
        return f"{words}{describe_end(self.run)}"


def choose(picks: Iterable[Pick], specs: Iterable[Asked], runs: Iterable[Run],
           read: Callable[[Run], Series | None] = lambda run: None) -> list[Line]:  # fmt: skip
    """In the order of the picks, with the series that ``read`` gives; of two runs with the same settings the later."""
    known = list(specs)
    asked = [s for p in picks for s in select_runs(p, known)]
    there = {r.record.settings_id: r for r in sorted(runs, key=lambda r: r.record.finished)}
    found = [(s, there.get(s.settings_id)) for s in asked]
    drawn = [run for _, run in found if run]
    dash = {k.run.record.run_id: k.dash for k in all_lines(drawn, shared_options(drawn))}
    series = {run.record.run_id: read(run) for run in drawn}
    lines = [(s, run, _settings(s, asked), run.record.run_id if run else "") for s, run in found]
    return [Line(s, run, words, series.get(name), dash.get(name, 0)) for s, run, words, name in lines]


def select_runs(pick: Pick, specs: Sequence[Asked]) -> list[Asked]:
    """The runs of the suite that ``pick`` means, solver by solver."""
    there = [s for s in specs if s.label == pick.label and format_name(s.problem, s.parameters) == pick.variant]
    out: list[Asked] = []
    for solver in pick.solvers:
        own = [s for s in there if s.solver == solver]
        out += own if pick.every else own and [min(own, key=lambda s: s.control.rtol or -(s.control.dt or 0.0))]
    return out


def series_magnified(
    specs: Sequence[Asked], duration: Callable[[Asked], float], figures: Iterable[PaperFigure] = FIGURES
) -> dict[str, set[str]]:
    """The series of each run, by its settings_id, of which a panel draws less than half of the ``duration`` [s].

    Of a whole run the envelope of its series is as good as every step, of a small part of it there are too few spans.
    """
    out: dict[str, set[str]] = {}
    for figure in figures:
        panels = [p for p in figure.panels() if isinstance(p, Panel)]
        for spec in (s for pick in figure.picks for s in select_runs(pick, specs)):
            part = [p for p in panels if p.window[1] - p.window[0] < 0.5 * duration(spec)]
            out.setdefault(spec.settings_id, set()).update(name for p in part for name in (*p.of, p.exact) if name)
    return out


def _settings(asked: Asked, others: Sequence[Asked]) -> str:
    c = asked.control
    own = [asked, *(s for s in others if s.solver == asked.solver)]
    words = zip(*((s.label, DIRECTIONS[s.options.get("direction", "a")]) for s in own), strict=True)
    differs = [of[0] for of in words if len(set(of)) > 1]
    return ", ".join([f"dt = {c.dt:g} s" if c.dt is not None else f"rtol = {c.rtol:g}", *differs])


def select_lines(panel: Panel, lines: Sequence[Line]) -> list[Line]:
    """Those that the panel asks for."""
    if not panel.tightest:
        return list(lines)
    asked = group_by((k.asked for k in lines), lambda a: a.solver)
    least = {solver: min(a.control.rtol or 0.0 for a in own) for solver, own in asked.items()}
    return [k for k in lines if (k.asked.control.rtol or 0.0) == least[k.asked.solver]]


def plot_of(panel: Panel, lines: Sequence[Line]) -> Plot:
    """All of it but its letter; the caption says what a line does not show by itself."""
    found = [(k, curve(k, name, panel)) for k in select_lines(panel, lines) for name in panel.of]
    made = [(k, c) for k, c in found if c is not None and len(c)]
    drawn, exact, known = [c for _, c in made], exact_of(panel, lines), records_of(lines)
    units = {k.series.units.get(name, "") for k in lines if k.series is not None for name in panel.of}
    low, high = limits_of(panel, known, units, drawn, exact)
    traces = []
    for k, c in made:
        run = k.run
        inside = run and run.record.t_reached_s <= panel.window[1] * (1.0 + 1e-9)
        end = end_of(run.status) if run and inside and (run.has_stopped or len(panel.of) == 1) else ""
        solver = k.asked.solver
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
    t, a = line.series.points(name)
    if name == "dt" and line.run is not None and not line.run.has_stopped and len(t) > 2:
        t, a = t[:-1], a[:-1]  # the last step may be cut to end at t_end; of a failure it is the point
    return within(t, a, panel.window, largest=panel.axis.log and name != "dt")


def within(t: np.ndarray, a: np.ndarray, window: tuple[float, float], *, largest: bool = False) -> Curve:
    """Rows of the window, and one beyond each edge, as far as it goes; with ``largest`` the peaks of |a| alone."""
    first = max(int(np.searchsorted(t, window[0])) - 1, 0)
    last = int(np.searchsorted(t, window[1], side="right")) + 1
    kind = upper if largest else signed_curve
    cut = kind(t[first:last] - window[0], a[first:last], window[1] - window[0])
    return Curve(cut.t + window[0], cut.y)


def exact_of(panel: Panel, lines: Sequence[Line]) -> Curve | None:
    """The reference's series from the line that has it to the latest time."""
    of = [k.series for k in select_lines(panel, lines) if k.series is not None]
    found = [s for s in of if panel.exact and panel.exact in s]
    drawn = [s.points(panel.exact) for s in found]
    longest = max(drawn, key=lambda p: np.max(p[0], where=np.isfinite(p[1]), initial=-np.inf), default=None)
    return None if longest is None else within(*longest, panel.window)


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
    return [k.run.record for k in lines if k.run]


def limits_of(panel: Panel, records: Sequence[RunRecord], units: set[str], drawn: Sequence[Curve],
              exact: Curve | None) -> tuple[float, float]:  # fmt: skip
    """Lowest and highest value shown: of all that was recorded, unless one line would hide the others."""
    size = _largest(records, "length_scale_m", 1.0)
    if not drawn:
        return (1e-3, 1.0) if panel.axis.log else (0.0, 1.0)
    if panel.of == ("dt",):
        return _step_limits(panel, drawn)
    if panel.axis.log:
        return log_limits(drawn, size)
    if is_rounding(records, units, drawn):
        return -1e-3 * size, 1e-3 * size
    reach = size if units == {"m"} else np.inf
    if panel.of == ("energy",):
        reach = _largest(records, "energy_scale_J", np.inf)
    return value_limits(drawn, exact, CUT * reach)


def is_rounding(records: Sequence[RunRecord], units: set[str], drawn: Sequence[Curve]) -> bool:
    """A length that stays zero but for rounding."""
    top = max(float(np.abs(c.y).max()) for c in drawn)
    return units == {"m"} and top < NOTHING * _largest(records, "length_scale_m", 1.0)


def _step_limits(panel: Panel, drawn: Sequence[Curve]) -> tuple[float, float]:
    """Every step but the first ones; the last of each line always, which of a failure is the point."""
    late = panel.window[0] + START * (panel.window[1] - panel.window[0])
    kept = np.concatenate([np.append(c.y[c.t > late], c.y[-1]) for c in drawn if len(c)])
    kept = kept[kept > 0.0]
    return (0.6 * float(kept.min()), 1.8 * float(kept.max())) if len(kept) else (1e-3, 1.0)


def _largest(records: Sequence[RunRecord], column: str, default: float) -> float:
    return max((v for r in records if (v := getattr(r, column)) > 0.0), default=default)
