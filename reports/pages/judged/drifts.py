"""Drift anatomy as a page shows it: what a run's energy error is made of, in joules over the run."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from markupsafe import Markup

from ....harness.results.judgements.runs import Drift
from ...model.results import natural
from ...model.words import number
from ..svg import Scale, strip

LONG = 100.0  # periods


class Part(NamedTuple):
    """One part of an energy error, over the whole run [J]; ``sure`` if its interval leaves out zero."""

    name: str
    size: float
    low: float
    high: float
    sure: bool


def anatomies(drifts: Sequence[Drift]) -> tuple[Drift, ...]:
    """By problem and solver."""
    return tuple(sorted(drifts, key=lambda d: (natural(d.variant), d.solver, natural(d.case))))


def words(d: Drift) -> str:
    """Oscillation, trend and walk with their intervals."""
    if d.verdict == "failed":
        return f"it ended with {d.status} at {d.span_s:.4g} s"
    if d.verdict == "too short":
        return "too few periods, or none, to separate the parts"
    most = max(abs(d.trend_low_W), abs(d.trend_high_W))
    bound = f"|trend| < {most:.1e} W at 95 %"
    interval = f"({d.trend_low_W:.2e} to {d.trend_high_W:.2e})"
    over = f"{d.periods} periods ({d.span_s:.4g} s)"
    trend = {
        "trend": f"trend of {d.trend_W:.2e} W {interval}, {d.trend_W * d.span_s:.2e} J over {over}",
        "wanders": f"trend not distinguishable from zero: {bound}, {over}",
        "undecided": f"no trend is seen, but it may be as large as {most:.1e} W at 95 % over {over}",
        "bounded": (f"negligible trend: {d.trend_W:.2e} W {interval}" if d.trend_low_W > 0.0 or d.trend_high_W < 0.0
                    else f"no trend: {bound}") + f", that is at most {most * d.span_s:.1e} J over {over}",
    }[d.verdict]  # fmt: skip
    found = [f"oscillation of {d.oscillation_J:.2e} J", trend]
    if d.walk_J_per_sqrt_s > 0.0:
        found.append(f"random walk of {d.walk_J_per_sqrt_s:.1e} J/sqrt(s) ({d.walk_low:.1e} to {d.walk_high:.1e})")
    return "; ".join(found)


def parted(found: Sequence[Drift]) -> tuple[tuple[Drift, ...], tuple[Drift, ...], int]:
    """The long runs, those too short to distinguish growth from an oscillation, and how many have no period."""
    shown = tuple(d for d in found if d.periods or d.verdict == "failed")
    long = tuple(d for d in shown if d.periods >= LONG)
    return long or shown, tuple(d for d in shown if long and d.periods < LONG), len(found) - len(shown)


def common_scale(found: Sequence[Drift]) -> Scale:
    """One for all strips, so that rows can be compared; logarithmic."""
    sizes = [v for d in found for p in parts(d) for v in (p.size, p.high) if v > 0.0 and math.isfinite(v)]
    low, high = (min(sizes), max(sizes)) if sizes else (1e-12, 1.0)
    floor = max(low, high * 1e-14)  # below it all is rounding
    ends = math.floor(math.log10(floor)), math.ceil(math.log10(high * 1.01))
    return Scale(10.0 ** ends[0], 10.0 ** ends[1], 8.0, 292.0, log=True)


def drawn(d: Drift, scale: Scale) -> Markup:
    """The three parts on the common scale."""
    said = "; ".join(f"{p.name} {number(p.size)} J{'' if p.sure else ' (may be zero)'}" for p in parts(d))
    return strip(parts(d), scale, said)


def parts(d: Drift) -> tuple[Part, ...]:
    """Oscillation, trend and walk over the whole run."""
    root = math.sqrt(d.span_s) if d.span_s >= 0.0 else math.nan
    return (
        Part("oscillation", d.oscillation_J, d.oscillation_J, d.oscillation_J, d.oscillation_J > 0.0),
        _part("trend", d.span_s, d.trend_W, d.trend_low_W, d.trend_high_W),
        _part("random walk", root, d.walk_J_per_sqrt_s, d.walk_low, d.walk_high),
    )


def _part(name: str, over: float, value: float, low: float, high: float) -> Part:
    """Magnitudes: an interval about zero begins there."""
    sure = low > 0.0 or high < 0.0
    ends = sorted((abs(low * over), abs(high * over)))
    return Part(name, abs(value * over), ends[0] if sure else 0.0, ends[1], sure)
