"""Write the page of ``mbsbench ladder``: one file with all entries, their costs and their errors."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...harness.lab.ladder.ranking import TARGET, RankedEntry
from ..plots.spec import Axis, Plot, Trace, choose_styles
from ..rendering import write_file
from ..trial import draw_chart


def write_page(path: Path, rows: Sequence[RankedEntry], value: str | None = None) -> None:
    """Write the page of a ladder to ``path``: the table of its entries ``rows``, and error against CPU time.

    The page says that it is a trial if the ladder's ``value``, which determines the instances, is not published yet.
    """
    words = "Error against CPU time at each setting, with the same intervals."
    charts = [draw_chart(words, [_plot_costs(rows)], choose_styles(r.solver for r in rows), columns=1)]
    write_file(path, "ladder.html", title="Ladder", rows=rows, target=TARGET, charts=charts, stamp="", value=value)


def _plot_costs(rows: Sequence[RankedEntry]) -> Plot:
    """Plot error against CPU time at each setting of every entry, as geometric means over instances with intervals."""
    traces = []
    for r in (r for r in rows if r.frontier):
        error = np.array([e for e, _ in r.frontier])
        cost, low, high = np.array([[c.value, c.low, c.high] for _, c in r.frontier]).T
        traces.append(Trace(r.solver, cost, error, r.solver, "lines+markers", left=low, right=high))
    axes = Axis("CPU time", "s", log=True), Axis("error / length of the motion", log=True)
    return Plot("ladder", "Error against CPU time", "geometric means over instances", *axes, traces)
