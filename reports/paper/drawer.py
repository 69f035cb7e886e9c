"""Any figure of the catalogue on a sheet: panels lettered as in the paper, one legend, missing runs named in it."""

from collections.abc import Sequence
from textwrap import fill

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..model.words import time
from ..plots.style import DOUBLE, INK, MUTED, PAPER, SINGLE, plain, sheet
from .lines import Line, draw_panel, shown
from .sketch import draw_sketch
from .spec import Panel, PaperFigure, Sketch

COLUMNS = 12
MISSING = "not in these results"
WRAP = 64  # characters of a label: two columns of them fill the sheet


def draw(spec: PaperFigure, lines: Sequence[Line]) -> Figure:
    """``spec`` with its runs."""
    alone = all(isinstance(p, Sketch) for p in spec.panels())
    handles = [] if alone else _handles(spec, lines)
    columns = legend_columns(handles)
    deep = [str(h.get_label()).count("\n") + 1 for h in handles]
    each = -(-len(deep) // columns)  # the legend fills its columns one after the other
    rows = max((sum(deep[k : k + each]) for k in range(0, len(deep), each or 1)), default=0)
    figure = sheet(SINGLE if alone else DOUBLE, spec.height * len(spec.rows) + 0.16 * rows + 0.1)
    places = figure.add_gridspec(len(spec.rows), COLUMNS)
    letter = 0
    for i, row in enumerate(spec.rows):
        left, before = 0, None
        for part in row:
            continued = isinstance(part, Panel) and part.continued
            ax = figure.add_subplot(places[i, left : left + part.width], sharey=before if continued else None)
            left, before = left + part.width, ax
            if not continued and not alone:
                ax.set_title(f"{chr(ord('a') + letter)}  {part.title}")
                letter += 1
            _fill(ax, part, lines)
    if handles:
        figure.legend(handles=handles, loc="outside lower left", ncols=columns)
    return figure


def _fill(ax: Axes, part: Panel | Sketch, lines: Sequence[Line]) -> None:
    if isinstance(part, Panel):
        draw_panel(ax, part, lines)
        ax.set_xlabel(r"$t$ [s]")
        return
    source = next((k.series for k in lines if k.series is not None and "frame_t" in k.series), None)
    if not draw_sketch(ax, part.view, source):
        words = f"{label_of(lines[0])}{': no poses recorded' if lines[0].chosen.run else ''}"
        ax.text(0.5, 0.5, fill(plain(words), 40), transform=ax.transAxes, ha="center", va="center", color=MUTED)


def _handles(spec: PaperFigure, lines: Sequence[Line]) -> list[Line2D]:
    panels = [p for p in spec.panels() if isinstance(p, Panel)]
    out = [_handle(k) for k in lines]
    exact = any(p.exact and k.series is not None and p.exact in k.series for p in panels for k in shown(p, lines))
    if exact:
        out.append(Line2D([], [], color=INK, linewidth=0.7, label="exact motion"))
    return out


def _handle(line: Line) -> Line2D:
    there = line.chosen.run is not None
    return Line2D([], [], color=line.look.colour if there else MUTED, linestyle=line.dash if there else "",
                  marker=line.look.marker if there else "x", markersize=3.6, markerfacecolor=PAPER,
                  markeredgewidth=0.8, label=fill(plain(label_of(line)), WRAP))  # fmt: skip


def label_of(line: Line) -> str:
    """The paper's name, ours, the settings, and how it ended or that the run or its series is missing."""
    chosen, run = line.chosen, line.chosen.run
    words = f"{chosen.role} ({chosen.asked.solver}), {chosen.settings}"
    if run is None:
        return f"{words}: {MISSING}"
    if run.succeeded and line.series is not None:
        return words
    end = run.status.replace("_", " ")
    if line.series is None and run.record.series:
        return f"{words}: its series cannot be read"
    if line.series is None:
        return f"{words}  ★ no step: {end}"
    return f"{words}  ★ {end} at {time(round(run.record.t_reached_s, 3))} s" if run.stopped else f"{words}  ✖ {end}"


def legend_columns(handles: Sequence[Line2D]) -> int:
    """As many as the longest label leaves room for."""
    longest = max((len(str(h.get_label())) for h in handles), default=1)
    return 3 if longest <= 36 else 2
