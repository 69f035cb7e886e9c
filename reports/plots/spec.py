"""The plot model: what is drawn, on which axes, for whom. Built once; ``browser`` and ``printed`` draw it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Axis:
    """``title`` and ``unit`` as text; a link (such as "time") lets all axes of a page with it zoom together."""

    title: str
    unit: str = ""
    log: bool = False
    low: float = float("nan")  # of the range shown at first; NaN leaves it to the data
    high: float = float("nan")
    link: str = ""
    symbol: str = ""  # the title in LaTeX, for print


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
    dash: int = 0  # 0 solid, 1 dashed, 2 dotted, 3 dash-dotted, and so on from the start
    low: np.ndarray | None = None  # a band from low to high behind the line
    high: np.ndarray | None = None
    left: np.ndarray | None = None  # a bar from left to right through each point: the spread of its x
    right: np.ndarray | None = None
    reach: tuple[float, ...] = ()  # the stretch of a logarithmic axis that the line needs
    group: str = ""
    main: bool = True
    hollow: bool = False  # markers as outlines
    end: str = ""
    ends: Sequence[str] = ()  # for points: "", "failed" or "wrong" each
    urls: Sequence[str] = ()
    words: Sequence[str] = ()
    who: str = ""  # the solver with the paper's name of it, for legends


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
    focus: Sequence[str] = ()  # solvers in colour until a reader asks for others; all where there are none
    finding: str = ""  # the title on a page: what is drawn with what it shows, in numbers


@dataclass(frozen=True)
class Chapter:
    """Plots under one heading."""

    title: str
    note: str
    plots: tuple[Plot, ...]


def end_of(status: str) -> str:
    """How a plot marks the end of a run with this status."""
    return {"success": "", "inaccurate": "", "refused": "", "unfinished": "", "unknown": "", "wrong": "wrong"}.get(
        status, "failed"
    )
