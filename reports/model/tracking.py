"""Find how long each solver follows the exact motion."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ...harness.mechanics.types import ACCURATE
from ...harness.results.words import format_accurate_times, is_lower_bound
from .results import StoredRun, Variant, group_by_solver

WHOLE = 0.999  # fraction of the known motion from which it counts as followed to its end
SHADES = ("ten", "one", "tenth")  # shades of a bar, one per level of ``ACCURATE``


@dataclass(frozen=True)
class TrackingTime:
    """The time for which a solver's finest settings track the reference.

    ``shades`` are percentages of the known time, the tightest level first.
    """

    run: StoredRun
    until: float  # [s] end of the time within a tenth of the reach
    whole: bool  # followed to the end of the known motion or of the reference
    shades: tuple[tuple[str, float], ...]
    words: str
    known: float  # [s] simulated time that the reference covers


def list_tracking_times(variant: Variant) -> Sequence[TrackingTime]:
    """Return the tracking time of each solver's finest settings, the longest first; empty without a reference."""
    out = []
    for own in group_by_solver(variant.runs).values():
        known = [c for c in own if not math.isnan(c.record.accurate_until_s)]
        if known:
            run = min(known, key=lambda c: c.finest_first)
            r, until = run.record, run.record.accurate_until_s
            known_to = min(r.t_end_s, r.reference_horizon_s) if r.reference_horizon_s > 0.0 else r.t_end_s
            ends = [100.0 * min(getattr(r, name) / known_to, 1.0) for name in reversed(ACCURATE)]
            widths = [end - begin for begin, end in zip([0.0, *ends], ends, strict=False)]
            shades = tuple(zip(reversed(SHADES), widths, strict=True))
            whole = is_lower_bound(r, until) or until >= WHOLE * known_to
            out.append(TrackingTime(run, until, whole, shades, ", ".join(format_accurate_times(r)), known_to))
    return sorted(out, key=lambda f: (-f.until, f.run.record.solver))
