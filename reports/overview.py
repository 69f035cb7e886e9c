"""The matrix of solver against problem: one entry each, never empty."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from reports.accuracy import drifts, measure_for
from reports.reading import Cell, Posing, Run
from reports.settings import shared_options
from reports.words import Mark, mark, number, seconds

WORST_FIRST = ("wrong", "failed", "refused", "good")
FEWEST_DIGITS, MOST_DIGITS = 0.0, 14.0  # of a bar: empty when exact to 14 digits, full when none is right


@dataclass(frozen=True)
class Figure:
    """One number of an entry; ``share`` of a bar is how many digits are lost, 0 to 100, or None for no bar."""

    name: str
    text: str
    share: float | None = None


@dataclass(frozen=True)
class Entry:
    """What a solver made of a problem: its finest settings in numbers, the others by their marks."""

    head: Cell
    mark: Mark
    others: tuple[tuple[Cell, Mark], ...]
    figures: tuple[Figure, ...]
    energy: str
    alike: frozenset[str]  # settings that need not be said

    @property
    def measured(self) -> bool:
        """There is a number at all: not so for a refusal."""
        return any(f.share is not None for f in self.figures)

    @property
    def kind(self) -> str:
        """The worst of all its cells: it decides the colour."""
        kinds = {self.mark.kind, *(m.kind for _, m in self.others)}
        return next(k for k in WORST_FIRST if k in kinds)


@dataclass(frozen=True)
class Row:
    """A solver under one label of the suite; None where that was not run."""

    solver: str
    paper_label: str
    entries: tuple[Entry | None, ...]


@dataclass(frozen=True)
class Part:
    """The rows of one label, over the problems that it took."""

    label: str
    posings: tuple[Posing, ...]
    rows: tuple[Row, ...]


def matrix(run: Run) -> list[Part]:
    """One part a label, one row a solver, one entry a problem."""
    out = []
    for label in run.labels():
        rows = []
        posings = tuple(p for p in run.posings if any(c.record.label == label for c in p.cells))
        for solver in run.solvers:
            own = [[c for c in p.cells if (c.record.solver, c.record.label) == (solver, label)] for p in posings]
            if any(own):
                name = next(c.record.paper_label for cells in own for c in cells)
                entries = [entry(p, cells) if cells else None for p, cells in zip(posings, own, strict=True)]
                rows.append(Row(solver, name, tuple(entries)))
        out.append(Part(label, posings, tuple(rows)))
    return out


def entry(posing: Posing, cells: Sequence[Cell]) -> Entry:
    """The finest settings stand for the entry, whatever became of them."""
    ranked = sorted(cells, key=lambda c: (c.fineness, len(c.options), c.record.case))
    head, r = ranked[0], ranked[0].record
    measure = measure_for(posing.cells)
    error, scale = (measure.of(head), 1.0) if measure else (math.nan, 1.0)
    if measure and measure.unit == "m":
        scale = r.length_scale_m
    figures = (
        Figure("ΔE", _with(r.energy_drift_max_J, "J"), _lost(r.energy_drift_max_J, r.energy_scale_J)),
        Figure("error", _with(error, measure.unit) if measure else "no reference", _lost(error, scale)),
        Figure("|φ|", _with(r.phi_max, "m"), _lost(r.phi_max, r.length_scale_m)),
        Figure("CPU", seconds(r.cpu_median_s)),
    )  # fmt: skip
    wanders, alike = drifts(head), shared_options(cells)[r.solver]
    energy = "" if wanders is None else "drifts" if wanders else "bounded"
    return Entry(head, mark(head.status), tuple((c, mark(c.status)) for c in ranked[1:]), figures, energy, alike)


def _with(value: float, unit: str) -> str:
    return "none" if math.isnan(value) else f"{number(value)} {unit}"


def _lost(value: float, scale: float) -> float | None:
    """Part of 14 digits that are lost, in percent."""
    if math.isnan(value) or not scale > 0.0:
        return None
    if value <= 0.0:
        return 0.0
    digits = min(max(-math.log10(min(value, 1e300) / scale), FEWEST_DIGITS), MOST_DIGITS)
    return round(100.0 * (1.0 - digits / MOST_DIGITS), 1)
