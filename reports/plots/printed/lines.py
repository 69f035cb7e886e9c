"""Lines of many runs in one panel: colour and marker by solver, dash by settings, a star where a run stopped."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from ...model.curves import Curve
from ...model.limits import log_limits as log_limits
from ...model.motion import Motion
from ...model.results import Run
from ...model.settings import shared_options
from ...model.words import time
from ..drawing import INK, PAPER, log_axis, plain
from ..palette import Look, dashes


@dataclass(frozen=True)
class Group:
    """The motions drawn together, with their looks."""

    motions: tuple[Motion, ...]
    looks: Mapping[str, Look]

    @property
    def runs(self) -> list[Run]:
        return [m.run for m in self.motions]

    @property
    def t_end(self) -> float:
        return max((c.record.t_end_s for c in self.runs if c.record.t_end_s == c.record.t_end_s), default=1.0)


def draw_lines(
    ax: Axes, group: Group, of: Callable[[Motion], Curve | None], limits: tuple[float, float], *, log: bool
) -> None:
    """One line a motion, markers apart from each other, and how it ended at its end."""
    strokes = dashes(group.runs)
    if log:
        log_axis(ax)
    for k, m in enumerate(group.motions):
        curve = of(m)
        if curve is None or len(curve) == 0:
            continue
        look = group.looks[m.run.record.solver]
        y = np.clip(curve.y, *limits) if log else curve.y
        if curve.low is not None and curve.high is not None:
            ax.fill_between(curve.t, np.clip(curve.low, *limits), np.clip(curve.high, *limits), color=look.colour,
                            alpha=0.16, linewidth=0)  # fmt: skip
        gap = max(len(y) // 5, 1)
        every = (min((k * gap) // max(len(group.motions), 1), len(y) - 1), gap)
        ax.plot(curve.t, y, color=look.colour, linestyle=strokes[m.run.record.run_id], marker=look.marker,
                markevery=every, markersize=3.6, markerfacecolor=PAPER, markeredgewidth=0.9, zorder=3)  # fmt: skip
        draw_end(ax, m.run, curve.t[-1], float(np.clip(y[-1], *limits)), look)
    ax.set_xlim(0.0, 1.03 * group.t_end)
    ax.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 2.5, 5, 10]))
    ax.set_ylim(*limits)


def draw_end(ax: Axes, run: Run, x: float, y: float, look: Look) -> None:
    """A star where a run stopped early, a cross where one ended wrong."""
    if run.stopped:
        ax.plot([x], [y], "*", color=look.colour, markersize=10, markeredgecolor=INK, markeredgewidth=0.6, zorder=6,
                clip_on=False, gid=f"star-{run.record.run_id}")  # fmt: skip
    elif not run.succeeded:
        ax.plot([x], [y], "X", color=look.colour, markersize=6.5, markeredgecolor=INK, markeredgewidth=0.6, zorder=6,
                clip_on=False, gid=f"cross-{run.record.run_id}")  # fmt: skip


@dataclass(frozen=True)
class Legend:
    """One for all panels of a figure, below them; a run that made no step is named here, with why."""

    handles: tuple[Line2D, ...]

    @property
    def columns(self) -> int:
        longest = max((len(str(h.get_label())) for h in self.handles), default=0)
        return 3 if longest <= 32 else 2 if longest <= 54 else 1

    @property
    def height(self) -> float:
        """[in] that it takes."""
        lines = sum(1 + str(h.get_label()).count("\n") for h in self.handles)
        return 0.12 + 0.165 * -(-lines // self.columns)

    def put(self, figure: Figure) -> None:
        if self.handles:
            figure.legend(handles=list(self.handles), loc="outside lower left", ncols=self.columns)


def legend_of(group: Group, extra: Sequence[Line2D] = ()) -> Legend:
    """The group's runs with the settings in which they differ, and how they ended."""
    strokes, alike = dashes(group.runs), shared_options(group.runs)
    handles = []
    for m in group.motions:
        look, run = group.looks[m.run.record.solver], m.run
        words = plain(f"{run.record.solver}  {run.settings(alike[run.record.solver])}{ended(m)}")
        handles.append(
            Line2D(
                [],
                [],
                color=look.colour,
                linestyle=strokes[run.record.run_id],
                marker=look.marker,
                label=fill(words, 96),
                markerfacecolor=PAPER,
                markeredgewidth=0.9,
            )
        )
    return Legend((*handles, *extra))


def ended(m: Motion) -> str:
    """How it ended, for the legend; empty for a success."""
    run, r = m.run, m.run.record
    if run.succeeded:
        return ""
    word = run.status.replace("_", " ")
    if not m.moved:
        return f"  ★ no step: {word}"
    return f"  ★ {word} at {time(r.t_reached_s)} s" if run.stopped else f"  ✖ {word}"
