"""How figures look and how they are written: publication size, light, the same bytes for the same records."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter, LogLocator

from ..model.words import SUPERSCRIPTS

WIDTH = 7.2  # [in] two columns of a journal
INK, MUTED, GRID, PAPER = "#1c2126", "#5b646e", "#e1e5ea", "#ffffff"
THEME = {
    INK: "--ink",
    MUTED: "--muted",
    GRID: "--rule",
    PAPER: "--card",
}  # what the page recolours in the dark; curves keep theirs
PNG_DPI = 180
ENDS = ("star-", "cross-")  # names of the marks where runs end, followed by the run

STYLE: dict[str, Any] = {
    "font.family": "DejaVu Sans", "font.size": 8.0, "mathtext.fontset": "dejavusans",
    "axes.titlesize": 8.5, "axes.labelsize": 8.5, "legend.fontsize": 7.5,
    "xtick.labelsize": 7.5, "ytick.labelsize": 7.5,
    "axes.titlelocation": "left", "axes.titleweight": "bold", "axes.titlepad": 5.0,
    "axes.spines.top": False, "axes.spines.right": False, "axes.linewidth": 0.7, "axes.edgecolor": MUTED,
    "axes.labelcolor": INK, "axes.titlecolor": INK, "text.color": INK, "xtick.color": MUTED, "ytick.color": MUTED,
    "xtick.labelcolor": INK, "ytick.labelcolor": INK, "xtick.major.width": 0.7, "ytick.major.width": 0.7,
    "xtick.minor.size": 1.5, "ytick.minor.size": 1.5, "axes.grid": True, "grid.color": GRID, "grid.linewidth": 0.6,
    "axes.axisbelow": True, "lines.linewidth": 1.2, "lines.markersize": 4.0, "legend.frameon": False,
    "legend.handlelength": 3.2, "legend.columnspacing": 1.6, "figure.facecolor": PAPER, "axes.facecolor": "none",
    "path.simplify_threshold": 0.2, "svg.fonttype": "none", "axes.formatter.limits": (-3, 4),
}  # fmt: skip


@dataclass(frozen=True)
class Drawn:
    """A figure with what is said about it; ``name`` is that of its files."""

    name: str
    title: str
    caption: str
    draw: Callable[[], Figure]


def style() -> AbstractContextManager[None]:
    """Everything a figure does happens inside this."""
    return mpl.rc_context({**mpl.rcParamsDefault, "backend": "agg", **STYLE})


class Powers(LogFormatter):
    """``10⁻⁵`` as text: setting mathematics for every tick takes as long as all the lines."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        if not super().__call__(x, pos) or not x > 0.0:
            return ""
        mantissa, power = f"{x:.0e}".split("e")
        shown = f"10{str(int(power)).translate(SUPERSCRIPTS)}"
        return shown if float(mantissa) == 1.0 else f"{float(mantissa):g}×{shown}"


def new_figure(height: float) -> Figure:
    """An empty one, as wide as a page."""
    return Figure(figsize=(WIDTH, height), dpi=PNG_DPI, layout="constrained")


def panel_title(ax: Axes, k: int, text: str) -> None:
    """``a  text``: panels are lettered as in the paper."""
    ax.set_title(f"{chr(ord('a') + k)}  {plain(text)}")


def log_axis(ax: Axes, which: str = "y") -> None:
    """Logarithmic, with at most about seven labelled decades; within one decade, parts of it are labelled."""
    (ax.set_yscale if which == "y" else ax.set_xscale)("log")
    axis = ax.yaxis if which == "y" else ax.xaxis
    axis.set_major_locator(LogLocator(numticks=7))
    axis.set_major_formatter(Powers())
    axis.set_minor_formatter(Powers(labelOnlyBase=False))


def plain(text: str) -> str:
    """Text of a file as text: no mathematics in it, and nothing a font cannot show."""
    shown = "".join(c if c.isprintable() else " " for c in text)
    return shown.replace("\\", "/").replace("$", r"\$")
