"""One number for how far a run is from the exact motion, the same kind for all runs of a problem."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ...harness.results.records import judged_own, reasons_of
from ...harness.results.words import accurate_until, at_least, judged_error, law_of, words_of
from ...harness.types import ACCURATE, ALLOWED, Law, Reason
from .results import Run, Variant, by_solver
from .words import number

EXACT = 1e-12  # of the mechanism's size: position errors below it are rounding
LEVELS = (1e-4, 1e-3, 1e-2, 1e-1, 1.0, 1.5, 4.0)  # a class of colour up to each of these margins, and one above
SHARE = "of its limit"  # the unit of what a record holds as that alone
UNSIZED = (Law.FINITE, Law.START, Law.END)  # broken or not, whatever the numbers
WHOLE = 0.999  # of the known motion: followed to its end
SHADES = ("ten", "one", "tenth")  # of a bar, by the levels of ``ACCURATE``


@dataclass(frozen=True)
class Measure:
    """Which error, with its words and its unit."""

    what: str
    name: str  # of the columns
    unit: str
    own: float  # the reference's stated error in that unit; NaN if not known
    until: float | None = None  # [s] errors are judged to here where that is before the end

    def of(self, run: Run) -> float:
        """The error of a run; NaN where it has none."""
        return judged_error(run.record, self.name, self.unit)


def measure_for(runs: Sequence[Run]) -> Measure | None:
    """Position error; orientation where all positions are exact (a body that only turns); None without a reference."""
    known = [c for c in runs if not math.isnan(c.record.position_error_max_m)]
    if not known:
        return None
    length = max((c.record.length_scale_m for c in known if c.record.length_scale_m > 0.0), default=1.0)
    own = max((e for c in known if not math.isnan(e := c.record.reference_own_error_m)), default=math.nan)
    until = judged_until(known)
    words = "" if until is None else f" to {until:.4g} s"
    if until is not None:
        own = max((e for c in known if not math.isnan(e := judged_own(c.record))), default=math.nan)
    position = Measure(f"position error{words}", "position_error", "m", own, until)
    if max(map(position.of, known)) > EXACT * length:
        return position
    return Measure(f"orientation error{words}", "orientation_error", "rad", own / length, until)


def judged_until(runs: Sequence[Run]) -> float | None:
    """[s] the time up to which errors are judged, if that is before the reference or the longest run ends."""
    times = [c.record.judged_to_s for c in runs if not math.isnan(c.record.judged_to_s)]
    ends = [min(c.record.t_reached_s, c.record.reference_horizon_s) for c in runs if c.record.reference]
    if not times or not ends or max(times) > 0.98 * max(ends):
        return None
    return max(times)


def drifts(run: Run) -> bool | None:
    """Whether the energy error wanders off rather than swings: its mean shifts from first to last quarter.

    True when the shift is over a third of the largest error (a straight line shifts by three quarters, a swing by
    nothing) and above rounding; None when it cannot be decided.
    """
    r = run.record
    shift = abs(r.energy_mean_last_quarter_J - r.energy_mean_first_quarter_J)
    if math.isnan(shift) or not math.isfinite(r.energy_drift_max_J):
        return None
    rounding = 1e-13 * (r.energy_scale_J if r.energy_scale_J > 0.0 else 1.0)
    return shift > max(r.energy_drift_max_J / 3.0, rounding)


def energy_kind(run: Run) -> str:
    """The same as a word; empty when it cannot be decided."""
    return {None: "", True: "drifts", False: "bounded"}[drifts(run)]


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
    return [e for e in rows if e.value >= 0.0 and e.limit > 0.0 and (run.stopped or e.value <= e.limit)]


def _of_constraints(law: Law, share: float, value: float, limit: float, unit: str) -> Reason:
    """In metres where what is recorded is what is judged, else (axis rows, several mechanisms) as the share judged."""
    return Reason(law, share, 1.0, SHARE) if math.isnan(limit) else Reason(law, value, limit, unit)


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
