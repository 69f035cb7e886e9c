"""Plots for print: panels of a figure with one legend, drawn from the same plots as those of the pages.

Widths of a journal, 8 pt unless another font is asked for, vector files with fonts inside.
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

from ...harness.places import Place
from .fonts import DEFAULT_FONT, SIZE, SMALL, Font
from .spec import DASHES, ENGINES, Axis, Look, Plot, Trace, Triangle
from .ticks import log_axis, raise_digits

ROOM = 0.8  # of the height of a panel: a legend over it would be larger than what it explains
NAMED = 14  # traces that a legend names; of more, only the solvers
ZERO = 20.0  # zeros are drawn so many times below the smallest value above zero, as in assets/plots.js
CROWD = 100  # points, above which they are drawn small
DECADE = 10.0  # room around values that are all alike
MM = 1.0 / 25.4  # [in]
SINGLE, DOUBLE = 86.0 * MM, 176.0 * MM  # [in] one and two columns of a journal
PNG_DPI = 200
SUFFIXES = ("pdf", "svg", "png")
INK, MUTED, PAPER = "#1c2126", "#5b646e", "#ffffff"
SHADE = "#eceff2"  # within slope triangles
INKED = Look(INK, "o")  # of what belongs to no solver
logging.getLogger("fontTools").setLevel(logging.ERROR)  # it warns of the date in matplotlib's own fonts
STYLE = mpl.rc_params_from_file(Path(__file__).parent / "print.mplstyle", use_default_template=False)


def figure(plots: Sequence[Plot], looks: Mapping[str, Look], *, columns: int = 2, height: float = 1.95,
           unseen: Sequence[Trace] = ()) -> Figure:  # fmt: skip
    """One column of a journal wide, or two for ``columns`` over 1; ``unseen`` traces are in the legend alone."""
    wide, columns = columns > 1, min(columns, len(plots))
    rows, width = -(-len(plots) // columns), DOUBLE if wide else SINGLE
    legend = Legend.of([*(t for p in plots for t in p.traces), *unseen], looks, wide, ROOM * height)
    out = sheet(width, height * rows + legend.height + 0.2)
    axes: dict[tuple[int, int], Axes] = {}
    for k, plot in enumerate(plots):
        at = row, column = divmod(k, columns)
        above, beside = plots[k - columns] if row else None, plots[k - 1] if column else None
        sharex = axes[row - 1, column] if above and above.x == plot.x else None
        sharey = axes[row, column - 1] if beside and beside.y == plot.y else None
        ax = axes[at] = out.add_subplot(rows, columns, k + 1, sharex=sharex, sharey=sharey)
        panel(ax, plot, looks)
        if columns > 1:
            ax.set_title(f"{chr(ord('a') + k)}  {plain(plot.title)}")
        below = plots[k + columns] if k + columns < len(plots) else None
        for axis, spec, hidden in ((ax.xaxis, plot.x, below and below.x == plot.x), (ax.yaxis, plot.y, sharey)):
            axis.set_label_text("" if hidden else label(spec))
            axis.set_tick_params(which="both", **{f"label{'bottom' if axis is ax.xaxis else 'left'}": not hidden})
    for ax, plot in zip(axes.values(), plots, strict=True):
        set_limits(ax, plot)
    legend.put(out)
    return out


@dataclass(frozen=True)
class Legend:
    """One for all panels of a figure, below them."""

    handles: tuple[Line2D, ...]
    columns: int

    @staticmethod
    def of(traces: Sequence[Trace], looks: Mapping[str, Look], wide: bool, room: float = np.inf) -> "Legend":
        """Every name once, as many abreast as the longest leaves room for; each solver where that is over ``room``."""
        for most in (NAMED, 0):
            handles = _handles(traces, looks, int((96 if wide else 62) / scale()), most)
            longest = max((len(str(h.get_label())) for h in handles), default=0)
            abreast = (108 if wide else 54) / scale() / max(longest, 18 if wide else 24)
            legend = Legend(tuple(handles), max(int(abreast), 1))
            if legend.height <= room:
                break
        return legend

    @property
    def height(self) -> float:
        """[in] that it takes."""
        return 0.14 * scale() * -(-sum(1 + str(h.get_label()).count("\n") for h in self.handles) // self.columns)

    def put(self, figure: Figure) -> None:
        if self.handles:
            figure.legend(handles=list(self.handles), loc="outside lower left", ncols=self.columns)


def label(axis: Axis) -> str:
    """Symbol and unit."""
    words = f"${axis.symbol}$" if axis.symbol else plain(axis.title)
    return f"{words} [{plain(axis.unit)}]" if axis.unit else words


def panel(ax: Axes, plot: Plot, looks: Mapping[str, Look]) -> None:
    """The traces of a plot; ``set_limits`` follows."""
    for which, axis in (("x", plot.x), ("y", plot.y)):
        if axis.log:
            log_axis(ax, which)
    floors = [_floor(plot.traces, key) if axis.log else -np.inf for key, axis in (("x", plot.x), ("y", plot.y))]
    low = plot.y.low if plot.y.log and plot.y.low == plot.y.low else floors[1]
    for k, trace in enumerate(plot.traces):
        if len(trace.x):
            _draw(ax, trace, looks.get(trace.solver, INKED), (floors[0], low), k / len(plot.traces))
    points = [t for t in plot.traces if t.mode != "lines"]
    if points:
        ax.margins(0.12)
        if plot.y.log and any(np.any(t.y == 0.0) for t in points):
            ax.axhline(low, color=MUTED, linewidth=0.8, linestyle=DASHES[2], zorder=1)
            ax.annotate("exactly 0", (0.01, low), xycoords=("axes fraction", "data"), xytext=(0, 3),
                        textcoords="offset points", color=MUTED, fontsize=small())  # fmt: skip
        heights = {max(float(v), low) for t in points for v in t.y}
        if plot.y.log and len(heights) == 1:  # a range has to come from somewhere
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
    """Draw a slope triangle with 1 below its level leg and its order beside the upright one."""
    (x0, x1), (y0, y1) = triangle.x, triangle.y
    ax.fill([x0, x1, x1], [y0, y0, y1], facecolor=SHADE, edgecolor=MUTED, linewidth=0.7, joinstyle="miter",
            zorder=2, gid=f"order {triangle.order}")  # fmt: skip
    middle = np.sqrt(x0 * x1), np.sqrt(y0 * y1)
    for words, at, away, where in (("1", (middle[0], y0), (0.0, -2.0), ("center", "top")),
                                   (str(triangle.order), (x1, middle[1]), (2.5, 0.0), ("left", "center"))):  # fmt: skip
        ax.annotate(words, at, xytext=away, textcoords="offset points", ha=where[0], va=where[1], color=INK,
                    fontsize=small(), zorder=2)  # fmt: skip


def set_limits(ax: Axes, plot: Plot) -> None:
    """Once all panels that share its axes are drawn: a limit on one side fixes the other as it is then."""
    ax.set_xlim(*(v if v == v else None for v in (plot.x.low, plot.x.high)))
    ax.set_ylim(*(v if v == v else None for v in (plot.y.low, plot.y.high)))


def _draw(ax: Axes, trace: Trace, look: Look, floors: tuple[float, float], phase: float) -> None:
    """``phase`` from 0 to 1 keeps the markers of long lines apart from each other."""
    x, y = np.maximum(trace.x, floors[0]), np.maximum(trace.y, floors[1])
    if trace.low is not None and trace.high is not None:
        edges = np.maximum(trace.low, floors[1]), np.maximum(trace.high, floors[1])
        ax.fill_between(x, *edges, color=look.colour, alpha=0.16, linewidth=0)
    if trace.left is not None and trace.right is not None:
        ax.hlines(y, np.maximum(trace.left, floors[0]), trace.right, color=look.colour, linewidth=2.2, alpha=0.45)
    ends = list(trace.ends) or [*[""] * (len(x) - 1), trace.end]
    style = _style(trace, look)
    if trace.mode == "lines":
        u = np.log(x) if floors[0] > 0.0 else x
        spots = np.searchsorted(u, u[0] + (np.arange(5) + phase) / 5.0 * (u[-1] - u[0]))
        spots = np.minimum(spots, len(x) - 1)  # a path may turn back
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
                ax.plot(x[k], y[k], marker=look.marker, linestyle="", color=look.colour, markersize=size, zorder=4,
                        markerfacecolor="none" if hollow else look.colour)  # fmt: skip
    ax.plot(x, y, zorder=3 if trace.solver else 5, **style)
    for k, end in enumerate(ends):
        mark_end(ax, end, x[k], y[k], look.colour)


def _style(trace: Trace, look: Look) -> dict:
    line = DASHES[trace.dash % len(DASHES)] if "lines" in trace.mode else ""
    width = {} if trace.solver else {"linewidth": 0.6}
    return {"color": look.colour, "linestyle": line, "marker": look.marker, "markersize": 3.6,
            "markerfacecolor": PAPER, "markeredgewidth": 0.8, **width}  # fmt: skip


def _handles(traces: Sequence[Trace], looks: Mapping[str, Look], wrap: int, most: int) -> list[Line2D]:
    """Every name once; of more than ``most``, each solver with the paper's name, and what belongs to none."""
    named = {t.name: t for t in reversed(traces)}
    if len(named) > most:  # a solver by its main line
        named = {t.solver or t.name: t for t in sorted(traces, key=lambda t: t.main)}
    out = []
    for name in dict.fromkeys(t.name if t.name in named else t.solver for t in traces):
        t = named[name]
        look = looks.get(t.solver, INKED)
        style = _style(t, look) | ({} if t.solver or t.hollow else {"marker": ""})
        shown = name if name == t.name else t.who or t.solver
        words = f"{plain(shown)} (engine)" if look.family == ENGINES else plain(shown)
        out.append(Line2D([], [], **style, label=fill(words, wrap)))
    out.sort(key=lambda h: str(h.get_label()).endswith("(engine)"))
    for symbol, kind, text in (("*", "failed", "stopped early"), ("X", "wrong", "false success")):
        if any(kind in (t.end, *t.ends) for t in traces):
            out.append(Line2D([], [], color=PAPER, marker=symbol, linestyle="", label=text, markersize=7,
                              markeredgecolor=INK))  # fmt: skip
    return out


def _floor(traces: Sequence[Trace], key: str) -> float:
    """Where zeros are put: well below the smallest value above zero."""
    points = [t for t in traces if t.mode != "lines"] or traces
    above = [float(v[v > 0.0].min()) for t in points if (v := getattr(t, key)).size and np.any(v > 0.0)]
    return min(above) / ZERO if above else 1e-16


def style(font: Font = DEFAULT_FONT) -> AbstractContextManager[None]:
    """All drawing for print happens inside this."""
    return mpl.rc_context({**mpl.rcParamsDefault, "backend": "agg", **STYLE, **font.settings})


def scale() -> float:
    """The size of the letters in force, over the default one."""
    return mpl.rcParams["font.size"] / SIZE


def small() -> float:
    """The size of notes inside panels [pt]."""
    return mpl.rcParams["font.size"] * SMALL


def sheet(width: float, height: float) -> Figure:
    """An empty figure [in] whose panels find their own places."""
    return Figure(figsize=(width, height), dpi=PNG_DPI, layout="constrained")


def save(draw: Callable[[], Figure], folder: Place, name: str, suffixes: Sequence[str] = SUFFIXES,
         font: Font = DEFAULT_FONT) -> list[Path]:  # fmt: skip
    """Draw once, write each file whole or not at all; the same records give the same bytes."""
    paths = []
    with style(font), mpl.rc_context({"svg.hashsalt": name}):
        figure = draw()
        for suffix in sorted(suffixes, key=SUFFIXES[::-1].index):  # pixels first: they settle the layout
            out = io.BytesIO()
            _PRINT[suffix](figure, out)
            figure.set_layout_engine("none")  # it is laid out
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
    """A star where a run stopped early (``failed``), a cross where it is ``wrong``; nothing for a success."""
    if end:
        symbol, size, name = ("*", 10.0, "star") if end == "failed" else ("X", 6.5, "cross")
        ax.plot([x], [y], symbol, color=colour, markersize=size, markeredgecolor=INK, markeredgewidth=0.6, zorder=6,
                clip_on=False, gid=f"{name}-")  # fmt: skip


def plain(text: str) -> str:
    """Any text as text: no mathematics in it, and nothing a font cannot show."""
    shown = "".join(c if c.isprintable() else " " for c in text)
    return raise_digits(shown.replace("\\", "/").replace("$", r"\$"))
