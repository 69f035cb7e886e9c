"""A page for each solver: where it succeeds, where it fails and why, and what its options did."""

from collections.abc import Sequence
from dataclasses import dataclass

from ...model.results import Results, Run, by_solver, grouped, text_of
from ...model.scores import Score, score
from ...model.variants import broadest, groups_of, themselves
from ..base import Page, Site

CHIPS = 8  # runs named in a row; the problem's page has all


@dataclass(frozen=True)
class Option:
    """One value of one option, with how its runs ended."""

    words: str
    score: Score


def write(results: Results, site: Site) -> Page | None:
    """``solver-<name>.html`` of every solver; none of them in the navigation."""
    label = broadest(results)
    plain = {p.title for p in themselves(results, label)}
    for name, runs in by_solver(results.runs).items():
        rows = [(p, group, [c for c in own if c.record.solver == name]) for p in results.variants
                for group, own in groups_of(p, label).items()]  # fmt: skip
        rows = [row for row in rows if row[2]]
        site.write(
            Page(name, site.url(name)), "solver.html", solver=name, most=CHIPS, runs=runs, score=score(runs),
            paper_label=", ".join(sorted({c.record.paper_label for c in runs} - {""})), options=_options(runs),
            reasons=_reasons(runs),
            rows=[row for row in rows if row[0].title in plain],
            apart=[row for row in rows if row[0].title not in plain],
            loud=sorted(runs, key=lambda c: (c.record.label != label, c.variant not in plain)),
        )  # fmt: skip
    return None


def _options(runs: Sequence[Run]) -> list[Option]:
    """Every option that differs from its default somewhere; first the runs at all defaults."""
    found: dict[str, list[Run]] = {}
    for c in runs:
        for words in [f"{k} = {text_of(v)}" for k, v in c.options.items()] or ["all at their defaults"]:
            found.setdefault(words, []).append(c)
    ordered = sorted(found, key=lambda words: (words != "all at their defaults", words))
    return [Option(words, score(found[words])) for words in ordered]


def _reasons(runs: Sequence[Run]) -> list[tuple[str, list[Run]]]:
    """Runs that did not succeed, grouped by how they ended; the most frequent ending first."""
    found = grouped((c for c in runs if not c.succeeded), lambda c: c.status)
    return sorted(found.items(), key=lambda kv: (kv[0] != "wrong", -len(kv[1])))
