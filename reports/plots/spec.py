"""The plot model: what is drawn, on which axes, for whom. Built once; ``browser`` and ``printed`` draw it.

A colour for each family of methods, a marker for each solver of it, a dash for each of its settings, everywhere: both
follow from the solver's name and the catalogue, not from who else took part; figures in print may have no colour, so
that there no two solvers have one marker. Colours of two families are at least 15
apart in CIEDE2000 as seen with protanopia, deuteranopia and tritanopia, and stand out on white and on dark pages.
"""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import numpy as np

from ..model.results import group_by

FAMILIES = {  # colour, and how the names of its solvers begin
    "ODE-GC": ("#3D62C7", ("gc_",)),
    "geometric": ("#62AF96", ("gauss_", "rattle", "lie_", "energy_momentum")),
    "explicit": ("#E08906", ("rk", "dop853_", "half_explicit", "scipy_")),
    "implicit": ("#BB3939", ("ida_", "ndf_", "radau_", "generalized_alpha", "al_index3")),
}
ENGINES, PLUGINS = "engines", "others"
OTHERS = {ENGINES: "#A499CF", PLUGINS: "#7C6071"}
MARKERS = ("o", "s", "^", "D", "v", "P", "h", "p")
ENGINE = "<"  # the marker of engines
IN_PRINT = (*MARKERS, ENGINE, ">", "d", "H", "8", (3, 2, 0), (4, 1, 0))  # the star and the cross mark ends of runs
DASHES: tuple[tuple[float, Sequence[float]], ...] = ((0, ()), (0, (5, 1.6)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)))
CATALOGUE = Path(__file__).resolve().parents[2] / "solvers"
MOST = 7  # solvers in colour


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
    marked: bool = True  # a line of a solver has its marker here and there
    end: str = ""
    ends: Sequence[str] = ()  # for points: "", "failed" or "wrong" each
    urls: Sequence[str] = ()
    words: Sequence[str] = ()
    who: str = ""  # the solver with the paper's name of it, for legends


@dataclass(frozen=True)
class Triangle:
    """A slope triangle on logarithmic axes: along ``y[0]`` from ``x[0]`` to ``x[1]``, there up to ``y[1]``."""

    order: int  # the slope of its third side: error ~ step^order
    x: tuple[float, float]
    y: tuple[float, float]


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
    triangles: Sequence[Triangle] = ()


@dataclass(frozen=True)
class Chapter:
    """Plots under one heading."""

    title: str
    note: str
    plots: tuple[Plot, ...]


def end_of(status: str) -> str:
    """How a plot marks the end of a run with this status."""
    sound = ("success", "inaccurate", "refused", "unfinished", "unknown")
    return "" if status in sound else "wrong" if status == "wrong" else "failed"


@dataclass(frozen=True)
class Look:
    """Look of a solver."""

    colour: str
    marker: str | tuple[int, int, int]  # a name or, in print, sides, style and angle of matplotlib
    family: str = ""


@cache
def shipped_looks() -> dict[str, Look]:
    """The catalogue's and its engines."""
    out: dict[str, Look] = {}
    names = {p.stem for p in CATALOGUE.glob("[!_]*.py")}
    for family, (colour, begins) in FAMILIES.items():
        own = sorted(n for n in names if n.startswith(begins))
        out |= {name: Look(colour, MARKERS[k % len(MARKERS)], family) for k, name in enumerate(own)}
    out |= {n: _other(n) for n in sorted(names - set(out))}
    engines = sorted(p.stem for p in (CATALOGUE / "engines").glob("[!_]*.py"))
    return out | {name: Look(OTHERS[ENGINES], ENGINE, ENGINES) for name in engines}


def looks(solvers: Iterable[str]) -> dict[str, Look]:
    """A look for every solver; those of plug-ins share a colour."""
    return {name: shipped_looks().get(name) or _other(name) for name in sorted(set(solvers))}


def looks_in_print(solvers: Iterable[str]) -> dict[str, Look]:
    """Return ``looks`` in which no two solvers have one marker, as far as there are markers."""
    found, taken = looks(solvers), set[str | tuple[int, int, int]]()
    for name, look in found.items():
        free = look.marker not in taken
        marker = look.marker if free else next((m for m in IN_PRINT if m not in taken), look.marker)
        found[name] = replace(look, marker=marker)
        taken.add(marker)
    return found


def _other(name: str) -> Look:
    return Look(OTHERS[PLUGINS], MARKERS[hashlib.sha256(name.encode()).digest()[0] % len(MARKERS)], PLUGINS)


def families(found: dict[str, Look]) -> dict[str, list[str]]:
    """Solvers by family, in the order of the families."""
    order = [*FAMILIES, ENGINES, PLUGINS]
    by_family = {f: [name for name, look in found.items() if look.family == f] for f in order}
    return {f: names for f, names in by_family.items() if names}


def choose_focus(best_first: Iterable[str]) -> tuple[str, ...]:
    """The best and the worst solver, then the best of every family, then the next best: those that a chart colours."""
    order = list(dict.fromkeys(best_first))
    firsts = [names[0] for names in group_by(order, lambda name: looks([name])[name].family).values()]
    return tuple(dict.fromkeys([*order[:1], *order[-1:], *firsts, *order]))[:MOST]
