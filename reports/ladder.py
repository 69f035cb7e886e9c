"""The page of ``mbsbench ladder``: one file with all entries, their costs and their errors."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..harness.ladder.ranking import TARGET, Row
from .plots.spec import Axis, Plot, Trace, looks
from .tried import draw_chart, write_file


def write_page(path: Path, rows: Sequence[Row]) -> None:
    """Write ``path``: the table of ``rows``, and error against CPU time."""
    chart = draw_chart("", [_plot(rows)], looks(r.solver for r in rows), columns=1)
    write_file(path, "ladder.html", rows=rows, target=TARGET, image=chart["image"])


def _plot(rows: Sequence[Row]) -> Plot:
    traces = []
    for r in (r for r in rows if r.frontier):
        error = np.array([e for e, _ in r.frontier])
        cost, low, high = np.array([[c.value, c.low, c.high] for _, c in r.frontier]).T
        traces.append(Trace(r.solver, cost, error, r.solver, "lines+markers", left=low, right=high))
    axes = Axis("CPU time", "s", log=True), Axis("error / length of the motion", log=True)
    return Plot("ladder", "Error against CPU time", "geometric means over instances", *axes, traces)
