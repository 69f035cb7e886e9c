"""The matrix of problem against solver: one entry each, never empty."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from .accuracy import energy_kind, measure_for
from .results import Results, Run, Variant, by_solver
from .scores import Score, score
from .variants import VariantGroup, broadest, themselves
from .words import Mark, mark, number, seconds

FEWEST_DIGITS, MOST_DIGITS = 0.0, 14.0  # of a bar: empty when exact to 14 digits, full when none is right


@dataclass(frozen=True)
class Figure:
    """One number of an entry; ``share`` of a bar is how many digits are lost, 0 to 100, or None for no bar."""

    key: str
    name: str
    text: str
    share: float | None = None


@dataclass(frozen=True)
class Entry:
    """What a solver made of a problem: its finest settings in numbers, all of them counted."""

    head: Run
    mark: Mark
    score: Score
    figures: tuple[Figure, ...]
    energy: str

    @property
    def kind(self) -> str:
        """That of the finest settings, but one wrong run colours all."""
        return "wrong" if self.score.wrong else self.mark.kind

    @property
    def measured(self) -> bool:
        """There is a number at all: not so for a refusal."""
        return any(f.share is not None for f in self.figures)


@dataclass(frozen=True)
class Row:
    """A problem under one label of the suite; None for a solver that did not take it."""

    variant: Variant
    entries: tuple[Entry | None, ...]


@dataclass(frozen=True)
class Part:
    """The rows of one label, over the solvers that it has."""

    label: str
    solvers: tuple[str, ...]
    rows: tuple[Row, ...]


def matrix(results: Results) -> list[Part]:
    """One part a label, the plain comparison first; one row a variant there, one entry a solver."""
    first = broadest(results)
    variants = themselves(results, first)
    out = []
    for label in sorted(results.labels(), key=lambda name: name != first):
        own = [c for c in results.runs if c.record.label == label]
        solvers = tuple(s for s in results.solvers if any(c.record.solver == s for c in own))
        rows = []
        for variant in variants:
            runs = [[c for c in variant.runs if (c.record.solver, c.record.label) == (s, label)] for s in solvers]
            if any(runs):
                rows.append(Row(variant, tuple(entry(variant, some) if some else None for some in runs)))
        if rows:
            out.append(Part(label, solvers, tuple(rows)))
    return out


def tally(results: Results, own: VariantGroup) -> list[tuple[Variant, list[Score | None]]]:
    """Variants by solvers, counted; None for a solver that did not take one."""
    counted = [(p, by_solver(p.runs)) for p in own.variants]
    return [(p, [score(runs[s]) if s in runs else None for s in results.solvers]) for p, runs in counted]


def entry(variant: Variant, runs: Sequence[Run]) -> Entry:
    """The finest settings stand for the entry, whatever became of them."""
    head = min(runs, key=lambda c: c.finest_first)
    r, measure = head.record, measure_for(variant.runs)
    error, scale = (measure.of(head), 1.0) if measure else (math.nan, 1.0)
    if measure and measure.unit == "m":
        scale = r.length_scale_m
    name = "error" if measure is None or measure.until is None else f"error to {measure.until:.2g} s"
    figures = (
        Figure("error", name, _with(error, measure.unit) if measure else "no reference", _lost(error, scale)),
        Figure("energy", "ΔE", _with(r.energy_drift_max_J, "J"), _lost(r.energy_drift_max_J, r.energy_scale_J)),
        Figure("phi", "|φ|", _with(r.phi_max, "m"), _lost(r.phi_max, r.length_scale_m)),
        Figure("cost", "CPU", seconds(r.cpu_median_s)),
    )  # fmt: skip
    return Entry(head, mark(head.status), score(runs), figures, energy_kind(head))


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
