"""Format ticks of logarithmic axes in print, and superscripts in the current font."""

import re
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.ticker import LogFormatter, LogLocator

from ..model.words import SUPERSCRIPTS

LOWERED = {v: k for k, v in SUPERSCRIPTS.items()}
RAISED = re.compile(f"[{''.join(map(chr, LOWERED))}]+")


class PowerFormatter(LogFormatter):
    """A formatter that writes ``10⁻⁵`` as text: math mode for every tick takes as long as all the lines."""

    _sublabels: set[float] | None  # declared by the base class

    def set_locs(self, locs: Any = None) -> None:
        """Set the ticks, and where parts of decades have labels choose 1 and 3, or within one decade 1, 2, 3 and 5."""
        super().set_locs(locs)
        low, high = self.axis.get_view_interval()
        if self._sublabels and len(self._sublabels) > 1 and high > 2.0 * low:
            self._sublabels = {1.0, 3.0} if high > 10.0 * low else {1.0, 2.0, 3.0, 5.0}

    def __call__(self, x: float, pos: int | None = None) -> str:
        """Return the label of a tick at ``x``; empty for a tick without one."""
        if not super().__call__(x, pos) or not x > 0.0:
            return ""
        mantissa, power = f"{x:.2e}".split("e")
        shown = raise_digits(f"10{str(int(power)).translate(SUPERSCRIPTS)}")
        return shown if float(mantissa) == 1.0 else f"{float(mantissa):g}×{shown}"


def set_log_axis(ax: Axes, which: str = "y") -> None:
    """Make an axis logarithmic with at most about seven labelled decades; within one decade, parts are labelled."""
    (ax.set_yscale if which == "y" else ax.set_xscale)("log")
    axis = ax.yaxis if which == "y" else ax.xaxis
    axis.set_major_locator(LogLocator(numticks=7))
    axis.set_major_formatter(PowerFormatter())
    axis.set_minor_formatter(PowerFormatter(labelOnlyBase=False))


def raise_digits(text: str) -> str:
    """Write superscripts in math mode if the font is not the default one: few fonts have all of them."""
    if not mpl.rcParams["axes.formatter.use_mathtext"]:
        return text
    return RAISED.sub(lambda found: f"$^{{{found[0].translate(LOWERED)}}}$", text)
