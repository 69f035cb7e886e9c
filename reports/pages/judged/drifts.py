"""Drift anatomy as a page shows it: what a run's energy error is made of, in joules over the run."""

from collections.abc import Sequence

from ....harness.results.judgements.runs import Drift
from ...model.results import natural


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
