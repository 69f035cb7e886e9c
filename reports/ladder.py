"""The page of ``mbsbench ladder``: one file with all entries, their costs and their errors."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..harness.ladder.ranking import TARGET, Row
from .plots.spec import Axis, Plot, Trace, looks
from .rendering import write_file
from .trial import draw_chart


def write_page(path: Path, rows: Sequence[Row], value: str | None = None) -> None:
    """Write ``path``: the table of ``rows``, and error against CPU time; without the published ``value`` a trial."""
    words = "Error against CPU time at each setting, with the same intervals."
    charts = [draw_chart(words, [_plot(rows)], looks(r.solver for r in rows), columns=1)]
    write_file(path, "ladder.html", title="Ladder", rows=rows, target=TARGET, charts=charts, stamp="", value=value)


def _plot(rows: Sequence[Row]) -> Plot:
    traces = []
    for r in (r for r in rows if r.frontier):
        error = np.array([e for e, _ in r.frontier])
        cost, low, high = np.array([[c.value, c.low, c.high] for _, c in r.frontier]).T
        traces.append(Trace(r.solver, cost, error, r.solver, "lines+markers", left=low, right=high))
    axes = Axis("CPU time", "s", log=True), Axis("error / length of the motion", log=True)
    return Plot("ladder", "Error against CPU time", "geometric means over instances", *axes, traces)
