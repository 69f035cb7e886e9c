"""Drift anatomy as a page shows it: what a run's energy error is made of, in joules over the run."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from ..model.results import natural
from ..model.words import Mark, number
from .judgement import Entry
from .links import Links
from .orders import verdict_mark
from .svg import Scale, strip

LONG = 100.0  # periods


@dataclass(frozen=True)
class Part:
    """One part of an energy error, over the whole run [J]; ``sure`` if its interval leaves out zero."""

    name: str
    size: float
    low: float
    high: float
    sure: bool


@dataclass(frozen=True)
class Anatomy:
    """One run."""

    variant: str
    solver: str
    case: str
    page: str
    periods: float
    span: float
    parts: tuple[Part, ...]
    trend: float  # [W]
    trend_low: float
    trend_high: float
    mark: Mark
    words: str


def anatomies(rows: Sequence[Entry], links: Links) -> tuple[Anatomy, ...]:
    """By problem and solver."""
    found = [_anatomy(e, links) for e in rows]
    return tuple(sorted(found, key=lambda a: (natural(a.variant), a.solver, natural(a.case))))


def parted(found: Sequence[Anatomy]) -> tuple[tuple[Anatomy, ...], tuple[Anatomy, ...], int]:
    """The long runs, those too short to tell growth from a swing, and how many have no period to speak of."""
    told = [a for a in found if a.periods > 0.0 or a.mark.word == "failed"]
    long = tuple(a for a in told if not a.periods < LONG)
    return (long or tuple(told)), tuple(a for a in told if long and a.periods < LONG), len(found) - len(told)


def common_scale(found: Sequence[Anatomy]) -> Scale:
    """One for all strips, so that rows can be compared; logarithmic."""
    sizes = [v for a in found for p in a.parts for v in (p.size, p.high) if v > 0.0 and math.isfinite(v)]
    low, high = (min(sizes), max(sizes)) if sizes else (1e-12, 1.0)
    floor = max(low, high * 1e-14)  # below it nothing is told apart from rounding
    return Scale(
        10.0 ** math.floor(math.log10(floor)), 10.0 ** math.ceil(math.log10(high * 1.01)), 8.0, 292.0, log=True
    )


def drawn(a: Anatomy, scale: Scale) -> Markup:
    """The three parts on the common scale."""
    words = "; ".join(f"{p.name} {number(p.size)} J{'' if p.sure else ' (not told from zero)'}" for p in a.parts)
    return strip([(p.name, p.size, p.low, p.high, p.sure) for p in a.parts], scale, words)


def _anatomy(e: Entry, links: Links) -> Anatomy:
    span = e.number("span_s")
    trend, low, high = (e.number(f"trend{k}_W") for k in ("", "_low", "_high"))
    root = math.sqrt(span) if span >= 0.0 else math.nan
    walk = (e.number("walk_J_per_sqrt_s") * root, e.number("walk_low") * root, e.number("walk_high") * root)
    oscillation = e.number("oscillation_J")
    parts = (
        Part("oscillation", oscillation, oscillation, oscillation, oscillation > 0.0),
        _part("trend", trend * span, low * span, high * span),
        _part("random walk", *walk),
    )
    return Anatomy(
        e.text("variant") or e.text("problem"),
        e.text("solver"),
        e.text("case") or links.words(e.text("run")),
        links.page(e.text("run")),
        e.number("periods"),
        span,
        parts,
        trend,
        low,
        high,
        verdict_mark(e.text("verdict")),
        e.text("words"),
    )


def _part(name: str, value: float, low: float, high: float) -> Part:
    """Magnitudes: an interval about zero begins there."""
    sure = low > 0.0 or high < 0.0
    ends = sorted((abs(low), abs(high)))
    return Part(name, abs(value), ends[0] if sure else 0.0, ends[1], sure)
