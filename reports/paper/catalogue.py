"""Define the paper's twelve figures from ``figures.toml``: which runs and which panels they show."""

import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..plots.spec import Axis

PRINTED, RECOMMENDED = "as printed", "recommended"  # labels of the suite ``paper``


@dataclass(frozen=True)
class RunSelection:
    """A selection of runs of the suite ``paper``: one label, one variant and the given solvers."""

    label: str
    variant: str  # a problem with its parameters, e.g. heavy_top[t_end=1]
    solvers: tuple[str, ...]  # in the order of the legend
    every: bool  # False: one per solver, with the largest step (the printed one) or the smallest tolerance


@dataclass(frozen=True)
class Panel:
    """A panel over time; each series named in ``of`` is drawn for every run of the figure."""

    title: str
    of: tuple[str, ...]
    axis: Axis
    window: tuple[float, float] = (0.0, 0.0)  # [s]; the figure's window if the panel has none
    tightest: bool = False  # draw each solver's smallest tolerance only
    exact: str = ""  # series of the reference
    labels: tuple[str, ...] = ()  # labels beside the lines of several series
    band: bool = False  # the benchmark's limit on the energy error, shaded
    continued: bool = False  # continues the panel before at another time, without its own letter
    width: int = 6  # of 12 columns


@dataclass(frozen=True)
class Sketch:
    """The mechanism at t = 0, drawn from the stored poses and joints of the first run that has them."""

    title: str
    width: int = 6


@dataclass(frozen=True)
class PaperFigure:
    """A figure with the settings of one label; ``rows`` are from the top, panels from the left."""

    number: int  # as in the paper
    label: str  # the suite's label of its runs: PRINTED or RECOMMENDED
    section: str
    title: str
    picks: tuple[RunSelection, ...]
    rows: tuple[tuple[Panel | Sketch, ...], ...]
    not_printed: tuple[str, ...]  # settings that the paper does not give
    height: float  # [in] height of a row

    @property
    def name(self) -> str:
        """The name of its files."""
        return f"fig{self.number:02d}" + ("" if self.label == PRINTED else f"-{self.label}")

    def panels(self) -> list[Panel | Sketch]:
        """Return the panels and sketches of all rows, in reading order."""
        return [p for row in self.rows for p in row]


def _read_figures(given: dict[str, Any]) -> Iterator[PaperFigure]:
    """Yield the figures of ``given``, the contents of ``figures.toml``: by number, as printed and then recommended.

    A label without runs has no figure. A panel without a window of its own gets that of the figure.
    """
    sketches = {name: Sketch(**v) for name, v in given["sketches"].items()}
    panels = {}
    for name, v in given["panels"].items():
        tuples = {key: tuple(v[key]) for key in ("of", "labels", "window") if key in v}
        panels[name] = Panel(**{**v, **tuples, "axis": Axis(**v["axis"])})
    for f in given["figures"]:
        window = tuple(f.get("window", (0.0, 0.0)))
        in_window = {k: p if any(p.window) else replace(p, window=window) for k, p in panels.items()}
        rows = tuple(tuple((sketches | in_window)[name] for name in row) for row in f["rows"])
        for label, key, left_open in (
            (PRINTED, "printed", f.get("not_printed", ())),
            (RECOMMENDED, "recommended", f.get("recommended_not_printed", ())),
        ):
            picks = tuple(
                RunSelection(of, f["variant"], tuple(solvers), every) for of, solvers, every in f.get(key, ())
            )
            words = tuple(given["not_printed"][k] for k in left_open)
            if picks:
                height = f.get("height", 1.75)
                yield PaperFigure(f["number"], label, f["section"], f["title"], picks, rows, words, height)


FIGURES = tuple(_read_figures(tomllib.loads((Path(__file__).parent / "figures.toml").read_text(encoding="utf-8"))))
