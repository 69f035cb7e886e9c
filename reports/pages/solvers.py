"""A page for each solver: where it holds, where it fails and why, and what its options did."""

from collections.abc import Sequence
from dataclasses import dataclass

from ..model.posings import broadest, groups_of, themselves
from ..model.reading import Cell, Run, text_of
from ..model.scores import Score, score
from .base import Page, Site

CHIPS = 8  # cells named in a row; the problem's page has all


@dataclass(frozen=True)
class Option:
    """One value of one option, with how its cells ended."""

    words: str
    score: Score


def write(run: Run, site: Site) -> Page | None:
    """``solver-<name>.html`` of every solver; none of them in the navigation."""
    label = broadest(run)
    plain = {p.title for p in themselves(run, label)}
    for name in run.solvers:
        cells = [c for c in run.cells if c.record.solver == name]
        rows = [(p, group, [c for c in own if c.record.solver == name]) for p in run.posings
                for group, own in groups_of(p, label).items()]  # fmt: skip
        rows = [row for row in rows if row[2]]
        site.write(
            Page(name, site.url(name)), "solver.html", solver=name, most=CHIPS, cells=cells, score=score(cells),
            paper_label=cells[0].record.paper_label, options=_options(cells), reasons=_reasons(cells),
            rows=[row for row in rows if row[0].title in plain],
            apart=[row for row in rows if row[0].title not in plain],
            loud=sorted(cells, key=lambda c: (c.record.label != label, c.posing not in plain)),
        )  # fmt: skip
    return None


def _options(cells: Sequence[Cell]) -> list[Option]:
    """Every option that differs from its default somewhere; first the cells at all defaults."""
    found: dict[str, list[Cell]] = {}
    for c in cells:
        for words in [f"{k} = {text_of(v)}" for k, v in c.options.items()] or ["all at their defaults"]:
            found.setdefault(words, []).append(c)
    ordered = sorted(found, key=lambda words: (words != "all at their defaults", words))
    return [Option(words, score(found[words])) for words in ordered]


def _reasons(cells: Sequence[Cell]) -> list[tuple[str, list[Cell]]]:
    """Cells that did not hold, together where they ended alike; the most frequent ending first."""
    found: dict[str, list[Cell]] = {}
    for c in cells:
        if not c.succeeded:
            found.setdefault(c.status, []).append(c)
    return sorted(found.items(), key=lambda kv: (kv[0] != "wrong", -len(kv[1])))
