"""The page of ``mbsbench ladder``: one file with all entries, their costs and their errors."""

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from jinja2 import Environment, FileSystemLoader

from ..harness.files import write_text
from ..harness.ladder.ranking import TARGET, Row
from .plots.palette import looks
from .plots.printed import figure
from .plots.spec import Axis, Plot, Trace
from .tried import TEMPLATES, image_of


def write_page(path: Path, rows: Sequence[Row]) -> None:
    """Write ``path``: the table of ``rows``, and error against CPU time."""
    environment = Environment(loader=FileSystemLoader(TEMPLATES), autoescape=True)
    environment.filters["seconds"] = show_seconds
    image = image_of(partial(figure, [_plot(rows)], looks(r.solver for r in rows), columns=1))
    write_text(path, environment.get_template("ladder.html").render(rows=rows, target=TARGET, image=image))


def _plot(rows: Sequence[Row]) -> Plot:
    traces = []
    for r in (r for r in rows if r.frontier):
        error = np.array([e for e, _ in r.frontier])
        cost, low, high = np.array([[c.value, c.low, c.high] for _, c in r.frontier]).T
        traces.append(Trace(r.solver, cost, error, r.solver, "lines+markers", left=low, right=high))
    axes = Axis("CPU time", "s", log=True), Axis("error / length of the motion", log=True)
    return Plot("ladder", "Error against CPU time", "geometric means over instances", *axes, traces)


def show_seconds(value: float) -> str:
    """A time with two digits."""
    return f"{value:.2g} s" if math.isfinite(value) else "-"
