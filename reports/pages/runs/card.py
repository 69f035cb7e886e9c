"""The certificate card of a solver: order, energy, how long it follows the motion, cost; and the same as a badge."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from ....harness.results.judgements.runs import Drift, Order
from ...model.accuracy import Followed
from ...model.frontier import Frontier
from ...model.words import decade, number, plural, time
from ..judged.orders import verdict_mark
from ..svg import badge

QUANTITY = "position"  # whose order stands for a solver


@dataclass(frozen=True)
class Fact:
    """One line of the card; ``kind`` is its colour, ``short`` its value on the badge."""

    name: str
    value: str
    short: str
    kind: str = "refused"


@dataclass(frozen=True)
class Card:
    """Card of a solver at its default options."""

    solver: str
    facts: tuple[Fact, ...]

    @property
    def badge(self) -> Markup:
        """An SVG file for a README."""
        return badge(self.solver, [(f.name, f.short, f.kind) for f in self.facts])


def card_of(solver: str, orders: Sequence[Order], drifts: Sequence[Drift], followed: Sequence[Followed],
            costs: Sequence[Frontier]) -> Card:  # fmt: skip
    """Facts about a solver; a line without one is left out."""
    found = (
        _order(solver, orders),
        _energy(solver, drifts),
        _shortest_followed(solver, followed),
        _cost(solver, costs),
    )
    return Card(solver, tuple(f for f in found if f is not None))


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
    return Fact("order", f"{value}{declared}; {on}", f"{best.order:.2f}", verdict_mark(best.verdict).kind)


def _energy(solver: str, drifts: Sequence[Drift]) -> Fact | None:
    """Energy drift of the longest run at default options."""
    own = [d for d in drifts if d.solver == solver and d.periods and d.case.split()[1:2] == [solver]]
    if not own:
        return None
    d = max(own, key=lambda d: (d.periods, d.variant))
    words = {"trend": "drifts", "failed": "stops"}.get(d.verdict, d.verdict)
    over = f"over {plural(d.periods, 'period')}"
    moved = f", by {number(abs(d.trend_W * d.span_s), 2)} J" if d.verdict == "trend" else ""
    return Fact("energy", f"{words} {over} of {d.problem}{moved}", f"{words} {over}", verdict_mark(d.verdict).kind)


def _shortest_followed(solver: str, followed: Sequence[Followed]) -> Fact | None:
    """The problem on which the smallest part of the known motion is followed."""
    own = [f for f in followed if f.run.record.solver == solver and f.known > 0.0]
    if not own:
        return None
    whole = sum(f.whole for f in own)
    least = min(own, key=lambda f: f.until / f.known)
    all_of = f"{whole} of {plural(len(own), 'motion')} to the end of the reference"
    if whole == len(own):
        return Fact("followed", all_of, f"{whole} of {len(own)}", "good")
    words = f"least {least.run.variant}, {time(float(f'{least.until:.3g}'))} of {time(float(f'{least.known:.3g}'))} s"
    return Fact("followed", f"{all_of}; {words}", f"{whole} of {len(own)}", "failed")


def _cost(solver: str, costs: Sequence[Frontier]) -> Fact | None:
    """Relative to the cheapest at one error: the mean ratio over the problems on which it gets there."""
    factors = [p.factor for f in costs for p in f.places if p.run.record.solver == solver]
    if not factors:
        return None
    mean = math.exp(sum(map(math.log, factors)) / len(factors))
    ratio = f"×{number(mean, 2)}"
    value = f"{ratio} the cheapest at {decade(costs[0].target)}, "
    return Fact("cost", f"{value}reached on {len(factors)} of {plural(len(costs), 'problem')}", ratio,
                "good" if mean < 3.0 else "refused")  # fmt: skip
