"""The lines of a panel: each chosen run's series in its window, a star where it stopped, the exact motion in ink."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from ...harness.results.records import RunRecord
from ...harness.results.series import Series
from ..model import curves
from ..model.curves import Curve
from ..model.words import number
from ..plots.palette import DASHES, Look, dashes
from ..plots.spec import end_of
from ..plots.style import INK, MUTED, PAPER, log_axis, mark_end
from .limits import is_rounding, limits_of
from .picking import Chosen
from .spec import Panel


@dataclass(frozen=True)
class Line:
    """A run that a figure draws, with its series and how it looks."""

    chosen: Chosen
    series: Series | None
    look: Look
    dash: tuple[float, Sequence[float]]


def lines_of(chosen: Sequence[Chosen], series: Mapping[str, Series | None], looks: Mapping[str, Look]) -> list[Line]:
    """In the order of the picks; ``series`` by run, ``looks`` by solver."""
    strokes = dashes(c.run for c in chosen if c.run)
    out = []
    for c in chosen:
        run = c.run.record.run_id if c.run else ""
        out.append(Line(c, series.get(run), looks[c.asked.solver], strokes.get(run, DASHES[0])))
    return out


def shown(panel: Panel, lines: Sequence[Line]) -> list[Line]:
    """Those that the panel asks for."""
    if not panel.tightest:
        return list(lines)
    least: dict[str, float] = {}
    for k in lines:
        solver, rtol = k.chosen.asked.solver, k.chosen.asked.control.rtol or 0.0
        least[solver] = min(rtol, least.get(solver, rtol))
    return [k for k in lines if (k.chosen.asked.control.rtol or 0.0) == least[k.chosen.asked.solver]]


def draw_panel(ax: Axes, panel: Panel, lines: Sequence[Line]) -> None:
    """All of it but its letter."""
    made = [(k, name, curve(k, name, panel)) for k in shown(panel, lines) for name in panel.of]
    drawn = [(k, name, c) for k, name, c in made if c is not None and len(c)]
    exact = exact_of(panel, lines)
    if not drawn:
        ax.text(0.5, 0.5, "none of the runs recorded this", transform=ax.transAxes, ha="center", color=MUTED)
    limits = limits_of(panel, records_of(lines), units_of(panel, lines), [c for *_, c in drawn], exact)
    if panel.log:
        log_axis(ax)
    for n, (k, _, c) in enumerate(drawn):
        y = np.clip(c.y, *limits)
        gap = max(len(y) // 4, 1)
        every = ((n * gap) // len(drawn), gap)
        ax.plot(c.t, y, color=k.look.colour, linestyle=k.dash, marker=k.look.marker if len(y) > 4 else "",
                markevery=every, markersize=3.2, markerfacecolor=PAPER, markeredgewidth=0.8, zorder=3)  # fmt: skip
        run = k.chosen.run
        ends = run is not None and run.record.t_reached_s <= panel.window[1] * (1.0 + 1e-9)
        if run is not None and ends and (run.stopped or len(panel.of) == 1):
            mark_end(ax, end_of(run.status), c.t[-1], float(y[-1]), k.look.colour, run.record.run_id)
    if exact is not None:
        ax.plot(exact.t, np.clip(exact.y, *limits), color=INK, linewidth=0.55, zorder=5)
    _remarks(ax, panel, lines, limits, [c for *_, c in drawn])
    _frame(ax, panel, lines, limits, drawn)


def curve(line: Line, name: str, panel: Panel) -> Curve | None:
    """A series in the panel's window, made small with its peaks kept; magnitudes on a logarithmic axis."""
    if line.series is None or name not in line.series:
        return None
    t, a = line.series["t"], line.series[name]
    if name == "dt" and line.chosen.run is not None and not line.chosen.run.stopped and len(t) > 2:
        t, a = t[:-1], a[:-1]  # the last step may be cut to end at t_end; of a failure it is the point
    return within(t, a, panel.window, largest=panel.log and name != "dt")


def within(t: np.ndarray, a: np.ndarray, window: tuple[float, float], *, largest: bool = False) -> Curve:
    """Rows of the window, and one beyond each edge, as far as it goes; with ``largest`` the peaks of |a| alone."""
    first = max(int(np.searchsorted(t, window[0])) - 1, 0)
    last = int(np.searchsorted(t, window[1], side="right")) + 1
    kind = curves.upper if largest else curves.signed
    cut = kind(t[first:last] - window[0], a[first:last], window[1] - window[0])
    return Curve(cut.t + window[0], cut.y)


def exact_of(panel: Panel, lines: Sequence[Line]) -> Curve | None:
    """The reference's series from the line that has most of it."""
    found = [k.series for k in shown(panel, lines) if panel.exact and k.series is not None and panel.exact in k.series]
    longest = max(found, key=lambda s: np.count_nonzero(np.isfinite(s[panel.exact])), default=None)
    return None if longest is None else within(longest["t"], longest[panel.exact], panel.window)


def _remarks(
    ax: Axes, panel: Panel, lines: Sequence[Line], limits: tuple[float, float], drawn: Sequence[Curve]
) -> None:
    """What a line does not show by itself: zero, rounding, values beyond the axis."""
    if not drawn or panel.of == ("dt",):
        return
    words, top = "", max(float(np.abs(c.y).max()) for c in drawn)
    if panel.log and not top:
        words = "exactly zero throughout"
    elif not panel.log and is_rounding(panel, records_of(lines), units_of(panel, lines), drawn):
        words = f"zero to rounding: at most {number(top)} m"
    elif not panel.log and any(c.y.max() > limits[1] or c.y.min() < limits[0] for c in drawn):
        words = f"beyond the axis: to {number(top)}"
    ax.text(0.5, 0.6, words, transform=ax.transAxes, ha="center", color=MUTED)


def records_of(lines: Sequence[Line]) -> list[RunRecord]:
    """Of the lines that have a run."""
    return [k.chosen.run.record for k in lines if k.chosen.run]


def units_of(panel: Panel, lines: Sequence[Line]) -> set[str]:
    """Of the panel's series, as the files say."""
    return {k.series.units.get(name, "") for k in lines if k.series is not None for name in panel.of}


def _frame(ax: Axes, panel: Panel, lines: Sequence[Line], limits: tuple[float, float], drawn: Sequence) -> None:
    if panel.band:
        _band(ax, lines, limits)
    ax.set_xlim(panel.window[0], panel.window[1] + 0.015 * (panel.window[1] - panel.window[0]))
    ax.xaxis.set_major_locator(MaxNLocator(6 if panel.width > 4 else 4, steps=[1, 2, 2.5, 5, 10]))
    ax.set_ylim(*limits)
    if not panel.log:
        ax.ticklabel_format(axis="y", useOffset=False)
    ax.set_ylabel("" if panel.continued else panel.axis)
    if panel.continued:
        ax.tick_params(labelleft=False)
    for name, label in zip(panel.of, panel.labels, strict=False):
        first = next((c for _, n, c in drawn if n == name), None)
        if first is not None:
            ax.annotate(label, (1.0, first.y[0]), xycoords=("axes fraction", "data"), xytext=(4, 0), va="center",
                        textcoords="offset points", annotation_clip=False)  # fmt: skip


def _band(ax: Axes, lines: Sequence[Line], limits: tuple[float, float]) -> None:
    """The allowed energy, shaded; in words where it is wider than the axis."""
    known = (k.chosen.run.record for k in lines if k.chosen.run)
    record = next((r for r in known if r.energy_allowed_J > 0.0), None)
    if record is None:
        return
    low, high = (record.energy_start_J + s * record.energy_allowed_J for s in (-1.0, 1.0))
    if low < limits[0] and high > limits[1]:
        words = f"allowed: within {record.energy_allowed_J:g} J of the start, beyond this axis"
        ax.text(0.02, 0.98, words, transform=ax.transAxes, va="top", color=MUTED, fontsize=7)
    else:
        ax.axhspan(max(low, limits[0]), min(high, limits[1]), color=MUTED, alpha=0.13, linewidth=0)
