"""The certificate card of a solver: order, energy, how long it follows the motion, cost; and the same as a badge."""

import math
from collections.abc import Sequence
from typing import Any

from ....harness.results.judgements.runs import Drift, Order
from ...model.accuracy import Followed
from ...model.frontier import Frontier
from ...model.words import decade, number, plural, time
from ..judged.orders import verdict_mark
from ..svg import badge

QUANTITY = "position"  # whose order stands for a solver


Fact = tuple[str, str, str, str]  # a line: its name and value, the value on the badge, the kind of mark that colours it


def card_of(solver: str, orders: Sequence[Order], drifts: Sequence[Drift], followed: Sequence[Followed],
            costs: Sequence[Frontier]) -> dict[str, Any]:  # fmt: skip
    """Facts about a solver at its default options, and the same as a badge; a line without a fact is left out."""
    found = (
        _order(solver, orders),
        _energy(solver, drifts),
        _shortest_followed(solver, followed),
        _cost(solver, costs),
    )
    facts = [f for f in found if f is not None]
    drawn = badge(solver, [(name, short, kind) for name, _, short, kind in facts])
    return {"solver": solver, "facts": facts, "badge": drawn}


def _order(solver: str, orders: Sequence[Order]) -> Fact | None:
    """Order of fixed steps at default options: the narrowest interval, and how many problems agree on the verdict."""
    own = [o for o in orders if (o.solver, o.case, o.quantity) == (solver, solver, QUANTITY) and math.isfinite(o.low)]
    if not own:
        return None
    best = min(own, key=lambda o: (o.against != "dt", o.verdict != "certified", o.high - o.low))
    alike = sum(o.verdict == best.verdict for o in own)
    value = f"{best.order:.2f} ({best.low:.2f} to {best.high:.2f})"
    on = f"{best.verdict} on {alike} of {plural(len(own), 'problem')}"
    declared = f", declared {best.declared:g}" if math.isfinite(best.declared) else ""
    return "order", f"{value}{declared}; {on}", f"{best.order:.2f}", verdict_mark(best.verdict).kind


def _energy(solver: str, drifts: Sequence[Drift]) -> Fact | None:
    """Energy drift of the longest run at default options."""
    own = [d for d in drifts if d.solver == solver and d.periods and d.case.split()[1:2] == [solver]]
    if not own:
        return None
    d = max(own, key=lambda d: (d.periods, d.variant))
    words = {"trend": "drifts", "failed": "stops"}.get(d.verdict, d.verdict)
    over = f"over {plural(d.periods, 'period')}"
    moved = f", by {number(abs(d.trend_W * d.span_s), 2)} J" if d.verdict == "trend" else ""
    return "energy", f"{words} {over} of {d.problem}{moved}", f"{words} {over}", verdict_mark(d.verdict).kind


def _shortest_followed(solver: str, followed: Sequence[Followed]) -> Fact | None:
    """The problem on which the smallest part of the known motion is followed."""
    own = [f for f in followed if f.run.record.solver == solver and f.known > 0.0]
    if not own:
        return None
    whole = sum(f.whole for f in own)
    least = min(own, key=lambda f: f.until / f.known)
    all_of = f"{whole} of {plural(len(own), 'motion')} to the end of the reference"
    if whole == len(own):
        return "followed", all_of, f"{whole} of {len(own)}", "good"
    words = f"least {least.run.variant}, {time(float(f'{least.until:.3g}'))} of {time(float(f'{least.known:.3g}'))} s"
    return "followed", f"{all_of}; {words}", f"{whole} of {len(own)}", "failed"


def _cost(solver: str, costs: Sequence[Frontier]) -> Fact | None:
    """Relative to the cheapest at one error: the mean ratio over the problems on which it gets there."""
    factors = [p.factor for f in costs for p in f.places if p.run.record.solver == solver]
    if not factors:
        return None
    mean = math.exp(sum(map(math.log, factors)) / len(factors))
    ratio = f"×{number(mean, 2)}"
    value = f"{ratio} the cheapest at {decade(costs[0].target)}, reached on {len(factors)} of "
    return "cost", value + plural(len(costs), "problem"), ratio, "good" if mean < 3.0 else "refused"
