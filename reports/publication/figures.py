"""The figures of a group of runs, at the widths of a journal: energy, constraints and step alone, and together."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from textwrap import fill

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..model.curves import Curve
from ..model.limits import log_limits
from ..model.motion import Motion
from ..model.settings import shared_options
from ..plots.drawing import PAPER, plain
from ..plots.palette import dashes
from ..plots.printed.laws import laws, norm
from ..plots.printed.lines import Group, draw_lines, ended
from ..plots.printed.work import work
from .style import DOUBLE, SINGLE, sheet

WRAP = 62  # characters of a legend line in one column


@dataclass(frozen=True)
class Printed:
    """A figure to be written: ``name`` of its files, what it shows, how wide it is [in]."""

    name: str
    caption: str
    width: float
    draw: Callable[[], Figure]


@dataclass(frozen=True)
class _Panel:
    axis: str
    of: Callable[[Motion], Curve | None]
    scale: float


def figures_of(base: str, title: str, group: Group) -> list[Printed]:
    """Of the runs of one problem under one label."""
    records = [c.record for c in group.runs]
    energy = max((r.energy_scale_J for r in records if r.energy_scale_J > 0.0), default=1.0)
    length = max((r.length_scale_m for r in records if r.length_scale_m > 0.0), default=1.0)
    single = {
        "energy": ("energy error", [_Panel(r"$|E-E_0|$ [J]", norm("energy_error"), energy)]),
        "constraints": ("constraint norms", [
            _Panel(r"$\|\phi\|$ [m]", norm("phi_norm"), length),
            _Panel(r"$\|\dot\phi\|$ [m/s]", norm("phi_dot_norm"), length)]),
        "step": ("accepted steps: median, smallest and largest",
                 [_Panel(r"$\Delta t$ [s]", lambda m: m.step, group.t_end)]),
    }  # fmt: skip
    out = [
        Printed(f"{base}-{name}", f"{title}: {words}.", SINGLE, partial(_single, panels, group))
        for name, (words, panels) in single.items()
    ]
    drawn = laws(f"{base}-laws", title, group, group)
    return [*out, Printed(drawn.name, f"{title}: energy error, constraint norms and step.", DOUBLE, _wide(drawn.draw))]


def work_of(base: str, title: str, everyone: Group) -> Printed | None:
    """Error against work, all runs of a problem; None where no run has both."""
    drawn = work(f"{base}-work", title, everyone)
    if drawn is None:
        return None
    return Printed(drawn.name, f"{title}: work against error. {drawn.caption}", DOUBLE, _wide(drawn.draw))


def _wide(draw: Callable[[], Figure]) -> Callable[[], Figure]:
    """The page's figure, as wide as two columns."""

    def resized() -> Figure:
        figure = draw()
        figure.set_size_inches(DOUBLE, figure.get_size_inches()[1])
        return figure

    return resized


def _single(panels: list[_Panel], group: Group) -> Figure:
    handles = _handles(group)
    lines = sum(str(h.get_label()).count("\n") + 1 for h in handles)
    figure = sheet(SINGLE, 1.65 * len(panels) + 0.13 * lines + 0.15)
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for ax, panel in zip(axes, panels, strict=True):
        curves = [panel.of(m) for m in group.motions]
        draw_lines(ax, group, panel.of, log_limits(curves, panel.scale), log=True)
        ax.set_ylabel(panel.axis)
        seen = [c for c in curves if c is not None and len(c)]
        if seen and not any(c.y.any() for c in seen):
            ax.text(0.5, 0.5, "exactly zero throughout", transform=ax.transAxes, ha="center")
    axes[-1].set_xlabel(r"$t$ [s]")
    figure.legend(handles=handles, loc="outside lower left", ncols=1)
    return figure


def _handles(group: Group) -> list[Line2D]:
    strokes, alike = dashes(group.runs), shared_options(group.runs)
    out = []
    for m in group.motions:
        look, run = group.looks[m.run.record.solver], m.run
        words = fill(plain(f"{run.record.solver}  {run.settings(alike[run.record.solver])}{ended(m)}"), WRAP)
        out.append(Line2D([], [], color=look.colour, linestyle=strokes[run.record.run_id], marker=look.marker,
                          markersize=3.4, markerfacecolor=PAPER, markeredgewidth=0.8, label=words))  # fmt: skip
    return out
