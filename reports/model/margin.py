"""How near a run comes to a limit: its errors as parts of what is allowed."""

import math
from dataclasses import dataclass

from ...harness.results.records import judged_own, reasons_of
from ...harness.results.words import law_of, words_of
from ...harness.types import ACCURATE, ALLOWED, Law, Reason
from .results import Run
from .words import number

LEVELS = (1e-4, 1e-3, 1e-2, 1e-1, 1.0, 1.5, 4.0)  # a class of colour up to each of these margins, and one above
SHARE = "of its limit"  # the unit of what a record holds as that alone
UNSIZED = (Law.FINITE, Law.START, Law.END)  # broken or not, whatever the numbers


@dataclass(frozen=True)
class Margin:
    """An error with its limit."""

    error: Reason

    @property
    def part(self) -> float:
        """Part of the limit: 1 is at it; infinite for what has no size, such as another start."""
        e = self.error
        return e.value / e.limit if e.limit > 0.0 and e.value >= 0.0 and e.law not in UNSIZED else math.inf

    @property
    def level(self) -> int:
        """The class of colour, 0 to ``len(LEVELS)``."""
        return sum(self.part > edge for edge in LEVELS)

    @property
    def words(self) -> str:
        """``the energy error is 0.94 J of 9.49 J allowed``."""
        e = self.error
        if self.part > 1.0:
            return words_of(e)
        if e.unit == SHARE:
            return f"{law_of(e)} is {number(e.value)} of its limit"
        return f"{law_of(e)} is {number(e.value)} of {number(e.limit)} {e.unit}".strip() + " allowed"


def describe_break(e: Reason) -> str:
    """``the energy error reaches 3 J, 30 times the 0.1 J allowed, first at 0.2 s``."""
    part = Margin(e).part
    if not math.isfinite(part):
        return words_of(e)
    first = "" if math.isnan(e.time_s) else f", first at {number(e.time_s)} s"
    times = f"{number(part, 2)} times "
    if e.unit == SHARE:
        return f"{law_of(e)} reaches {times}its limit{first}"
    value, limit = (f"{number(v)} {e.unit}".strip() for v in (e.value, e.limit))
    return f"{law_of(e)} reaches {value}, {times}the {limit} allowed{first}"


def margin(run: Run) -> Margin | None:
    """Margin of the error that is the largest part of its limit; None for a run without a step to measure."""
    broken = reasons_of(run.record.wrong_because)
    laws = {e.law for e in broken}
    found = [Margin(e) for e in (*broken, *_recompute_reasons(run)) if e in broken or e.law not in laws]
    return max(found, key=lambda m: m.part, default=None)


def _recompute_reasons(run: Run) -> list[Reason]:
    """Reasons by the laws that columns hold. A judged run keeps those that are not in its reasons: one above the
    limit as reckoned here has a wider one (a mechanism beside others).
    """
    r, own = run.record, judged_own(run.record)
    rows = (
        Reason(Law.ENERGY, r.energy_drift_max_J, ALLOWED[Law.ENERGY] * r.energy_scale_J, "J"),
        _of_constraints(Law.CONSTRAINT, r.gap_share_max, r.phi_max, r.phi_limit_m, "m"),
        _of_constraints(Law.CONSTRAINT_RATE, r.gap_rate_share_max, r.phi_dot_max, r.phi_dot_limit_m_per_s, "m/s"),
        Reason(Law.ORTHOGONALITY, r.orthogonality_max, ALLOWED[Law.ORTHOGONALITY]),
        Reason(Law.MOTION, r.motion_error_judged_m,
               ACCURATE["accurate_until_s"] * r.length_scale_m + (0.0 if math.isnan(own) else own), "m"),
    )  # fmt: skip
    return [e for e in rows if e.value >= 0.0 and e.limit > 0.0 and (run.has_stopped or e.value <= e.limit)]


def _of_constraints(law: Law, share: float, value: float, limit: float, unit: str) -> Reason:
    """In metres where what is recorded is what is judged, else (axis rows, several mechanisms) as the share judged."""
    return Reason(law, share, 1.0, SHARE) if math.isnan(limit) else Reason(law, value, limit, unit)
