"""How figures look and how they are written: publication size, light, the same bytes for the same records."""

import io
import re
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cache
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.mathtext import MathTextParser
from matplotlib.ticker import LogFormatter, LogLocator

from reports.words import SUPERSCRIPTS

WIDTH = 7.2  # [in] two columns of a journal
INK, MUTED, GRID, PAPER = "#1c2126", "#5b646e", "#e1e5ea", "#ffffff"
THEME = {
    INK: "--ink",
    MUTED: "--muted",
    GRID: "--rule",
    PAPER: "--card",
}  # what the page recolours in the dark; curves keep theirs
PNG_DPI = 180
ENDS = ("star-", "cross-")  # names of the marks where runs end, followed by the cell

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


@dataclass(frozen=True)
class Written:
    """A figure as files and as part of a page."""

    drawn: Drawn
    svg: str
    png: bytes
    inline: str  # SVG for the page: its own ids, colours of the theme, no name space


def style() -> AbstractContextManager[None]:
    """Everything a figure does happens inside this."""
    return mpl.rc_context({**mpl.rcParamsDefault, "backend": "agg", **STYLE})


def write(drawn: Drawn) -> Written:
    """Draw once, write both files."""
    with style(), mpl.rc_context({"svg.hashsalt": drawn.name}):
        figure = drawn.draw()
        svg, png = io.BytesIO(), io.BytesIO()
        FigureCanvasAgg(figure).print_png(png, metadata={"Software": None})
        figure.set_layout_engine("none")  # it is laid out: the SVG need not do so again
        FigureCanvasSVG(figure).print_svg(svg, metadata={"Date": None, "Creator": None})
    text = _lean(svg.getvalue().decode("utf-8"))
    return Written(drawn, text, png.getvalue(), _inline(text, drawn.name))


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


@cache
def symbol(mathtext: str, name: str) -> str:
    """``$mathtext$`` if it can be set, else the name."""
    try:
        if not mathtext:
            return plain(name)
        with style():
            MathTextParser("path").parse(f"${mathtext}$")
    except (ValueError, RuntimeError):
        return plain(name)
    return f"${mathtext}$"


def _lean(svg: str) -> str:
    """Without comments, metadata, names nobody refers to, and digits nobody sees."""
    svg = re.sub(r"<!--.*?-->\s*|<metadata>.*?</metadata>\s*|<!DOCTYPE.*?>\s*", "", svg, flags=re.DOTALL)
    used = set(re.findall(r'(?:href="#|url\(#)([^")]+)', svg))
    svg = re.sub(r' id="([^"]*)"', lambda i: _name(i[1], used), svg)
    svg = re.sub(r'(?<= d=")[^"]*', lambda d: _short(d.group()), svg)
    svg = re.sub(r' ([xy])="(-?\d+\.\d+)"', lambda x: f' {x[1]}="{float(x[2]):.2f}"', svg)
    return re.sub(r"\n\s*", "\n", svg)


def _name(name: str, used: set[str]) -> str:
    if name.startswith(ENDS):
        return f' class="{name}"'  # one in each panel
    return f' id="{name}"' if name in used else ""


def _short(path: str) -> str:
    """A polyline in steps of 0.1 pt from point to point; other paths with two decimals."""
    parts = path.split()
    if len(parts) < 12 or set(parts[::3]) - {"M", "L", "z"} or "z" in parts[:-1:3]:
        return re.sub(r"\s+", " ", re.sub(r"-?\d+\.\d{3,}", lambda x: f"{float(x.group()):.2f}", path)).strip()
    out, x, y = [], 0, 0
    for command, a, b in zip(parts[::3], parts[1::3], parts[2::3], strict=False):
        new_x, new_y = round(10.0 * float(a)), round(10.0 * float(b))
        pair = (new_x, new_y) if command == "M" else (new_x - x, new_y - y)
        out.append(f"{'M' if command == 'M' else 'l'}{pair[0] / 10:g} {pair[1] / 10:g}")
        x, y = new_x, new_y
    return "".join(out) + ("z" if parts[-1] == "z" else "")


def _inline(svg: str, name: str) -> str:
    svg = re.sub(r"<\?xml.*?\?>\s*", "", svg)
    svg = re.sub(r'\s(xmlns(:\w+)?|version)="[^"]*"', "", svg).replace("xlink:href", "href")
    mine = f"{name}--"  # one page, many figures: each has its own names
    svg = re.sub(r'(?<= )id="', f'id="{mine}', svg)
    svg = re.sub(r'(?<= )href="#', f'href="#{mine}', svg).replace("url(#", f"url(#{mine}")
    for colour, variable in THEME.items():
        svg = svg.replace(colour, f"var({variable})")
    head, rest = svg.split(">", 1)
    head = re.sub(r'\s(width|height)="[^"]*"', "", head)
    return f'{head} aria-hidden="true" focusable="false">{rest}'.strip()
