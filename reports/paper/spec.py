"""The parts of a figure of the paper as data: which runs and which panels."""

from dataclasses import dataclass

from ..plots.spec import Axis

Window = tuple[float, float]
PRINTED, RECOMMENDED = "as printed", "recommended"  # labels of the suite ``paper``


@dataclass(frozen=True)
class Pick:
    """Runs of the suite ``paper``: all under a label that solve one variant with these solvers."""

    label: str
    variant: str  # a problem with its parameters, e.g. heavy_top[t_end=1]
    solvers: tuple[str, ...]  # in the order of the legend
    every: bool = True  # False: of each solver one, with the largest step (the printed one) or the smallest tolerance


@dataclass(frozen=True)
class Panel:
    """Axes over time. ``of`` are names of series; each is drawn for every run of the figure."""

    title: str
    of: tuple[str, ...]
    axis: Axis
    window: Window
    tightest: bool = False  # of each solver the smallest tolerance alone
    exact: str = ""  # series of the reference
    labels: tuple[str, ...] = ()  # beside the lines of several series
    band: bool = False  # the benchmark's limit on the energy error, shaded
    continued: bool = False  # the panel before it, at another time: no letter of its own
    width: int = 6  # of 12


@dataclass(frozen=True)
class Sketch:
    """The mechanism at t = 0, drawn from the stored poses and joints of the first run that has them."""

    title: str
    view: str  # name in reports.paper.sketch
    width: int = 6


@dataclass(frozen=True)
class PaperFigure:
    """One figure with the settings of one label; ``rows`` from the top, panels from the left."""

    number: int
    label: str
    section: str
    title: str
    picks: tuple[Pick, ...]
    rows: tuple[tuple[Panel | Sketch, ...], ...]
    not_printed: tuple[str, ...] = ()  # settings that the paper does not give
    height: float = 1.75  # [in] of a row

    @property
    def name(self) -> str:
        """Name of its files."""
        return f"fig{self.number:02d}" + ("" if self.label == PRINTED else f"-{self.label}")

    def panels(self) -> list[Panel | Sketch]:
        return [p for row in self.rows for p in row]
