"""How long each solver follows the exact motion."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ...harness.results.words import accurate_until, at_least
from ...harness.types import ACCURATE
from .results import Run, Variant, by_solver

WHOLE = 0.999  # of the known motion: followed to its end
SHADES = ("ten", "one", "tenth")  # of a bar, by the levels of ``ACCURATE``


@dataclass(frozen=True)
class Followed:
    """How long a solver's finest settings track the reference, in percent of the known time, the narrowest first."""

    run: Run
    until: float  # [s] within a tenth of the reach
    whole: bool  # followed to the end of what is known, or the reference ends there, not the agreement
    shades: tuple[tuple[str, float], ...]
    words: str
    known: float  # [s] the simulated time, as far as the reference goes


def list_followed(variant: Variant) -> Sequence[Followed]:
    """One a solver, the longest first; none without a reference."""
    out = []
    for own in by_solver(variant.runs).values():
        known = [c for c in own if not math.isnan(c.record.accurate_until_s)]
        if known:
            run = min(known, key=lambda c: c.finest_first)
            r, until = run.record, run.record.accurate_until_s
            known_to = min(r.t_end_s, r.reference_horizon_s) if r.reference_horizon_s > 0.0 else r.t_end_s
            ends = [100.0 * min(getattr(r, name) / known_to, 1.0) for name in reversed(ACCURATE)]
            widths = [end - begin for begin, end in zip([0.0, *ends], ends, strict=False)]
            shades = tuple(zip(reversed(SHADES), widths, strict=True))
            whole = at_least(r, until) or until >= WHOLE * known_to
            out.append(Followed(run, until, whole, shades, ", ".join(accurate_until(r)), known_to))
    return sorted(out, key=lambda f: (-f.until, f.run.record.solver))
