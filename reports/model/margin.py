"""How near to its limits a run comes: the largest of its errors over what is allowed, one number for all problems."""

import math
from dataclasses import dataclass

from ...harness.results.records import judged_own, reasons_of
from ...harness.results.words import law_of, words_of
from ...harness.types import ACCURATE, ALLOWED, Law, Reason
from .results import Run
from .words import number

LEVELS = (1e-4, 1e-3, 1e-2, 1e-1, 1.0, 1.5, 4.0)  # a class of colour up to each of these margins, and one above
UNSIZED = (Law.FINITE, Law.START, Law.END)  # broken or not, whatever the numbers


@dataclass(frozen=True)
class Margin:
    """An error with its limit."""

    error: Reason

    @property
    def part(self) -> float:
        """Of the limit: 1 is at it; infinite for what has no size, such as another start."""
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
        return f"{law_of(e)} is {number(e.value)} of {number(e.limit)} {e.unit}".strip() + " allowed"


def margin(run: Run) -> Margin | None:
    """Of the error that is the largest part of its limit; None for a run without a step to measure."""
    broken = reasons_of(run.record.wrong_because)
    laws = {e.law for e in broken}
    found = [Margin(e) for e in (*broken, *_measured(run)) if e in broken or e.law not in laws]
    return max(found, key=lambda m: m.part, default=None)


def _measured(run: Run) -> list[Reason]:
    """Of the laws that the columns tell. A run that was judged keeps those that are not in its reasons: one above the
    limit as reckoned here has a wider one (a mechanism beside others).
    """
    r, own = run.record, judged_own(run.record)
    rows = (
        Reason(Law.ENERGY, r.energy_drift_max_J, ALLOWED[Law.ENERGY] * r.energy_scale_J, "J"),
        Reason(Law.CONSTRAINT, r.phi_max, r.phi_limit_m, "m"),
        Reason(Law.CONSTRAINT_RATE, r.phi_dot_max, r.phi_dot_limit_m_per_s, "m/s"),
        Reason(Law.ORTHOGONALITY, r.orthogonality_max, ALLOWED[Law.ORTHOGONALITY]),
        Reason(Law.MOTION, r.motion_error_judged_m,
               ACCURATE["accurate_until_s"] * r.length_scale_m + (0.0 if math.isnan(own) else own), "m"),
    )  # fmt: skip
    return [e for e in rows if e.value >= 0.0 and e.limit > 0.0 and (run.stopped or e.value <= e.limit)]
