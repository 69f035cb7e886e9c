"""Figures as a journal takes them: one or two columns wide, 8 pt, vector files with their fonts inside."""

import io
import os
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from ..plots.drawing import STYLE

MM = 1.0 / 25.4  # [in]
SINGLE, DOUBLE = 86.0 * MM, 176.0 * MM  # [in] one and two columns of a journal
PNG_DPI = 200
SUFFIXES = ("pdf", "svg", "png")

PRINT: dict[str, Any] = {
    **STYLE, "font.size": 8.0, "axes.titlesize": 8.0, "axes.labelsize": 8.0, "legend.fontsize": 7.0,
    "xtick.labelsize": 7.0, "ytick.labelsize": 7.0, "axes.titlepad": 3.0, "axes.labelpad": 2.0,
    "pdf.fonttype": 42, "svg.fonttype": "path", "lines.linewidth": 1.0, "axes.titleweight": "normal",
    "legend.handlelength": 2.6, "legend.columnspacing": 1.2, "legend.labelspacing": 0.3,
}  # fmt: skip


def style() -> AbstractContextManager[None]:
    """All drawing for print happens inside this."""
    return mpl.rc_context({**mpl.rcParamsDefault, "backend": "agg", **PRINT})


def sheet(width: float, height: float) -> Figure:
    """An empty figure [in] whose panels find their own places."""
    return Figure(figsize=(width, height), dpi=PNG_DPI, layout="constrained")


def save(draw: Callable[[], Figure], folder: Path, name: str, suffixes: Sequence[str] = SUFFIXES) -> list[Path]:
    """Draw once, write each file whole or not at all; the same records give the same bytes."""
    folder.mkdir(parents=True, exist_ok=True)
    with style(), mpl.rc_context({"svg.hashsalt": name}):
        figure = draw()
        paths = []
        for suffix in sorted(suffixes, key=SUFFIXES[::-1].index):  # pixels first: they settle the layout
            out = io.BytesIO()
            _PRINT[suffix](figure, out)
            figure.set_layout_engine("none")  # it is laid out
            paths.append(write_bytes(folder / f"{name}.{suffix}", out.getvalue()))
    return sorted(paths)


def write_bytes(path: Path, content: bytes) -> Path:
    """Replaced whole."""
    partial = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        partial.write_bytes(content)
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)
    return path


_PRINT: dict[str, Callable[[Figure, io.BytesIO], None]] = {
    "png": lambda f, out: FigureCanvasAgg(f).print_png(out, metadata={"Software": None}),
    "pdf": lambda f, out: FigureCanvasPdf(f).print_pdf(out, metadata={"CreationDate": None, "Creator": None}),
    "svg": lambda f, out: FigureCanvasSVG(f).print_svg(out, metadata={"Date": None, "Creator": None}),
}
