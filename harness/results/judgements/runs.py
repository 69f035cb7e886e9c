"""Define the types of judgements that compare runs: orders, drift, symmetries, work, false successes."""

import math
from enum import StrEnum
from typing import Any, Literal

from ...base.shapes import Shape
from ...mechanics.types import Reason
from ..findings import Finding, Verdict

NAN = math.nan
OrderVerdict = Literal[  # worst first
    "below declared",
    "not measured",
    "refused",
    "undecided",
    "above declared",
    "measured",
    "certified",
    "floor",
    "exact",
]
FitKind = Literal["power", "lost", "flat", "none", "exact"]
DriftVerdict = Literal["bounded", "trend", "wanders", "undecided", "failed", "too short"]
SymmetryVerdict = Literal["holds", "broken", "undecided", "failed", "refused", "not applicable"]
REVERSAL, PLANARITY = "time reversal", "planar symmetry"  # checks that compare a run with its own start


class JudgedSettings(Shape, frozen=True):
    """The problem, variant, solver and settings that a judgement is about."""

    problem: str
    variant: str
    solver: str
    case: str


class Unjudged(StrEnum):
    """The reason why a judgement has no number, or leaves runs out."""

    # of an order: runs of a ladder of steps that are left out
    NO_SCALE = "no scale"
    CUT = "cut steps"
    UNRESOLVED = "unresolved errors"
    # of a check of a symmetry
    BASE = "run as it stands"  # this run ended with ``status``
    PRESENTED = "presented run"  # this run ended with ``status``
    BOUND = "bound"  # a run that the bound is computed from failed, or has no end
    SINGLE = "single body"  # nothing to renumber
    WAY_BACK = "way back"
    END = "end"


class Order(JudgedSettings, frozen=True):
    """The observed order of one quantity of one solver on one variant."""

    quantity: str
    symbol: str
    unit: str
    against: Literal["dt", "mean step"]
    declared: float  # order that the solver declares; NaN if none
    order: float  # observed order, with the ends of its interval
    low: float
    high: float
    dt: tuple[float, ...]  # steps, or mean steps, of the runs [s], coarsest first
    error: tuple[float, ...]  # error of each run, in ``unit``
    used: tuple[bool, ...]  # for each run, whether the order is fitted to it
    floor: float  # median error of the finer runs left out; NaN without
    rtol: tuple[float, ...]
    exponent: float  # of the error against rtol, under error control
    exponent_low: float
    exponent_high: float
    verdict: OrderVerdict
    fit: FitKind
    slopes: tuple[float, ...]  # slopes finer than the points used; all if no range of steps was found
    unfinished: int  # runs of the ladder that did not succeed
    notes: tuple[Unjudged, ...]
    t_end_s: float
    settings_ids: tuple[str, ...]
    status: str = ""  # status and message of the finest failed run, if too few succeeded
    message: str = ""
    unmeasured: int = 0  # runs of the ladder that succeeded without an error to measure

    @property
    def is_measured(self) -> bool:
        """True unless too few runs of the ladder have an error, or the solver refused."""
        return self.verdict not in ("not measured", "refused")

    def as_finding(self, words: str = "") -> Finding:
        """Return the order as a finding, with the declared order as its requirement.

        The verdict is open for orders of energy and reactions, which may differ from it, and where no order could be
        measured or decided. ``words`` replace those beside the number.
        """
        if self.fit == "power":
            words = words or f"[{self.low:.2f}, {self.high:.2f}] in the {self.against}"
        open_ = math.isnan(self.declared) or self.quantity in ("energy", "reaction") or not self.is_measured
        good = None if open_ or self.verdict == "undecided" else self.verdict != "below declared"
        return Finding(
            f"order, {self.problem}, {self.quantity}",
            self.order,
            words=words or self.verdict,
            count=sum(self.used) if self.fit == "power" else len(self.error),
            required="" if math.isnan(self.declared) else f"{self.declared:g} declared",
            verdict=Verdict.from_outcome(good),
            subject=f"{self.variant} {self.case}",
        )


class Drift(JudgedSettings, frozen=True):
    """The parts of a long run's energy error, with 95 % intervals: oscillation, linear trend and random walk."""

    settings_id: str
    status: str
    verdict: DriftVerdict
    span_s: float
    periods: int = 0
    oscillation_J: float = NAN
    trend_W: float = NAN
    trend_low_W: float = NAN
    trend_high_W: float = NAN
    walk_J_per_sqrt_s: float = NAN
    walk_low: float = NAN
    walk_high: float = NAN


class Symmetry(Shape, frozen=True):
    """A check of one solver on one variant: the distance between the ends of two runs [m], and its bound."""

    solver: str
    options: dict[str, Any]
    check: str
    problem: str
    variant: str
    settings_ids: tuple[str, ...]
    verdict: SymmetryVerdict
    unjudged: Unjudged | None = None
    status: str = ""
    message: str = ""
    presented: str = ""  # the presentation in which planarity is checked
    factor: float = NAN  # factor of a changed unit
    unit: str = "m"
    deviation: float = NAN  # measured distance
    bound: float = NAN  # distance allowed by the scheme's errors
    exact: bool | None = None  # True if kept to the tolerance of the step equations; None under error control
    exact_bound: float = NAN  # distance allowed if the symmetry is kept exactly
    level: float = NAN  # change of the end at a tenth of the tolerance
    halved: float = NAN  # change of the end at half the step; 0 under error control
    rounding: float = NAN
    growth: float = NAN  # growth of a changed start until the end
    own_error: float = NAN  # if broken: the error that the method makes anyway; NaN if not known until the end
    misleads: bool | None = None  # if broken: False if the motion is right, or the break is below ``own_error``

    @property
    def contradicts(self) -> bool:
        """True if the symmetry is broken and that misleads; one that was published without this does."""
        return self.verdict == "broken" and self.misleads is not False

    @property
    def title(self) -> str:
        """The name of the check, with the factor of the unit or the presentation it was made in."""
        how = f" x {self.factor:g}" if self.factor == self.factor else ""
        return f"{self.check}{how}, {self.presented}".removesuffix(", ")

    def as_finding(self) -> Finding:
        """Return the distance of the two ends as a finding, with its bound as the requirement."""
        good = {"holds": True, "broken": False, "failed": False}.get(self.verdict)
        words, verdict = f"{self.verdict} {self.message}".strip(), Verdict.from_outcome(good)
        return Finding(
            f"symmetry: {self.title}",
            self.deviation,
            "m",
            words,
            most=self.bound,
            verdict=verdict,
            subject=f"{self.solver} {self.variant}",
        )


class WorkPoint(JudgedSettings, frozen=True):
    """The cost and error of one run, for work-precision diagrams."""

    settings_id: str
    label: str
    best: bool  # no run of its solver beats it in both error and operations
    status: str
    error: float
    error_kind: str
    unit: str
    energy_drift_J: float
    phi_max: float
    cpu_s: float
    steps: int
    evaluations: float
    factorisations: float
    operations: float
    reference_own_error: float
    index1: float = math.nan  # work in index-1 evaluations


class WorkProfile(Shape, frozen=True):
    """The least work at which one solver reaches each target that it can reach, of ``total`` targets."""

    solver: str
    work: str  # kind of work: "operations", "steps", "cpu", ...
    total: int
    target_work: tuple[float, ...]  # least work at each target reached, ascending


class Targets(Shape, frozen=True):
    """The target errors of one variant, which a reference with stated error ``own`` is accurate enough to judge."""

    variant: str
    unit: str
    own: float
    errors: tuple[float, ...]


class Work(Shape, frozen=True):
    """The costs and errors of all runs, and profiles by the best of all settings and by default options."""

    points: tuple[WorkPoint, ...]
    profile: tuple[WorkProfile, ...]
    profile_default: tuple[WorkProfile, ...]
    targets: tuple[Targets, ...]


class FalseSuccess(Shape, frozen=True):
    """A run whose solver claims success although it breaks laws or symmetries."""

    case: str
    settings_id: str
    solver: str
    problem: str
    because: tuple[Reason, ...]
