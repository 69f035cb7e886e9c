"""Interactive plots as plain data: what is drawn, on which axes, for whom. ``assets/plots.js`` does the drawing.

Points keep their numbers to seven digits. Curves over time, of which a run has thousands, are told in steps: times and
values on linear axes to 1/8190 of their own range, values on logarithmic ones to a tenth of a percent.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .packing import Steps
from .palette import Look


@dataclass(frozen=True)
class Axis:
    """``title`` and ``unit`` as text; a link (such as "time") lets all axes of a page with it zoom together."""

    title: str
    unit: str = ""
    log: bool = False
    low: float = float("nan")  # of the range shown at first; NaN leaves it to the data
    high: float = float("nan")
    link: str = ""


@dataclass(frozen=True)
class Trace:
    """One line or set of points, in the colour of its solver; without a solver (a reference, a limit) in ink.

    The page's legend switches solvers, its selector ``group``, and ``main=False`` hides a trace while only the finest
    settings are asked for. ``end`` marks the last point: "failed" with a star, "wrong" with a cross. ``words`` are
    shown at each point, ``urls`` (from the page) open on a click: one for each point, or one for all.
    """

    name: str
    x: np.ndarray
    y: np.ndarray
    solver: str = ""
    mode: str = "lines"  # or "markers", "lines+markers"
    dash: int = 0  # 0 solid, 1 dashed, 2 dotted, 3 dash-dotted
    low: np.ndarray | None = None  # a band from low to high behind the line
    high: np.ndarray | None = None
    group: str = ""
    main: bool = True
    hollow: bool = False  # markers as outlines
    end: str = ""
    ends: Sequence[str] = ()  # for points: "", "failed" or "wrong" each
    urls: Sequence[str] = ()
    words: Sequence[str] = ()


@dataclass(frozen=True)
class Plot:
    """One panel; ``name`` is unlike any other on its page and names the files that are saved."""

    name: str
    title: str
    caption: str
    x: Axis
    y: Axis
    traces: Sequence[Trace]
    wide: bool = False  # over the whole width of the page
    marks: Mapping[str, Sequence[float]] = field(default_factory=dict)  # words: values of x with a thin line


def plain(plots: Sequence[Plot], looks: Mapping[str, Look]) -> dict[str, Any]:
    """For a data file: short names, nothing that is a default; texts that come again and again by their number."""
    texts: dict[str, int] = {}
    found = {
        p.name: {
            "title": p.title,
            "x": _axis(p.x),
            "y": _axis(p.y),
            "traces": [_trace(t, looks, p, texts) for t in p.traces],
            "marks": {k: list(v) for k, v in p.marks.items()},
        }
        for p in plots
    }
    return {"texts": list(texts), "plots": found}


def _axis(axis: Axis) -> dict[str, Any]:
    return {k: v for k, v in vars(axis).items() if v == v and v != "" and v is not False}


def _trace(trace: Trace, looks: Mapping[str, Look], plot: Plot, texts: dict[str, int]) -> dict[str, Any]:
    rough = bool(plot.x.link)

    def told(values: np.ndarray, axis: Axis) -> Any:
        return Steps(values, log=axis.log) if rough else np.asarray(values)

    out: dict[str, Any] = {"name": trace.name, "x": told(trace.x, plot.x), "y": told(trace.y, plot.y)}
    if trace.mode != "lines":
        out["mode"] = trace.mode
    for key in ("solver", "dash", "group", "end"):
        if getattr(trace, key):
            out[key] = getattr(trace, key)
    for key in ("ends", "urls", "words"):
        if any(getattr(trace, key)):
            out[key] = np.array([texts.setdefault(t, len(texts)) for t in getattr(trace, key)])
    if trace.low is not None and trace.high is not None:
        out |= {"low": told(trace.low, plot.y), "high": told(trace.high, plot.y)}
    if not trace.main:
        out["main"] = False
    if trace.hollow:
        out["hollow"] = True
    if trace.solver in looks:
        out |= {"colour": looks[trace.solver].colour, "marker": looks[trace.solver].marker}
    return out
