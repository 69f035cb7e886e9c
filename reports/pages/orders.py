"""Order certificates as a page shows them: each fit with its points, and which of them it was made from."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ..model.results import natural
from ..model.words import Mark, number, unit
from .judgement import Entry
from .links import Links

FLOOR = 3.0  # of the floor: points below so many times it are said to lie on it
USED, EARLY, FLOORED = "used", "pre-asymptotic", "at the floor"


@dataclass(frozen=True)
class Point:
    """One run of the ladder of steps."""

    dt: float
    error: float
    kind: str


@dataclass(frozen=True)
class Certificate:
    """The order of one quantity of one solver on one problem."""

    variant: str
    solver: str
    case: str
    quantity: str
    symbol: str
    unit: str
    declared: float
    fixed: bool  # a ladder of fixed steps; else of tolerances, over the mean step
    order: float
    low: float
    high: float
    floor: float
    points: tuple[Point, ...]
    mark: Mark
    words: str
    runs: tuple[tuple[str, str], ...]

    @property
    def fit(self) -> tuple[tuple[float, float], ...]:
        """Two points of the line through those used, in the mean of their logarithms; none if there is no order."""
        used = [(math.log(p.dt), math.log(p.error)) for p in self.points if p.kind == USED and p.error > 0.0 < p.dt]
        if len(used) < 2 or not math.isfinite(self.order):
            return ()
        x, y = (sum(p[k] for p in used) / len(used) for k in (0, 1))
        ends = min(p[0] for p in used), max(p[0] for p in used)
        return tuple((math.exp(e), math.exp(y + self.order * (e - x))) for e in ends)

    @property
    def interval(self) -> str:
        """``1.98 to 2.03``."""
        return f"{self.low:.2f} to {self.high:.2f}" if math.isfinite(self.low) and math.isfinite(self.high) else "none"


def certificates(rows: Sequence[Entry], links: Links) -> tuple[Certificate, ...]:
    """By problem, solver and quantity."""
    found = [_certificate(e, links) for e in rows]
    return tuple(sorted(found, key=lambda c: (natural(c.variant), c.solver, natural(c.case))))


VERDICTS = {  # of certificates and of drifts
    "certified": ("✓", "good"), "exact": ("✓", "good"), "bounded": ("✓", "good"), "holds": ("✓", "good"),
    "above declared": ("△", "refused"), "below declared": ("✗", "wrong"),
    "trend": ("↗", "failed"), "wanders": ("≈", "failed"),
    "measured": ("○", "refused"), "undecided": ("○", "refused"), "floor": ("○", "refused"),
    "too short": ("–", "refused"),
}  # fmt: skip


def verdict_mark(word: str) -> Mark:
    """The mark of a verdict; one we do not know is no success."""
    low = word.lower().strip()
    symbol, kind = VERDICTS.get(low, ("★", "failed"))
    return Mark(symbol, low or "no verdict", kind)


def _certificate(e: Entry, links: Links) -> Certificate:
    floor, declared = e.number("floor"), e.number("declared")
    used = e.given.get("used")
    flags = used if isinstance(used, list) else []
    rows = zip(e.numbers("dt"), e.numbers("error"), strict=False)
    given = [(dt, error, k < len(flags) and flags[k] is True) for k, (dt, error) in enumerate(rows)]
    coarsest = max((dt for dt, _, good in given if good), default=math.inf)
    points = tuple(Point(dt, error, _kind(dt, error, good, floor, coarsest)) for dt, error, good in given)
    return Certificate(
        e.text("variant") or e.text("problem"),
        e.text("solver"),
        e.text("case"),
        e.text("quantity"),
        e.text("symbol"),
        unit(e.text("unit")),
        declared,
        not e.text("against") or e.text("against") == "dt",
        e.number("order"),
        e.number("low"),
        e.number("high"),
        floor,
        points,
        verdict_mark(e.text("verdict")),
        e.text("words"),
        tuple((links.words(k), links.page(k)) for k in e.texts("runs")),
    )


def _kind(dt: float, error: float, used: bool, floor: float, coarsest: float) -> str:
    """A point left out of the fit is coarser than all used ones, or it lies on the floor."""
    if used:
        return USED
    if dt > coarsest and not error <= FLOOR * floor:
        return EARLY
    return FLOORED


def told(c: Certificate) -> str:
    """The order in a run of the table."""
    return number(c.order) if not math.isfinite(c.order) else f"{c.order:.2f}"


@dataclass(frozen=True)
class Glance:
    """Orders of fixed steps: a row a solver and problem, a column a quantity; None where there is no ladder."""

    quantities: tuple[str, ...]
    rows: tuple[tuple[Certificate, tuple[Certificate | None, ...]], ...]  # one that stands for the row, its columns


def glance(found: Sequence[Certificate]) -> Glance:
    """Of the ladders of fixed steps."""
    fixed = [c for c in found if c.fixed]
    quantities = tuple(dict.fromkeys(c.quantity for c in fixed))
    keys = dict.fromkeys(
        (c.solver, c.variant, c.case) for c in sorted(fixed, key=lambda c: (c.solver, natural(c.variant)))
    )
    rows = []
    for key in keys:
        own = {c.quantity: c for c in fixed if (c.solver, c.variant, c.case) == key}
        rows.append((next(iter(own.values())), tuple(own.get(q) for q in quantities)))
    return Glance(quantities, tuple(rows))
