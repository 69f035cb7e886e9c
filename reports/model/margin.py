"""Measure how near a run comes to a limit, by its errors as fractions of what is allowed."""

import math
from dataclasses import dataclass

from ...harness.mechanics.types import Law, Reason
from ...harness.results.records import find_limit
from ...harness.results.words import describe_breach, find_broken_law
from .results import StoredRun
from .words import number

LEVELS = (1e-4, 1e-3, 1e-2, 1e-1, 1.0, 1.5, 4.0)  # upper edges of the classes of colour; one class is above
SHARE = "of its limit"  # the unit of an error that a record holds as a fraction only
UNSIZED = (Law.FINITE, Law.START, Law.END)  # laws that are kept or broken without a size


@dataclass(frozen=True)
class Margin:
    """An error with its limit."""

    error: Reason

    @property
    def ratio(self) -> float:
        """The error over its limit: 1 is at the limit; infinite for an error without a size, such as another start."""
        e = self.error
        return e.value / e.limit if e.limit > 0.0 and e.value >= 0.0 and e.law not in UNSIZED else math.inf

    @property
    def level(self) -> int:
        """The class of colour, the number of edges in ``LEVELS`` that the ratio exceeds."""
        return sum(self.ratio > edge for edge in LEVELS)

    @property
    def words(self) -> str:
        """The margin in words: ``the energy error is 0.94 J of 9.49 J allowed``."""
        e = self.error
        if self.ratio > 1.0:
            return describe_breach(e)
        if e.unit == SHARE:
            return f"{find_broken_law(e)} is {number(e.value)} of its limit"
        return f"{find_broken_law(e)} is {number(e.value)} of {number(e.limit)} {e.unit}".strip() + " allowed"


def describe_excess(e: Reason) -> str:
    """Describe an error by its ratio to its limit: ``the energy error reaches 3 J, 30 times the 0.1 J allowed``.

    The time of the first breach is added if it is known. An error without a finite ratio, such as another start, is
    described by ``describe_breach`` instead.
    """
    ratio = Margin(e).ratio
    if not math.isfinite(ratio):
        return describe_breach(e)
    first = "" if math.isnan(e.time_s) else f", first at {number(e.time_s)} s"
    times = f"{number(ratio, 2)} times "
    if e.unit == SHARE:
        return f"{find_broken_law(e)} reaches {times}its limit{first}"
    value, limit = (f"{number(v)} {e.unit}".strip() for v in (e.value, e.limit))
    return f"{find_broken_law(e)} reaches {value}, {times}the {limit} allowed{first}"


def find_margin(run: StoredRun) -> Margin | None:
    """Return the error of a run that is the largest fraction of its limit; None if no error with a limit is known."""
    broken = run.record.reasons
    laws = {e.law for e in broken}
    found = [Margin(e) for e in (*broken, *_recompute_reasons(run)) if e in broken or e.law not in laws]
    return max(found, key=lambda m: m.ratio, default=None)


def _recompute_reasons(run: StoredRun) -> list[Reason]:
    """Return the errors with their limits, recomputed from the record's columns.

    Unless the run stopped, errors above their limits are left out: the run was judged by wider limits, those of each of
    several mechanisms.
    """
    r = run.record
    rows = (
        Reason(Law.ENERGY, r.energy_drift_max_J, find_limit(r, "energy_drift_max_J"), "J"),
        _make_constraint_reason(Law.CONSTRAINT, r.gap_share_max, r.phi_max, r.phi_limit_m, "m"),
        _make_constraint_reason(
            Law.CONSTRAINT_RATE, r.gap_rate_share_max, r.phi_dot_max, r.phi_dot_limit_m_per_s, "m/s"
        ),
        Reason(Law.ORTHOGONALITY, r.orthogonality_max, find_limit(r, "orthogonality_max")),
        Reason(Law.MOTION, r.motion_error_judged_m, find_limit(r, "motion_error_judged_m"), "m"),
    )
    return [e for e in rows if e.value >= 0.0 and e.limit > 0.0 and (run.has_stopped or e.value <= e.limit)]


def _make_constraint_reason(law: Law, share: float, value: float, limit: float, unit: str) -> Reason:
    """Return a constraint error in its unit if a limit is recorded, else as the fraction of its limit.

    Only the fraction is known for axis rows and for several mechanisms.
    """
    return Reason(law, share, 1.0, SHARE) if math.isnan(limit) else Reason(law, value, limit, unit)
