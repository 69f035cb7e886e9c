"""Draw plots for print: panels of a figure with one legend, from the same plots as on the pages.

Figures have the widths of a journal, 8 pt letters unless another font is chosen, and are vector files with embedded
fonts.
"""

import io
import logging
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from ...harness.base.confined_paths import ConfinedPath
from .fonts import DEFAULT_FONT, SIZE, SMALL, Font
from .spec import DASHES, ENGINES, Axis, LineStyle, Plot, Trace, Triangle
from .ticks import raise_digits, set_log_axis

ROOM = 0.8  # largest height of a legend, relative to a panel
NAMED = 14  # most traces that a legend names; beyond, it names solvers
ZERO = 20.0  # zeros are drawn this many times below the smallest positive value, as in assets/plots.js
CROWD = 100  # number of points above which they are drawn small
DECADE = 10.0  # range factor around values that are all equal
MM = 1.0 / 25.4  # [in]
SINGLE, DOUBLE = 86.0 * MM, 176.0 * MM  # [in] one and two columns of a journal
PNG_DPI = 200
SUFFIXES = ("pdf", "svg", "png")
INK, MUTED, PAPER = "#1c2126", "#5b646e", "#ffffff"
SHADE = "#eceff2"  # fill of slope triangles
INKED = LineStyle(INK, "o")  # look of traces without a solver
logging.getLogger("fontTools").setLevel(logging.ERROR)  # it warns about dates in matplotlib's own fonts
STYLE = mpl.rc_params_from_file(Path(__file__).parent / "print.mplstyle", use_default_template=False)


def draw_plots(
    plots: Sequence[Plot],
    looks: Mapping[str, LineStyle],
    *,
    columns: int = 2,
    height: float = 1.95,
    unseen: Sequence[Trace] = (),
) -> Figure:
    """Draw the plots as panels, each ``height`` [in] high, in at most ``columns`` columns, with one legend below.

    The figure has the width of one column of a journal, or of two if ``columns`` exceeds 1. ``looks`` are line styles
    by solver. The ``unseen`` traces are only in the legend.
    """
    wide, columns = columns > 1, min(columns, len(plots))
    rows, width = -(-len(plots) // columns), DOUBLE if wide else SINGLE
    legend = Legend.build([*(t for p in plots for t in p.traces), *unseen], looks, wide, ROOM * height)
    out = sheet(width, height * rows + legend.height + 0.2)
    axes: dict[tuple[int, int], Axes] = {}
    for k, plot in enumerate(plots):
        at = row, column = divmod(k, columns)
        above, beside = plots[k - columns] if row else None, plots[k - 1] if column else None
        sharex = axes[row - 1, column] if above and above.x == plot.x else None
        sharey = axes[row, column - 1] if beside and beside.y == plot.y else None
        ax = axes[at] = out.add_subplot(rows, columns, k + 1, sharex=sharex, sharey=sharey)
        draw_panel(ax, plot, looks)
        if columns > 1:
            ax.set_title(f"{chr(ord('a') + k)}  {strip_math(plot.title)}")
        below = plots[k + columns] if k + columns < len(plots) else None
        for axis, spec, hidden in ((ax.xaxis, plot.x, below and below.x == plot.x), (ax.yaxis, plot.y, sharey)):
            axis.set_label_text("" if hidden else format_label(spec))
            axis.set_tick_params(which="both", **{f"label{'bottom' if axis is ax.xaxis else 'left'}": not hidden})
    for ax, plot in zip(axes.values(), plots, strict=True):
        set_limits(ax, plot)
    legend.put(out)
    return out


@dataclass(frozen=True)
class Legend:
    """A legend below all panels of a figure."""

    handles: tuple[Line2D, ...]
    columns: int

    @staticmethod
    def build(traces: Sequence[Trace], looks: Mapping[str, LineStyle], wide: bool, room: float = np.inf) -> "Legend":
        """Return a legend with every name once, in as many columns as fit; ``wide`` is for a figure of two columns.

        It names solvers only if it has more than ``NAMED`` names or is higher than ``room`` [in].
        """
        for most in (NAMED, 0):
            handles = _make_handles(traces, looks, int((96 if wide else 62) / scale()), most)
            longest = max((len(str(h.get_label())) for h in handles), default=0)
            abreast = (108 if wide else 54) / scale() / max(longest, 18 if wide else 24)
            legend = Legend(tuple(handles), max(int(abreast), 1))
            if legend.height <= room:
                break
        return legend

    @property
    def height(self) -> float:
        """The height of the legend [in]."""
        return 0.14 * scale() * -(-sum(1 + str(h.get_label()).count("\n") for h in self.handles) // self.columns)

    def put(self, figure: Figure) -> None:
        """Add the legend to a figure, if it has an entry."""
        if self.handles:
            figure.legend(handles=list(self.handles), loc="outside lower left", ncols=self.columns)


def format_label(axis: Axis) -> str:
    """Format the symbol and unit of an axis."""
    words = f"${axis.symbol}$" if axis.symbol else strip_math(axis.title)
    return f"{words} [{strip_math(axis.unit)}]" if axis.unit else words


def draw_panel(ax: Axes, plot: Plot, looks: Mapping[str, LineStyle]) -> None:
    """Draw the traces, marks and triangles of a plot into ``ax``; call ``set_limits`` afterwards."""
    for which, axis in (("x", plot.x), ("y", plot.y)):
        if axis.log:
            set_log_axis(ax, which)
    floors = [_find_floor(plot.traces, key) if axis.log else -np.inf for key, axis in (("x", plot.x), ("y", plot.y))]
    low = plot.y.low if plot.y.log and plot.y.low == plot.y.low else floors[1]
    for k, trace in enumerate(plot.traces):
        if len(trace.x):
            _draw_trace(ax, trace, looks.get(trace.solver, INKED), (floors[0], low), k / len(plot.traces))
    points = [t for t in plot.traces if t.mode != "lines"]
    if points:
        ax.margins(0.12)
        if plot.y.log and any(np.any(t.y == 0.0) for t in points):
            ax.axhline(low, color=MUTED, linewidth=0.8, linestyle=DASHES[2], zorder=1)
            ax.annotate(
                "exactly 0",
                (0.01, low),
                xycoords=("axes fraction", "data"),
                xytext=(0, 3),
                textcoords="offset points",
                color=MUTED,
                fontsize=find_note_size(),
            )
        heights = {max(float(v), low) for t in points for v in t.y}
        if plot.y.log and len(heights) == 1:  # a single value gives no range
            ax.set_ylim(min(heights) / DECADE, min(heights) * DECADE)
    elif plot.y.log and not any(t.y.any() for t in plot.traces if t.solver):
        ax.text(0.5, 0.5, "exactly zero throughout", transform=ax.transAxes, ha="center", color=MUTED)
    for at in (v for values in plot.marks.values() for v in values):
        ax.axvline(at, color=MUTED, linewidth=0.8, linestyle=DASHES[2], zorder=1)
    for triangle in plot.triangles:
        _draw_triangle(ax, triangle)
    if not plot.x.log:
        ax.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 2.5, 5, 10]))


def _draw_triangle(ax: Axes, triangle: Triangle) -> None:
    """Draw a slope triangle, with 1 below its horizontal leg and the order beside its vertical leg."""
    (x0, x1), (y0, y1) = triangle.x, triangle.y
    ax.fill(
        [x0, x1, x1],
        [y0, y0, y1],
        facecolor=SHADE,
        edgecolor=MUTED,
        linewidth=0.7,
        joinstyle="miter",
        zorder=2,
        gid=f"order {triangle.order}",
    )
    middle = np.sqrt(x0 * x1), np.sqrt(y0 * y1)
    for words, at, away, where in (
        ("1", (middle[0], y0), (0.0, -2.0), ("center", "top")),
        (str(triangle.order), (x1, middle[1]), (2.5, 0.0), ("left", "center")),
    ):
        ax.annotate(
            words,
            at,
            xytext=away,
            textcoords="offset points",
            ha=where[0],
            va=where[1],
            color=INK,
            fontsize=find_note_size(),
            zorder=2,
        )


def set_limits(ax: Axes, plot: Plot) -> None:
    """Set the limits of both axes and the ticks of an axis with names.

    It is called once all panels that share the axes are drawn, since a limit on one side fixes the other.
    """
    ax.set_xlim(*(v if v == v else None for v in (plot.x.low, plot.x.high)))
    ax.set_ylim(*(v if v == v else None for v in (plot.y.low, plot.y.high)))
    for which, axis in ((ax.xaxis, plot.x), (ax.yaxis, plot.y)):
        if axis.names:
            which.set_ticks(range(len(axis.names)), [strip_math(name) for name in axis.names])
            which.set_view_interval(-0.5, len(axis.names) - 0.5, ignore=True)


def _draw_trace(ax: Axes, trace: Trace, look: LineStyle, floors: tuple[float, float], phase: float) -> None:
    """Draw one trace with its band, spread, markers and the marks of its ends; ``floors`` are the least x and y drawn.

    ``phase`` from 0 to 1 shifts the markers of long lines against each other.
    """
    x, y = np.maximum(trace.x, floors[0]), np.maximum(trace.y, floors[1])
    if trace.low is not None and trace.high is not None:
        edges = np.maximum(trace.low, floors[1]), np.maximum(trace.high, floors[1])
        ax.fill_between(x, *edges, color=look.colour, alpha=0.16, linewidth=0)
    if trace.left is not None and trace.right is not None:
        ax.hlines(y, np.maximum(trace.left, floors[0]), trace.right, color=look.colour, linewidth=2.2, alpha=0.45)
    ends = list(trace.ends) or [*[""] * (len(x) - 1), trace.end]
    style = _choose_style(trace, look)
    if trace.mode == "lines":
        u = np.log(x) if floors[0] > 0.0 else x
        spots = np.searchsorted(u, u[0] + (np.arange(5) + phase) / 5.0 * (u[-1] - u[0]))
        spots = np.minimum(spots, len(x) - 1)  # a path may reverse
        style |= {
            "markevery": np.unique(spots).tolist(),
            "marker": look.marker if trace.solver and trace.marked else "",
        }
    else:
        style["marker"] = ""
        for k, end in enumerate(ends):
            hollow = trace.hollow or trace.x[k] < x[k] or trace.y[k] < y[k]
            if not end:
                size = 2.0 if len(x) > CROWD else 8.0 if trace.hollow else 4.5
                ax.plot(
                    x[k],
                    y[k],
                    marker=look.marker,
                    linestyle="",
                    color=look.colour,
                    markersize=size,
                    zorder=4,
                    markerfacecolor="none" if hollow else look.colour,
                )
    ax.plot(x, y, zorder=3 if trace.solver else 5, **style)
    for k, end in enumerate(ends):
        mark_end(ax, end, x[k], y[k], look.colour)


def _choose_style(trace: Trace, look: LineStyle) -> dict:
    """Return the matplotlib settings of a trace's line and markers."""
    line = DASHES[trace.dash % len(DASHES)] if "lines" in trace.mode else ""
    width = {} if trace.solver else {"linewidth": 0.6}
    return {
        "color": look.colour,
        "linestyle": line,
        "marker": look.marker,
        "markersize": 3.6,
        "markerfacecolor": PAPER,
        "markeredgewidth": 0.8,
        **width,
    }


def _make_handles(traces: Sequence[Trace], looks: Mapping[str, LineStyle], wrap: int, most: int) -> list[Line2D]:
    """Return the handles of a legend: one per name, engines last, then those of stars and crosses if there are any.

    Of more than ``most`` names, those of solvers and of traces without a solver remain. Names are wrapped at ``wrap``
    characters.
    """
    named = {t.name: t for t in reversed(traces)}
    if len(named) > most:  # a solver is shown by its main line
        named = {t.solver or t.name: t for t in sorted(traces, key=lambda t: t.main)}
    out = []
    for name in dict.fromkeys(t.name if t.name in named else t.solver for t in traces):
        t = named[name]
        look = looks.get(t.solver, INKED)
        style = _choose_style(t, look) | ({} if t.solver or t.hollow else {"marker": ""})
        shown = name if name == t.name else t.who or t.solver
        words = f"{strip_math(shown)} (engine)" if look.family == ENGINES else strip_math(shown)
        out.append(Line2D([], [], **style, label=fill(words, wrap)))
    out.sort(key=lambda h: str(h.get_label()).endswith("(engine)"))
    for symbol, kind, text in (("*", "failed", "stopped early"), ("X", "wrong", "false success")):
        if any(kind in (t.end, *t.ends) for t in traces):
            out.append(
                Line2D([], [], color=PAPER, marker=symbol, linestyle="", label=text, markersize=7, markeredgecolor=INK)
            )
    return out


def _find_floor(traces: Sequence[Trace], key: str) -> float:
    """Return where zeros of the coordinate ``key``, x or y, are drawn: ``ZERO`` times below all positive values."""
    points = [t for t in traces if t.mode != "lines"] or traces
    above = [float(v[v > 0.0].min()) for t in points if (v := getattr(t, key)).size and np.any(v > 0.0)]
    return min(above) / ZERO if above else 1e-16


def apply_style(font: Font = DEFAULT_FONT) -> AbstractContextManager[None]:
    """Return a context manager that sets matplotlib's style and the font for print."""
    return mpl.rc_context({**mpl.rcParamsDefault, "backend": "agg", **STYLE, **font.settings})


def scale() -> float:
    """Return the current letter size relative to the default size, by which sizes in a figure are scaled."""
    return mpl.rcParams["font.size"] / SIZE


def find_note_size() -> float:
    """Return the size of notes inside panels [pt]."""
    return mpl.rcParams["font.size"] * SMALL


def sheet(width: float, height: float) -> Figure:
    """Return an empty figure of ``width`` and ``height`` [in] with automatic layout."""
    return Figure(figsize=(width, height), dpi=PNG_DPI, layout="constrained")


def save_figure(
    draw: Callable[[], Figure],
    folder: ConfinedPath,
    name: str,
    suffixes: Sequence[str] = SUFFIXES,
    font: Font = DEFAULT_FONT,
) -> list[Path]:
    """Draw a figure once in ``font``, write it into ``folder`` as each file type of ``suffixes``; return sorted paths.

    Equal records give equal bytes.
    """
    paths = []
    with apply_style(font), mpl.rc_context({"svg.hashsalt": name}):
        figure = draw()
        for suffix in sorted(suffixes, key=SUFFIXES[::-1].index):  # pixels first, which fixes the layout
            out = io.BytesIO()
            _PRINT[suffix](figure, out)
            figure.set_layout_engine("none")  # the layout is done
            place = folder / f"{name}.{suffix}"
            place.write(out.getvalue())
            paths.append(place.path)
    return sorted(paths)


_PRINT: dict[str, Callable[[Figure, io.BytesIO], None]] = {
    "png": lambda f, out: FigureCanvasAgg(f).print_png(out, metadata={"Software": None}),
    "pdf": lambda f, out: FigureCanvasPdf(f).print_pdf(out, metadata={"CreationDate": None, "Creator": None}),
    "svg": lambda f, out: FigureCanvasSVG(f).print_svg(out, metadata={"Date": None, "Creator": None}),
}


def mark_end(ax: Axes, end: str, x: float, y: float, colour: str) -> None:
    """Draw a star where a run stopped early (``failed``), a cross where it is ``wrong``; nothing for a success."""
    if end:
        symbol, size, name = ("*", 10.0, "star") if end == "failed" else ("X", 6.5, "cross")
        ax.plot(
            [x],
            [y],
            symbol,
            color=colour,
            markersize=size,
            markeredgecolor=INK,
            markeredgewidth=0.6,
            zorder=6,
            clip_on=False,
            gid=f"{name}-",
        )


def strip_math(text: str) -> str:
    """Return text that matplotlib shows as it is, without math mode, and with blanks for unprintable characters."""
    shown = "".join(c if c.isprintable() else " " for c in text)
    return raise_digits(shown.replace("\\", "/").replace("$", r"\$"))
