"""The look of printed figures and how they are written: widths of a journal, 8 pt, vector files with fonts inside."""

import io
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter, LogLocator

from ...harness.places import Place
from ..model.words import SUPERSCRIPTS

MM = 1.0 / 25.4  # [in]
SINGLE, DOUBLE = 86.0 * MM, 176.0 * MM  # [in] one and two columns of a journal
PNG_DPI = 200
SUFFIXES = ("pdf", "svg", "png")
INK, MUTED, PAPER = "#1c2126", "#5b646e", "#ffffff"
STYLE = mpl.rc_params_from_file(Path(__file__).parent / "print.mplstyle", use_default_template=False)


def style() -> AbstractContextManager[None]:
    """All drawing for print happens inside this."""
    return mpl.rc_context({**mpl.rcParamsDefault, "backend": "agg", **STYLE})


def sheet(width: float, height: float) -> Figure:
    """An empty figure [in] whose panels find their own places."""
    return Figure(figsize=(width, height), dpi=PNG_DPI, layout="constrained")


def save(draw: Callable[[], Figure], folder: Place, name: str, suffixes: Sequence[str] = SUFFIXES) -> list[Path]:
    """Draw once, write each file whole or not at all; the same records give the same bytes."""
    paths = []
    with style(), mpl.rc_context({"svg.hashsalt": name}):
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


class Powers(LogFormatter):
    """``10⁻⁵`` as text: setting mathematics for every tick takes as long as all the lines."""

    _sublabels: set[float] | None  # of the base class

    def set_locs(self, locs: Any = None) -> None:
        """Where few powers of ten are seen, so many parts of a decade are labelled that none overlap."""
        super().set_locs(locs)
        low, high = self.axis.get_view_interval()
        if self._sublabels and len(self._sublabels) > 1 and high > 2.0 * low:
            self._sublabels = {1.0, 3.0} if high > 10.0 * low else {1.0, 2.0, 3.0, 5.0}

    def __call__(self, x: float, pos: int | None = None) -> str:
        if not super().__call__(x, pos) or not x > 0.0:
            return ""
        mantissa, power = f"{x:.2e}".split("e")
        shown = f"10{str(int(power)).translate(SUPERSCRIPTS)}"
        return shown if float(mantissa) == 1.0 else f"{float(mantissa):g}×{shown}"


def log_axis(ax: Axes, which: str = "y") -> None:
    """Logarithmic, with at most about seven labelled decades; within one decade, parts of it are labelled."""
    (ax.set_yscale if which == "y" else ax.set_xscale)("log")
    axis = ax.yaxis if which == "y" else ax.xaxis
    axis.set_major_locator(LogLocator(numticks=7))
    axis.set_major_formatter(Powers())
    axis.set_minor_formatter(Powers(labelOnlyBase=False))


def mark_end(ax: Axes, end: str, x: float, y: float, colour: str) -> None:
    """A star where a run stopped early (``failed``), a cross where it is ``wrong``; nothing for a success."""
    if end:
        symbol, size, name = ("*", 10.0, "star") if end == "failed" else ("X", 6.5, "cross")
        ax.plot([x], [y], symbol, color=colour, markersize=size, markeredgecolor=INK, markeredgewidth=0.6, zorder=6,
                clip_on=False, gid=f"{name}-")  # fmt: skip


def plain(text: str) -> str:
    """Any text as text: no mathematics in it, and nothing a font cannot show."""
    shown = "".join(c if c.isprintable() else " " for c in text)
    return shown.replace("\\", "/").replace("$", r"\$")
