"""List the solvers, and show each: its method, its certificate card, its costs, and where it fails and why."""

import math
from collections.abc import Sequence
from typing import Any

from ....harness.results.judgements.files import DRIFTS, ORDERS, SYMMETRIES, WRONG, File
from ....harness.results.judgements.runs import Drift, Order
from ....harness.results.words import describe_breach
from ...model.catalogue import describe_method
from ...model.frontier import Frontier, select_at_shared_target, select_broad
from ...model.results import StoredResults, StoredRun, format_exactly, group_by, group_by_solver, make_natural_key
from ...model.scores import SolverScore, count_outcomes, rank_solvers
from ...model.tracking import TrackingTime, list_tracking_times
from ...model.variants import find_plain_label, group_by_label, select_variants
from ...model.words import format_decade, number, plural, time
from ..base import Page, Site, read_judged_or_published
from ..judged import orders as order_words
from ..judged import symmetries as symmetry_words
from ..svg import draw_badge

CHIPS = 8  # most runs named in a row; the problem's page names all
DRAWN = 6  # most ladders drawn per solver
FILES: tuple[File[Any], ...] = (ORDERS, DRIFTS, SYMMETRIES, WRONG)  # judgements that need several runs, of all solvers
QUANTITY = "position"  # the quantity whose order represents a solver


def write(results: StoredResults, site: Site) -> Page | None:
    """Add ``solvers.html`` and each ``solver-<name>.html`` to the site, and write the files ``badges/<name>.svg``.

    Return the first; the certificate cards are kept in the site for other pages.
    """
    label = find_plain_label(results)
    plain = {p.title for p in select_variants(results, label)}
    judged = [read_judged_or_published(results.folder, file) for file in FILES]
    picture = site.heat_map
    follow = [f for p in (picture.problems if picture else ()) for f in list_tracking_times(p)]
    costs = select_at_shared_target(select_broad(results, site.frontiers))
    loud = sorted(results.runs, key=lambda c: (c.record.label != label, c.variant not in plain))
    for name, runs in group_by_solver(results.runs).items():
        orders, drifts, symmetries, wrong = ([x for x in j.found or () if x.solver == name] for j in judged)
        certified = order_words.sort_by_case(orders)
        drawn = order_words.plot_ladders([o for o in certified if o.quantity == QUANTITY and o.against == "dt"])[:DRAWN]
        card = site.cards[name] = describe_solver(name, orders, drifts, follow, costs)
        image = f"badges/{site.url(name).removeprefix('solver-').removesuffix('.html')}.svg"
        (site.folder / image).write(card["badge"], durable=False)
        failed = group_by((c for c in runs if not c.is_success), lambda c: c.status)
        reasons = sorted(failed.items(), key=lambda kv: (kv[0] != "wrong", -len(kv[1])))  # the most frequent first
        work = [p for p in site.work.values() if any(t.solver == name for t in p.traces)]
        rows = [
            (p, group, [c for c in own if c.record.solver == name])
            for p in results.variants
            for group, own in group_by_label(p, label).items()
        ]
        site.write(
            Page(name, site.url(name)),
            "solver.html",
            solver=name,
            card=card,
            badge=image,
            about=describe_method(name),
            scripts=["assets/judgement.js"],
            plots=drawn,
            work=work,
            borrowed="plots-cost" if work else "",
            runs=runs,
            score=count_outcomes(runs),
            most=CHIPS,
            options=_score_options(runs),
            reasons=reasons,
            paper_label=", ".join(sorted({c.record.paper_label for c in runs} - {""})),
            loud=[c for c in loud if c.record.solver == name],
            rows=[row for row in rows if row[2] and row[0].title in plain],
            apart=[row for row in rows if row[2] and row[0].title not in plain],
            whys=[(j.why, j.published) for j in judged],
            certificates=certified,
            drifts=sorted(drifts, key=lambda d: (make_natural_key(d.variant), make_natural_key(d.case))),
            order_words=order_words,
            symmetry_words=symmetry_words,
            checks=group_by(symmetries, lambda s: s.title),
            wrong=wrong,
            reason_words=describe_breach,
        )
    return site.write(
        Page("Solvers", "solvers.html", nav=True, order=15),
        "solvers.html",
        standings=rank_solvers(results),
        label=label,
        loud=loud,
        about=describe_method,
    )


def _score_options(runs: Sequence[StoredRun]) -> dict[str, SolverScore]:
    """Count how runs ended by every option that differs from its default; runs with all defaults come first.

    A run with several such options counts for each of them.
    """
    found: dict[str, list[StoredRun]] = {}
    for c in runs:
        for words in [f"{k} = {format_exactly(v)}" for k, v in c.options.items()] or ["all at their defaults"]:
            found.setdefault(words, []).append(c)
    ordered = sorted(found, key=lambda words: (words != "all at their defaults", words))
    return {words: count_outcomes(found[words]) for words in ordered}


def describe_solver(
    solver: str,
    orders: Sequence[Order],
    drifts: Sequence[Drift],
    followed: Sequence[TrackingTime],
    costs: Sequence[Frontier],
) -> dict[str, Any]:
    """Return a solver's certificate card: facts at its default options, and a badge with them.

    The facts are the order of fixed steps with the narrowest interval, and how many problems agree on its verdict; the
    energy drift of the longest run; the shortest relative tracking time; the geometric mean of its cost ratios to the
    cheapest at one error. Unknown facts are left out. A fact is its name, its value, the value on the badge, and the
    kind of mark that colours it.
    """
    facts: list[tuple[str, str, str, str]] = []
    plain = (o for o in orders if (o.solver, o.case, o.quantity) == (solver, solver, QUANTITY))
    if own := [o for o in plain if math.isfinite(o.low)]:
        best = min(own, key=lambda o: (o.against != "dt", o.verdict != "certified", o.high - o.low))
        declared = f", declared {best.declared:g}" if math.isfinite(best.declared) else ""
        on = f"{best.verdict} on {sum(o.verdict == best.verdict for o in own)} of {plural(len(own), 'problem')}"
        value = f"{best.order:.2f} ({best.low:.2f} to {best.high:.2f}){declared}, on {best.variant}; {on}"
        facts.append(("order", value, f"{best.order:.2f}", order_words.mark_verdict(best.verdict).kind))
    # a case is the problem, the solver with its options, if any, and the setting
    if long := [d for d in drifts if d.solver == solver and d.periods and d.case.split()[1:2] == [solver]]:
        d = max(long, key=lambda d: (d.periods, d.variant))
        words = {"trend": "drifts", "failed": "stops"}.get(d.verdict, d.verdict)
        over = f"{words} over {plural(d.periods, 'period')} of {d.problem}"
        moved = f", by {number(abs(d.trend_W * d.span_s), 2)} J" if d.verdict == "trend" else ""
        setting = " ".join(d.case.split()[2:])
        value = f"{over}{moved}{f' at {setting}' if setting else ''}"
        facts.append(("energy", value, over, order_words.mark_verdict(d.verdict).kind))
    if motions := [f for f in followed if f.run.record.solver == solver and f.known > 0.0]:
        whole, least = sum(f.whole for f in motions), min(motions, key=lambda f: f.until / f.known)
        value = f"{whole} of {plural(len(motions), 'motion')} to the end of the reference"
        if whole < len(motions):
            until, known = (time(float(f"{v:.3g}")) for v in (least.until, least.known))
            value += f"; least {least.run.variant}, {until} of {known} s at {least.run.step_words}"
        count, kind = f"{whole} of {plural(len(motions), 'motion')}", "good" if whole == len(motions) else "failed"
        facts.append(("followed", value, count, kind))
    if factors := [p.factor for f in costs for p in f.places if p.run.record.solver == solver]:
        mean = math.exp(sum(map(math.log, factors)) / len(factors))
        ratio, on = f"×{number(mean, 2)}", f"{len(factors)} of {plural(len(costs), 'problem')}"
        unit = costs[0].unit if len({f.unit for f in costs}) == 1 else "m or rad"
        at = f"{ratio} the cheapest at {format_decade(costs[0].target)} {unit}"
        facts.append(("cost", f"{at}, reached on {on}", at, "good" if mean < 3.0 else "refused"))
    return {"solver": solver, "facts": facts, "badge": draw_badge(solver, [(f[0], *f[2:]) for f in facts])}
