"""Define the plot model: what is drawn, on which axes, for whom; ``browser`` and ``paper`` draw it.

Each family of methods has a colour, each of its solvers a marker, each of the solver's settings a dash. Colour and
marker follow from the solver's name and the catalogue, not from the other solvers shown. Figures in print may lack
colour, so that there no two solvers share a marker. Colours of two families are at least 15 apart in CIEDE2000 as seen
with protanopia, deuteranopia and tritanopia, and have contrast on white and on dark pages.
"""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import numpy as np

from ..model.results import group_by

FAMILIES = {  # colour, and the prefixes of its solvers' names
    "ODE-GC": ("#3D62C7", ("gc_",)),
    "geometric": ("#62AF96", ("gauss_", "rattle", "lie_", "energy_momentum")),
    "explicit": ("#E08906", ("rk", "dop853_", "half_explicit", "scipy_")),
    "implicit": ("#BB3939", ("ida_", "ndf_", "radau_", "generalized_alpha", "al_index3")),
}
ENGINES, PLUGINS = "engines", "others"
OTHERS = {ENGINES: "#A499CF", PLUGINS: "#7C6071"}
MARKERS = ("o", "s", "^", "D", "v", "P", "h", "p")
ENGINE = "<"  # the marker of engines
IN_PRINT = (*MARKERS, ENGINE, ">", "d", "H", "8", (3, 2, 0), (4, 1, 0))  # stars and crosses mark the ends of runs
DASHES: tuple[tuple[float, Sequence[float]], ...] = ((0, ()), (0, (5, 1.6)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)))
CATALOGUE = Path(__file__).resolve().parents[2] / "solvers"
MOST = 7  # most solvers in colour


@dataclass(frozen=True)
class Axis:
    """An axis with ``title`` and ``unit`` as text; axes of a page with the same link (such as "time") zoom together.

    An axis with ``names`` has these in place of the numbers 0, 1, ...; with ``left`` zero, ``right`` and markers of a
    trace, that is a bar for each name.
    """

    title: str
    unit: str = ""
    log: bool = False
    low: float = float("nan")  # lower limit shown at first; NaN for the limit of the data
    high: float = float("nan")
    link: str = ""
    symbol: str = ""  # the title in LaTeX, for print
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class Trace:
    """A line or a set of points, in the colour of its solver; without a solver (a reference, a limit) in black.

    The page's legend switches solvers, its selector switches ``group``, and ``main=False`` hides a trace while only the
    finest settings are shown. ``end`` marks the last point: "failed" with a star, "wrong" with a cross. ``words`` are
    shown at each point, ``urls`` (from the page) open on a click: one for each point, or one for all.
    """

    name: str
    x: np.ndarray
    y: np.ndarray
    solver: str = ""
    mode: str = "lines"  # or "markers", "lines+markers"
    dash: int = 0  # 0 solid, 1 dashed, 2 dotted, 3 dash-dotted, then again from solid
    low: np.ndarray | None = None  # a band from low to high behind the line
    high: np.ndarray | None = None
    left: np.ndarray | None = None  # a bar from left to right through each point: the spread of its x
    right: np.ndarray | None = None
    reach: tuple[float, ...] = ()  # the range of the y axis that the line needs
    group: str = ""
    main: bool = True
    hollow: bool = False  # markers as outlines
    marked: bool = True  # a solver's line has a few markers
    end: str = ""
    ends: Sequence[str] = ()  # "", "failed" or "wrong" for each point
    urls: Sequence[str] = ()
    words: Sequence[str] = ()
    who: str = ""  # the solver with its name in the paper, for legends


@dataclass(frozen=True)
class Triangle:
    """A slope triangle on logarithmic axes: along ``y[0]`` from ``x[0]`` to ``x[1]``, then up to ``y[1]``."""

    order: int  # the slope of its third side: error ~ step^order
    x: tuple[float, float]
    y: tuple[float, float]


@dataclass(frozen=True)
class Plot:
    """A panel; ``name`` is unique on its page and names the files that are saved."""

    name: str
    title: str
    caption: str
    x: Axis
    y: Axis
    traces: Sequence[Trace]
    wide: bool = False  # over the whole width of the page
    marks: Mapping[str, Sequence[float]] = field(default_factory=dict)  # words: values of x with a thin line
    focus: Sequence[str] = ()  # solvers in colour until the reader chooses others; all if empty
    finding: str = ""  # the title on a page: the result in numbers
    triangles: Sequence[Triangle] = ()


@dataclass(frozen=True)
class Chapter:
    """The plots under one heading."""

    title: str
    note: str
    plots: tuple[Plot, ...]


def choose_end_mark(status: str) -> str:
    """Return the mark at the end of a run with this status: "", "failed" or "wrong"."""
    sound = ("success", "inaccurate", "refused", "unfinished", "unknown")
    return "" if status in sound else "wrong" if status == "wrong" else "failed"


@dataclass(frozen=True)
class LineStyle:
    """The colour, marker and family of a solver."""

    colour: str
    marker: str | tuple[int, int, int]  # a name or, in print, matplotlib's sides, style and angle
    family: str = ""


@cache
def list_catalogue_styles() -> dict[str, LineStyle]:
    """Return by name the line style of every solver and engine in the catalogue, read once from its files' names."""
    out: dict[str, LineStyle] = {}
    names = {p.stem for p in CATALOGUE.glob("[!_]*.py")}
    for family, (colour, begins) in FAMILIES.items():
        own = sorted(n for n in names if n.startswith(begins))
        out |= {name: LineStyle(colour, MARKERS[k % len(MARKERS)], family) for k, name in enumerate(own)}
    out |= {n: _make_other_style(n) for n in sorted(names - set(out))}
    engines = sorted(p.stem for p in (CATALOGUE / "engines").glob("[!_]*.py"))
    return out | {name: LineStyle(OTHERS[ENGINES], ENGINE, ENGINES) for name in engines}


def choose_styles(solvers: Iterable[str]) -> dict[str, LineStyle]:
    """Return a line style for every solver, independent of the other solvers; all plug-ins share a colour."""
    return {name: list_catalogue_styles().get(name) or _make_other_style(name) for name in sorted(set(solvers))}


def choose_print_styles(solvers: Iterable[str]) -> dict[str, LineStyle]:
    """Return line styles in which no two solvers share a marker, as far as there are markers."""
    found, taken = choose_styles(solvers), set[str | tuple[int, int, int]]()
    for name, look in found.items():
        free = look.marker not in taken
        marker = look.marker if free else next((m for m in IN_PRINT if m not in taken), look.marker)
        found[name] = replace(look, marker=marker)
        taken.add(marker)
    return found


def _make_other_style(name: str) -> LineStyle:
    """Return the line style of a solver outside the families, with a marker that follows from its name."""
    return LineStyle(OTHERS[PLUGINS], MARKERS[hashlib.sha256(name.encode()).digest()[0] % len(MARKERS)], PLUGINS)


def group_by_family(found: dict[str, LineStyle]) -> dict[str, list[str]]:
    """Group solvers by family, in the order of the families, given their line styles."""
    order = [*FAMILIES, ENGINES, PLUGINS]
    by_family = {f: [name for name, look in found.items() if look.family == f] for f in order}
    return {f: names for f, names in by_family.items() if names}


def choose_focus(best_first: Iterable[str]) -> tuple[str, ...]:
    """Choose at most ``MOST`` solvers to be shown in colour, given the best first.

    They are the best and the worst, then the best of every family, then the next best.
    """
    order = list(dict.fromkeys(best_first))
    firsts = [names[0] for names in group_by(order, lambda name: choose_styles([name])[name].family).values()]
    return tuple(dict.fromkeys([*order[:1], *order[-1:], *firsts, *order]))[:MOST]
