"""Work against error: CPU time, which is this machine's, and evaluations, which are not."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ...model.accuracy import Measure, measure_for
from ...model.results import Run
from ..drawing import INK, MUTED, PAPER, Drawn, log_axis, new_figure, panel_title, plain
from .lines import Group, Legend, draw_end

LINES = ("-", (0, (4, 1.8)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)))  # by label
DECADE = 10.0


@dataclass(frozen=True)
class Axis:
    """A quantity of a run."""

    words: str
    of: Callable[[Run], float]


def work(name: str, title: str, everyone: Group) -> Drawn | None:
    """All runs of a problem; None when none has both work and an error."""
    measure = measure_for(everyone.runs)
    costs = [Axis("CPU time [s]", lambda c: c.record.cpu_median_s), Axis("evaluations", lambda c: c.record.evaluations)]
    errors = [Axis("largest energy error [J]", lambda c: c.record.energy_drift_max_J)]
    if measure is not None:
        errors.insert(0, Axis(f"largest {measure.what} [{measure.unit}]", measure.of))
    if not any(math.isfinite(e.of(c)) and math.isfinite(x.of(c)) for c in everyone.runs for e in errors for x in costs):
        return None
    caption = (
        "Lower and further left is better. Lines join the steps or tolerances of the same settings; a run that "
        "stopped early (star) has the error up to there and is not comparable. Bars: spread of repeated timings. "
        "Zeros lie on the dotted line."
    )
    return Drawn(name, title, caption, lambda: _draw(everyone, costs, errors, measure))


def _draw(everyone: Group, costs: list[Axis], errors: list[Axis], measure: Measure | None) -> Figure:
    solvers = sorted({c.record.solver for c in everyone.runs})
    labels = list(dict.fromkeys(c.record.label for c in everyone.runs))
    legend = _legend(everyone, solvers, labels)
    figure = new_figure(2.3 * len(errors) + 0.3 + legend.height)
    axes = figure.subplots(len(errors), 2, sharex="col", sharey="row", squeeze=False)
    for row, error in enumerate(errors):
        for column, cost in enumerate(costs):
            ax = axes[row, column]
            _panel(ax, everyone, cost, error, labels)
            if row == 0 and measure is not None and measure.own > ax.get_ylim()[0]:
                ax.axhspan(ax.get_ylim()[0], measure.own, color=MUTED, alpha=0.18, linewidth=0)
            what = error.words.split(" [")[0].removeprefix("largest ").capitalize()
            panel_title(ax, 2 * row + column, f"{what} over {cost.words.split(' [')[0]}")
            if column == 0:
                ax.set_ylabel(error.words)
            if row == len(errors) - 1:
                ax.set_xlabel(cost.words)
    legend.put(figure)
    return figure


def _legend(everyone: Group, solvers: list[str], labels: list[str]) -> Legend:
    handles = [
        Line2D([], [], color=everyone.looks[s].colour, marker=everyone.looks[s].marker, linestyle="", label=plain(s))
        for s in solvers
    ]
    handles += [
        Line2D(
            [],
            [],
            color=MUTED,
            linestyle=LINES[k % len(LINES)],
            marker="o",
            label=plain(label or "no label"),
            markerfacecolor=MUTED if k == 0 else PAPER,
        )
        for k, label in enumerate(labels)
    ]
    ends = {"*": any(c.stopped for c in everyone.runs), "X": any(c.status == "wrong" for c in everyone.runs)}
    words = {"*": "stopped early", "X": "wrong, though it claims success"}
    handles += [
        Line2D(
            [],
            [],
            color=PAPER,
            marker=k,
            linestyle="",
            label=words[k],
            markersize=8 if k == "*" else 6,
            markeredgecolor=INK,
        )
        for k, there in ends.items()
        if there
    ]
    return Legend(tuple(handles))


def _panel(ax: Axes, everyone: Group, cost: Axis, error: Axis, labels: list[str]) -> None:
    points = [(c, cost.of(c), error.of(c)) for c in everyone.runs]
    points = [(c, x, y) for c, x, y in points if math.isfinite(x) and math.isfinite(y)]
    left = _lower([x for _, x, _ in points])
    low = _lower([y for _, _, y in points])
    families: dict[tuple[str, str], list[tuple[Run, float, float]]] = {}
    for c, x, y in points:
        families.setdefault((c.method, c.record.label), []).append((c, max(x, left), max(y, low)))
    for (_, label), own in families.items():
        look = everyone.looks[own[0][0].record.solver]
        k = labels.index(label)
        whole = [p for p in own if not p[0].stopped]
        ax.plot(
            [x for _, x, _ in whole],
            [y for _, _, y in whole],
            color=look.colour,
            linestyle=LINES[k % len(LINES)],
            linewidth=0.9,
            zorder=2,
        )
        for c, x, y in own:
            if "CPU" in cost.words and c.record.repeats > 1 and c.record.cpu_max_s > c.record.cpu_min_s:
                ax.plot([max(c.record.cpu_min_s, left), c.record.cpu_max_s], [y, y], color=look.colour, linewidth=2.2,
                        alpha=0.45, solid_capstyle="butt", zorder=2)  # fmt: skip
            if c.stopped or c.status == "wrong":
                draw_end(ax, c, x, y, look)
            else:
                ax.plot([x], [y], look.marker, color=look.colour, markersize=5, zorder=4,
                        markerfacecolor=look.colour if k == 0 else PAPER)  # fmt: skip
    log_axis(ax)
    log_axis(ax, "x")
    ax.margins(0.12)
    heights = {max(y, low) for _, _, y in points}
    if len(heights) == 1:  # all alike, e.g. exactly zero: a range has to come from somewhere
        (only,) = heights
        ax.set_ylim(only / DECADE, only * DECADE)
    if any(y == 0.0 for _, _, y in points):
        ax.axhline(low, color=MUTED, linewidth=0.8, linestyle=(0, (1, 2)), zorder=1)
        ax.annotate("exactly 0", (0.01, low), xycoords=("axes fraction", "data"), xytext=(0, 3),
                    textcoords="offset points", color=MUTED, fontsize=7)  # fmt: skip


def _lower(values: list[float]) -> float:
    """Where zeros are put: well below the smallest value above zero."""
    above = [v for v in values if v > 0.0]
    return min(above) / 20.0 if above else 1e-16
