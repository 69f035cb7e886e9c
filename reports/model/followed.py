"""How long solvers follow the exact motion: a bar each, in three shades, that ends with the reference at the latest."""

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
    open: bool  # the reference ends there, not the agreement
    shades: tuple[tuple[str, float], ...]
    words: str
    known: float  # [s] the simulated time, as far as the reference goes

    @property
    def whole(self) -> bool:
        """It is followed to the end of what is known."""
        return self.open or self.until >= WHOLE * self.known


def list_followed(variant: Variant) -> Sequence[Followed]:
    """One a solver, the longest first; none without a reference."""
    out = []
    for own in by_solver(variant.runs).values():
        known = [c for c in own if not math.isnan(c.record.accurate_until_s)]
        if known:
            run = min(known, key=lambda c: c.finest_first)
            r = run.record
            known_to = min(r.t_end_s, r.reference_horizon_s) if r.reference_horizon_s > 0.0 else r.t_end_s
            ends = [100.0 * min(getattr(r, name) / known_to, 1.0) for name in reversed(ACCURATE)]
            widths = [end - begin for begin, end in zip([0.0, *ends], ends, strict=False)]
            shades = tuple(zip(reversed(SHADES), widths, strict=True))
            until = r.accurate_until_s
            said = ", ".join(accurate_until(r))
            out.append(Followed(run, until, at_least(r, until), shades, said, known_to))
    return sorted(out, key=lambda f: (-f.until, f.run.record.solver))
