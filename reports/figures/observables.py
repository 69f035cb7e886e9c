"""Each observable over time on the reference, and its distance from it."""

from collections.abc import Callable
from functools import partial

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from reports.curves import Curve
from reports.drawing import INK, Drawn, new_figure, panel_title, symbol
from reports.figures.lines import Group, draw_lines, legend_of, log_limits
from reports.motion import Motion
from reports.words import unit

ROWS = 4  # observables a figure
BLOWN_UP = 1e-9  # a reference smaller than this part of what is shown is zero: it gives no scale


def observables(name: str, title: str, group: Group, everyone: Group) -> list[Drawn]:
    """As many figures as it takes at four observables each."""
    names = list(dict.fromkeys(n for m in everyone.motions for n in m.observables))
    chunks = [names[k : k + ROWS] for k in range(0, len(names), ROWS)]
    caption = (
        "Left: values, with smallest and largest of each span of time; the reference is the thin line without markers. "
        "Right: distance from the reference, largest in each span."
    )
    out = []
    for k, chunk in enumerate(chunks):
        part = f" ({k + 1} of {len(chunks)})" if len(chunks) > 1 else ""
        here = f"{name}-{k + 1}" if len(chunks) > 1 else name
        out.append(Drawn(here, title + part, caption, partial(_draw, chunk, group, everyone)))
    return out


def _draw(names: list[str], group: Group, everyone: Group) -> Figure:
    exact = {n: max((m.exact[n] for m in everyone.motions if n in m.exact), key=len, default=None) for n in names}
    columns = 2 if any(exact.values()) else 1
    legend = legend_of(group, [Line2D([], [], color=INK, linewidth=0.7, label="reference")] if columns == 2 else [])
    figure = new_figure(1.5 * len(names) + 0.3 + legend.height)
    axes = figure.subplots(len(names), columns, sharex=True, squeeze=False)
    for row, name in enumerate(names):
        source = next(m for m in everyone.motions if name in m.observables)
        letter = symbol(source.symbols.get(f"obs_{name}", ""), name)
        in_unit = f"[{unit(source.units.get(f'obs_{name}', ''))}]"
        ax, curve = axes[row, 0], exact[name]
        shown = [m.observables[name] for m in everyone.motions if name in m.observables]
        draw_lines(ax, group, _of(name, "observables"), _limits(shown, curve), log=False)
        if curve is not None:
            ax.plot(curve.t, curve.y, color=INK, linewidth=0.55, zorder=5)
        panel_title(ax, row * columns, name)
        ax.set_ylabel(f"{letter} {in_unit}")
        if columns == 2:
            ax = axes[row, 1]
            limits = log_limits([m.away.get(name) for m in everyone.motions], _size(shown))
            draw_lines(ax, group, _of(name, "away"), limits, log=True)
            panel_title(ax, row * columns + 1, "distance from the reference")
            ax.set_ylabel(f"|difference| {in_unit}")
    for ax in axes[-1]:
        ax.set_xlabel(r"$t$ [s]")
    legend.put(figure)
    return figure


def _of(name: str, kind: str) -> Callable[[Motion], Curve | None]:
    return lambda m: getattr(m, kind).get(name)


def _limits(shown: list[Curve], exact: Curve | None) -> tuple[float, float]:
    """All values; where one blew up, the neighbourhood of the reference."""
    values = [c.y for c in shown if len(c)] + ([exact.y] if exact is not None else [])
    low, high = min((float(v.min()) for v in values), default=0.0), max((float(v.max()) for v in values), default=1.0)
    if exact is not None:
        size = max(float(np.ptp(exact.y)), float(np.abs(exact.y).max()))
        if size > BLOWN_UP * (high - low):
            low, high = max(low, float(exact.y.min()) - size), min(high, float(exact.y.max()) + size)
    margin = 0.08 * (high - low) or 0.08 * abs(high) or 1.0
    return low - margin, high + margin


def _size(shown: list[Curve]) -> float:
    """Largest value, as a scale for differences."""
    return min(max((float(np.abs(c.y).max()) for c in shown if len(c)), default=1.0), 1e6)
