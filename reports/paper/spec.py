"""What a figure of the paper is made of, as data: which runs, which panels, what the paper says about them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

Window = tuple[float, float]


@dataclass(frozen=True)
class Pick:
    """A run by its settings, as they stand in records: those that differ from the defaults, and the step asked for."""

    key: str  # by which panels and sayings of the figure name it
    solver: str
    problem: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    dt: float | None = None
    rtol: float | None = None
    max_step: float | None = None
    words: str = ""  # beside the solver's name in the legend, where the step does not tell its lines apart


@dataclass(frozen=True)
class Panel:
    """Axes over time. ``of`` are names of series; each is drawn for every pick, or for those in ``only``."""

    title: str
    of: tuple[str, ...]
    axis: str
    window: Window
    log: bool = False
    only: tuple[str, ...] = ()  # keys; empty: all
    exact: str = ""  # series of the reference
    labels: tuple[str, ...] = ()  # beside the lines of several series
    band: bool = False  # the benchmark's limit on the energy error, shaded
    continued: bool = False  # the panel before it, at another time: no letter of its own
    width: int = 6  # of 12


@dataclass(frozen=True)
class Sketch:
    """The mechanism at t = 0, drawn from the stored poses and joints of the first pick that has them."""

    title: str
    view: str  # name in reports.paper.sketch
    width: int = 6


@dataclass(frozen=True)
class Says:
    """What the paper says, in a line, and what is measured beside it (a name in reports.paper.measures)."""

    words: str
    measure: str
    picks: tuple[str, ...] = ()  # keys; empty: all
    series: str = ""
    window: Window | None = None
    fails_at: float | None = None  # [s] where the paper says that it stops
    runs: bool = False  # the paper says that it gets to the end


@dataclass(frozen=True)
class PaperFigure:
    """One figure in one variant; ``rows`` from the top, panels from the left."""

    number: int
    variant: str  # "as printed" or "recommended"
    section: str
    title: str
    picks: tuple[Pick, ...]
    rows: tuple[tuple[Panel | Sketch, ...], ...]
    says: tuple[Says, ...] = ()
    not_printed: tuple[str, ...] = ()  # settings that the paper does not give, and what is taken
    height: float = 1.75  # [in] of a row

    @property
    def name(self) -> str:
        """Of its files."""
        return f"fig{self.number:02d}" + ("" if self.variant == "as printed" else f"-{self.variant}")

    def panels(self) -> list[Panel | Sketch]:
        return [p for row in self.rows for p in row]
