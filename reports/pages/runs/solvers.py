"""The list of solvers, and a page for each: its method, its certificate card, its costs, where it fails and why."""

from collections.abc import Sequence
from typing import Any

from ....harness.results.judgements.files import DRIFTS, ORDERS, SYMMETRIES, WRONG, File
from ....harness.results.words import words_of
from ...model.accuracy import list_followed
from ...model.catalogue import about_solver
from ...model.frontier import broad, of_most_problems
from ...model.heat import heat
from ...model.results import Results, Run, by_solver, group_by, natural, text_of
from ...model.scores import Score, score, standings
from ...model.variants import broadest, groups_of, themselves
from ..base import Page, Site
from ..judged.orders import (
    MARKS,
    by_case,
    describe_drift,
    describe_order,
    describe_symmetry,
    ladders,
    tally,
    verdict_mark,
)
from ..judgement import links_of, read_judged_or_published
from .card import QUANTITY, card_of

CHIPS = 8  # runs named in a row; the problem's page has all
DRAWN = 6  # ladders of a solver that are drawn
FILES: tuple[File[Any], ...] = (ORDERS, DRIFTS, SYMMETRIES, WRONG)  # judgements beyond one run, of all solvers


def write(results: Results, site: Site) -> Page | None:
    """``solvers.html``, and ``solver-<name>.html`` and ``badges/<name>.svg`` of every solver."""
    label, links = broadest(results), links_of(results.runs)
    plain = {p.title for p in themselves(results, label)}
    judged = [read_judged_or_published(results.folder, file) for file in FILES]
    picture = heat(results)
    follow = [f for p in (picture.problems if picture else ()) for f in list_followed(p)]
    costs = of_most_problems(broad(results, site.frontiers))
    loud = sorted(results.runs, key=lambda c: (c.record.label != label, c.variant not in plain))
    for name, runs in by_solver(results.runs).items():
        orders, drifts, symmetries, wrong = ([x for x in j.found or () if x.solver == name] for j in judged)
        certified = by_case(orders)
        drawn = ladders([o for o in certified if o.quantity == QUANTITY and o.against == "dt"])[:DRAWN]
        card = site.cards[name] = card_of(name, orders, drifts, follow, costs)
        badge = f"badges/{site.url(name).removeprefix('solver-').removesuffix('.html')}.svg"
        (site.folder / badge).write(card["badge"], durable=False)
        work = [p for p in site.work.values() if any(t.solver == name for t in p.traces)]
        rows = [(p, group, [c for c in own if c.record.solver == name]) for p in results.variants
                for group, own in groups_of(p, label).items()]  # fmt: skip
        site.write(
            Page(name, site.url(name)), "solver.html", solver=name, card=card, badge=badge, about=about_solver(name),
            scripts=["assets/judgement.js"], plots=drawn, work=work, borrowed="plots-cost" if work else "",
            runs=runs, score=score(runs), most=CHIPS, options=_options(runs), reasons=_reasons(runs),
            paper_label=", ".join(sorted({c.record.paper_label for c in runs} - {""})),
            loud=[c for c in loud if c.record.solver == name],
            rows=[row for row in rows if row[2] and row[0].title in plain],
            apart=[row for row in rows if row[2] and row[0].title not in plain],
            links=links, whys=[(j.why, j.published) for j in judged], certificates=certified,
            drifts=sorted(drifts, key=lambda d: (natural(d.variant), natural(d.case))), verdict_mark=verdict_mark,
            checks={title: (own, *tally(own)) for title, own in group_by(symmetries, lambda s: s.title).items()},
            marks_of=MARKS, describe_order=describe_order, describe_drift=describe_drift,
            describe_symmetry=describe_symmetry, wrong=wrong, reason_words=words_of,
        )  # fmt: skip
    return site.write(Page("Solvers", "solvers.html", nav=True, order=15), "solvers.html",
                      standings=standings(results), label=label, loud=loud, about=about_solver)  # fmt: skip


def _options(runs: Sequence[Run]) -> dict[str, Score]:
    """Every option that differs from its default somewhere; first the runs at all defaults."""
    found: dict[str, list[Run]] = {}
    for c in runs:
        for words in [f"{k} = {text_of(v)}" for k, v in c.options.items()] or ["all at their defaults"]:
            found.setdefault(words, []).append(c)
    ordered = sorted(found, key=lambda words: (words != "all at their defaults", words))
    return {words: score(found[words]) for words in ordered}


def _reasons(runs: Sequence[Run]) -> list[tuple[str, list[Run]]]:
    """Runs that did not succeed, grouped by how they ended; the most frequent ending first."""
    found = group_by((c for c in runs if not c.succeeded), lambda c: c.status)
    return sorted(found.items(), key=lambda kv: (kv[0] != "wrong", -len(kv[1])))
