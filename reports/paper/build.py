"""Draw the paper's figures from results: ``paper/fig01.pdf`` to ``fig12``, with notes in ``paper/captions.json``."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ...harness.base.confined_paths import ConfinedPath
from ..mechanism.segments import draw_picture
from ..model.results import StoredResults, read_results
from ..plots.fonts import DEFAULT_FONT, Font
from ..plots.paper import (
    DOUBLE,
    MUTED,
    SINGLE,
    SUFFIXES,
    Legend,
    draw_panel,
    find_note_size,
    format_label,
    save_figure,
    set_limits,
    sheet,
    strip_math,
)
from ..plots.spec import LineStyle, Plot, Trace, choose_styles
from .captions import FOLDER, Caption, make_caption, write_captions
from .catalogue import FIGURES, Panel, PaperFigure, Sketch
from .lines import PaperLine, RequestedRun, list_records, make_plot, match_runs
from .sketch import draw_sketch

COLUMNS = 12


def draw_figures(
    folder: Path,
    only: Sequence[str],
    specs: Sequence[RequestedRun],
    tell: Callable[[str], None] = lambda words: None,
    suffixes: Sequence[str] = SUFFIXES,
    font: Font = DEFAULT_FONT,
) -> list[Caption]:
    """Draw the figures of ``mbsbench figures --paper`` from the results in ``folder``; write and return their captions.

    ``only`` are names of figures, all if empty; ``specs`` are the runs of the suite ``paper``. ``tell`` is called with
    a line per figure. Raise ValueError for an unknown name.
    """
    names = [s.name for s in FIGURES]
    unknown = [name for name in only if name not in names]
    if unknown:
        raise ValueError(f"no figure {unknown[0]!r}; there are {', '.join(names)}")
    results, out = read_results(Path(folder), check_series=False), []
    for figure in (s for s in FIGURES if s.name in only or not only):
        out.append(draw_figure(results, figure, specs, suffixes, font))
        missing = sum(not c.run_id for c in out[-1].runs)
        words = f" ({missing} of {len(out[-1].runs)} runs missing)" if missing else ""
        tell(f"{figure.name}: {figure.title}{words}")
    write_captions(results.folder, results.environment, out, names)
    return out


def draw_figure(
    results: StoredResults,
    figure: PaperFigure,
    specs: Sequence[RequestedRun],
    suffixes: Sequence[str] = SUFFIXES,
    font: Font = DEFAULT_FONT,
) -> Caption:
    """Draw one figure into the results folder and return its caption."""
    lines = match_runs(figure.picks, specs, results.runs, results.readable_series)
    own = choose_styles({*results.solvers, *(k.asked.solver for k in lines)})
    files = save_figure(
        lambda: draw_panels(figure, lines, own), ConfinedPath(results.folder) / FOLDER, figure.name, suffixes, font
    )
    return make_caption(figure, lines, results.folder, [p.name for p in files])


def draw_panels(spec: PaperFigure, lines: Sequence[PaperLine], looks: Mapping[str, LineStyle]) -> Figure:
    """Draw the panels and sketches of the figure ``spec`` with one legend below; ``looks`` are line styles by solver.

    The legend names every requested run, also one that is missing.
    """
    plots = [[make_plot(p, lines) if isinstance(p, Panel) else p for p in row] for row in spec.rows]
    panels = [p for row in plots for p in row if isinstance(p, Plot)]
    named, none = list[Trace](), np.zeros(0)
    for k in lines if panels else ():
        solver = k.asked.solver if k.run else ""
        named.append(Trace(k.words, none, none, solver, "lines" if solver else "markers", k.dash))
    legend = Legend.build([*named, *(t for p in panels for t in p.traces if not t.solver)], looks, wide=True)
    figure = sheet(DOUBLE if panels else SINGLE, spec.height * len(spec.rows) + legend.height + 0.1)
    places = figure.add_gridspec(len(spec.rows), COLUMNS)
    letter = 0
    for i, row in enumerate(spec.rows):
        left, before = 0, None
        for part, plot in zip(row, plots[i], strict=True):
            continued = isinstance(part, Panel) and part.continued
            ax = figure.add_subplot(places[i, left : left + part.width], sharey=before if continued else None)
            left, before = left + part.width, ax
            if panels and not continued:
                ax.set_title(f"{chr(ord('a') + letter)}  {part.title}")
                letter += 1
            if isinstance(part, Sketch):
                picture = next(filter(None, (draw_picture(k.series) for k in lines)), None)
                if picture:
                    draw_sketch(ax, picture)
                else:
                    ax.set_axis_off()
                    words = fill(strip_math(f"{lines[0].words}{': no poses recorded' if lines[0].run else ''}"), 40)
                    ax.text(0.5, 0.5, words, transform=ax.transAxes, ha="center", va="center", color=MUTED)
            elif isinstance(plot, Plot):
                draw_panel(ax, plot, looks)
                set_limits(ax, plot)
                _label_panel(ax, part, plot, lines)
    legend.put(figure)
    return figure


def _label_panel(ax: Axes, part: Panel, plot: Plot, lines: Sequence[PaperLine]) -> None:
    """Set the panel's labels and ticks, write its caption, and shade the allowed energy if the panel has ``band``."""
    ax.set_xlabel(format_label(plot.x))
    ax.set_ylabel("" if part.continued else format_label(plot.y))
    ax.tick_params(labelleft=not part.continued)
    ax.xaxis.set_major_locator(MaxNLocator(6 if part.width > 4 else 4, steps=[1, 2, 2.5, 5, 10]))
    ax.text(0.5, 0.6, plot.caption, transform=ax.transAxes, ha="center", color=MUTED)
    if not plot.y.log:
        ax.ticklabel_format(axis="y", useOffset=False)
    if part.band:
        _shade_allowed(ax, plot, lines)
    starts = [float(t.y[0]) for t in plot.traces if t.solver]
    for words, y in zip(part.labels, starts, strict=False):  # labels stand at the lines of the first run
        ax.annotate(
            words,
            (1.0, y),
            xycoords=("axes fraction", "data"),
            xytext=(4, 0),
            va="center",
            textcoords="offset points",
            annotation_clip=False,
        )


def _shade_allowed(ax: Axes, plot: Plot, lines: Sequence[PaperLine]) -> None:
    """Shade the energies that the benchmark allows; say so in words if that is wider than the axis."""
    record = next((r for r in list_records(lines) if r.energy_allowed_J > 0.0), None)
    if record is None:
        return
    low, high = (record.energy_start_J + s * record.energy_allowed_J for s in (-1.0, 1.0))
    if low < plot.y.low and high > plot.y.high:
        words = f"allowed: within {record.energy_allowed_J:g} J of the start, beyond this axis"
        ax.text(0.02, 0.98, words, transform=ax.transAxes, va="top", color=MUTED, fontsize=find_note_size())
    else:
        ax.axhspan(max(low, plot.y.low), min(high, plot.y.high), color=MUTED, alpha=0.13, linewidth=0)
