"""Turn the panels of a figure into plots: the chosen runs' series in a window, and the exact motion in black.

A requested run that is not in the results stays in the list, to be named.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from ...harness.mechanics.types import StepControl
from ...harness.results.records import RunRecord
from ...harness.results.series import Series
from ..model.curves import Curve, find_extrema, find_log_limits, find_maxima
from ..model.results import StoredRun, format_name, group_by
from ..model.words import number
from ..plots.laws import find_value_limits
from ..plots.lines import describe_end, find_shared_options, make_lines
from ..plots.spec import Axis, Plot, Trace, choose_end_mark
from .catalogue import FIGURES, Panel, PaperFigure, RunSelection

NOTHING = 1e-9  # fraction of the problem's size: smaller displacements are rounding
CUT = 30.0  # axis limit, in units of the exchangeable energy or of the problem's size
START = 0.01  # first fraction of the window, whose tiny steps (error control) do not extend the axis
ROLES = {
    "gc_weak_form": "ODE-GC",
    "gc_augmented_lagrangian": "ODE-GC (AL)",
    "rk45_strong_form": "ODE-45",
    "ida_index1": "DAE-FI",
    "ndf_index1": "DAE-SE",
    "ida_index3": "index 3",
}
MISSING = "not in these results"
DIRECTIONS = {"a": "c_R = a/(a·a)", "translation": "c_R = (e_R, 0)", "mass": "c_R by mass"}  # Eq. (31)


class RequestedRun(Protocol):
    """A run of the suite ``paper``, provided by the caller, since reports do not read suites."""

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
class PaperLine:
    """A requested run and the one found, with its series; None if the results have none with these settings."""

    asked: RequestedRun
    run: StoredRun | None
    settings: str  # step or tolerance, and other differences from the figure's runs of the solver
    series: Series | None = None
    dash: int = 0

    @property
    def role(self) -> str:
        """The solver's name in the paper, with the gauge for ODE-GC as the record's label has it."""
        role = ROLES[self.asked.solver]
        return (role.startswith("ODE-GC") and self.run and self.run.record.paper_label) or role

    @property
    def words(self) -> str:
        """The paper's name, ours, the settings, and how the run ended or that it or its series is missing."""
        words = f"{self.role} ({self.asked.solver}), {self.settings}"
        if self.run is None:
            return f"{words}: {MISSING}"
        if self.series is None and self.run.record.series:
            return f"{words}: its series cannot be read"
        return f"{words}{describe_end(self.run)}"


def match_runs(
    picks: Iterable[RunSelection],
    specs: Iterable[RequestedRun],
    runs: Iterable[StoredRun],
    read: Callable[[StoredRun], Series | None] = lambda run: None,
) -> list[PaperLine]:
    """Return a line per requested run in the order of the picks, also for a run that is not in the results.

    ``specs`` are the runs of the suite, ``runs`` those in the results, of which the latest with the same settings is
    used; ``read`` returns the series of a run.
    """
    known = list(specs)
    asked = [s for p in picks for s in select_runs(p, known)]
    latest = {r.record.settings_id: r for r in sorted(runs, key=lambda r: r.record.finished)}
    found = [(s, latest.get(s.settings_id)) for s in asked]
    drawn = [run for _, run in found if run]
    dash = {k.run.record.run_id: k.dash for k in make_lines(drawn, find_shared_options(drawn))}
    series = {run.record.run_id: read(run) for run in drawn}
    lines = [(s, run, _describe_settings(s, asked), run.record.run_id if run else "") for s, run in found]
    return [PaperLine(s, run, words, series.get(name), dash.get(name, 0)) for s, run, words, name in lines]


def select_runs(pick: RunSelection, specs: Sequence[RequestedRun]) -> list[RequestedRun]:
    """Return the runs of the suite with the label and variant of ``pick``, for each of its solvers in turn.

    With ``pick.every`` they are all runs of a solver, else one: that with the smallest tolerance or, for fixed steps,
    with the largest step, which the paper prints.
    """
    candidates = [s for s in specs if s.label == pick.label and format_name(s.problem, s.parameters) == pick.variant]
    out: list[RequestedRun] = []
    for solver in pick.solvers:
        own = [s for s in candidates if s.solver == solver]
        if own and not pick.every:
            # a run has either a tolerance or a step, whose sign is turned: the least is the largest step
            own = [min(own, key=lambda s: s.control.rtol or -(s.control.dt or 0.0))]
        out += own
    return out


def find_magnified_series(
    specs: Sequence[RequestedRun],
    duration: Callable[[str, Mapping[str, Any]], float],
    figures: Iterable[PaperFigure] = FIGURES,
) -> dict[str, set[str]]:
    """Return by settings_id the names of the series of which a panel of ``figures`` draws less than half.

    The stored envelope of a series suffices to draw a whole run, but has too few spans for a small part of it.
    ``specs`` are the runs of the suite; ``duration`` returns the simulated time of a run [s] from its problem and the
    problem's parameters.
    """
    out: dict[str, set[str]] = {}
    for figure in figures:
        panels = [p for p in figure.panels() if isinstance(p, Panel)]
        for spec in (s for pick in figure.picks for s in select_runs(pick, specs)):
            part = [p for p in panels if p.window[1] - p.window[0] < 0.5 * duration(spec.problem, spec.parameters)]
            out.setdefault(spec.settings_id, set()).update(name for p in part for name in (*p.of, p.exact) if name)
    return out


def _describe_settings(asked: RequestedRun, others: Sequence[RequestedRun]) -> str:
    """Describe a run's step or tolerance, with its label and direction c_R if ``others`` of its solver have others."""
    c = asked.control
    own = [asked, *(s for s in others if s.solver == asked.solver)]
    words = zip(*((s.label, DIRECTIONS[s.options.get("direction", "a")]) for s in own), strict=True)
    differing = [column[0] for column in words if len(set(column)) > 1]
    return ", ".join([f"dt = {c.dt:g} s" if c.dt is not None else f"rtol = {c.rtol:g}", *differing])


def select_lines(panel: Panel, lines: Sequence[PaperLine]) -> list[PaperLine]:
    """Return the lines of a panel: all, or if it is ``tightest`` only those of each solver's smallest tolerance."""
    if not panel.tightest:
        return list(lines)
    asked = group_by((k.asked for k in lines), lambda a: a.solver)
    least = {solver: min(a.control.rtol or 0.0 for a in own) for solver, own in asked.items()}
    return [k for k in lines if (k.asked.control.rtol or 0.0) == least[k.asked.solver]]


def make_plot(panel: Panel, lines: Sequence[PaperLine]) -> Plot:
    """Return the plot of a panel without its letter; its caption notes values that the lines do not show."""
    found = [(k, make_curve(k, name, panel)) for k in select_lines(panel, lines) for name in panel.of]
    made = [(k, c) for k, c in found if c is not None and len(c)]
    drawn, exact, known = [c for _, c in made], choose_exact(panel, lines), list_records(lines)
    units = {k.series.units.get(name, "") for k in lines if k.series is not None for name in panel.of}
    low, high = find_limits(panel, known, units, drawn, exact)
    traces = []
    for k, c in made:
        run = k.run
        inside = run and run.record.t_reached_s <= panel.window[1] * (1.0 + 1e-9)
        end = choose_end_mark(run.status) if run and inside and (run.has_stopped or len(panel.of) == 1) else ""
        solver = k.asked.solver
        traces.append(Trace(k.words, c.t, np.clip(c.y, low, high), solver=solver, dash=k.dash, end=end))
    if exact is not None:
        traces.append(Trace("exact motion", exact.t, np.clip(exact.y, low, high)))
    room = 0.015 * (panel.window[1] - panel.window[0])
    time = Axis("t", "s", low=panel.window[0], high=panel.window[1] + room, symbol="t")
    words = _describe_hidden(panel, drawn, (low, high), known, units)
    return Plot(panel.title, panel.title, words, time, replace(panel.axis, low=low, high=high), traces)


def make_curve(line: PaperLine, name: str, panel: Panel) -> Curve | None:
    """Return a line's series ``name`` in the panel's window, reduced with its peaks kept; None if not recorded.

    For a logarithmic axis the values are magnitudes.
    """
    if line.series is None or name not in line.series:
        return None
    t, a = line.series.points(name)
    if name == "dt" and line.run is not None and not line.run.has_stopped and len(t) > 2:
        t, a = t[:-1], a[:-1]  # the last step may be cut to end at t_end; for a failure it matters
    return clip_points(t, a, panel.window, largest=panel.axis.log and name != "dt")


def clip_points(t: np.ndarray, a: np.ndarray, window: tuple[float, float], *, largest: bool = False) -> Curve:
    """Return a curve of few points in the window [s] and one beyond each edge.

    It passes through the smallest and largest values of equal spans of time, or with ``largest`` the largest |a|.
    """
    first = max(int(np.searchsorted(t, window[0])) - 1, 0)
    last = int(np.searchsorted(t, window[1], side="right")) + 1
    kind = find_maxima if largest else find_extrema
    cut = kind(t[first:last] - window[0], a[first:last], window[1] - window[0])
    return Curve(cut.t + window[0], cut.y)


def choose_exact(panel: Panel, lines: Sequence[PaperLine]) -> Curve | None:
    """Return the reference's series from the line in which it is known for the longest time; None if none has it."""
    of = [k.series for k in select_lines(panel, lines) if k.series is not None]
    found = [s for s in of if panel.exact and panel.exact in s]
    drawn = [s.points(panel.exact) for s in found]
    longest = max(drawn, key=lambda p: np.max(p[0], where=np.isfinite(p[1]), initial=-np.inf), default=None)
    return None if longest is None else clip_points(*longest, panel.window)


def _describe_hidden(
    panel: Panel, drawn: Sequence[Curve], limits: tuple[float, float], records: Sequence[RunRecord], units: set[str]
) -> str:
    """Describe what the lines do not show: rounding, values beyond the axis, or an unrecorded quantity."""
    if not drawn:
        return "none of the runs recorded this"
    top = max(float(np.abs(c.y).max()) for c in drawn)
    if panel.axis.log or panel.of == ("dt",):
        return ""
    if is_rounding(records, units, drawn):
        return f"zero to rounding: at most {number(top)} m"
    beyond = any(c.y.max() > limits[1] or c.y.min() < limits[0] for c in drawn)
    return f"beyond the axis: to {number(top)}" if beyond else ""


def list_records(lines: Sequence[PaperLine]) -> list[RunRecord]:
    """Return the records of the lines that have a run."""
    return [k.run.record for k in lines if k.run]


def find_limits(
    panel: Panel, records: Sequence[RunRecord], units: set[str], drawn: Sequence[Curve], exact: Curve | None
) -> tuple[float, float]:
    """Return the limits of a panel's axis of values: the range of the ``drawn`` curves and the ``exact`` one.

    Steps, logarithmic axes and lengths that stay zero have limits of their own. Curves that diverge are cut near the
    exact one or, without it, ``CUT`` times the problem's size (lengths) or energy scale from their start.
    """
    size = _find_largest(records, "length_scale_m", 1.0)
    if not drawn:
        return (1e-3, 1.0) if panel.axis.log else (0.0, 1.0)
    if panel.of == ("dt",):
        return _find_step_limits(panel, drawn)
    if panel.axis.log:
        return find_log_limits(drawn, size)
    if is_rounding(records, units, drawn):
        return -1e-3 * size, 1e-3 * size
    reach = size if units == {"m"} else np.inf
    if panel.of == ("energy",):
        reach = _find_largest(records, "energy_scale_J", np.inf)
    return find_value_limits(drawn, exact, CUT * reach)


def is_rounding(records: Sequence[RunRecord], units: set[str], drawn: Sequence[Curve]) -> bool:
    """Return whether the curves are of a length that stays zero to rounding."""
    top = max(float(np.abs(c.y).max()) for c in drawn)
    return units == {"m"} and top < NOTHING * _find_largest(records, "length_scale_m", 1.0)


def _find_step_limits(panel: Panel, drawn: Sequence[Curve]) -> tuple[float, float]:
    """Return limits [s] for all step sizes but those of the first ``START`` of the window.

    The last step of each line is included: in a failure it is of interest.
    """
    late = panel.window[0] + START * (panel.window[1] - panel.window[0])
    kept = np.concatenate([np.append(c.y[c.t > late], c.y[-1]) for c in drawn if len(c)])
    kept = kept[kept > 0.0]
    return (0.6 * float(kept.min()), 1.8 * float(kept.max())) if len(kept) else (1e-3, 1.0)


def _find_largest(records: Sequence[RunRecord], column: str, default: float) -> float:
    """Return the largest positive value of a column of the records, else ``default``."""
    return max((v for r in records if (v := getattr(r, column)) > 0.0), default=default)
