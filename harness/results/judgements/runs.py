"""Judgements of runs beside others: orders, drift, symmetries, work, false successes."""

import math
from enum import StrEnum
from typing import Any, Literal

from ...shapes import Shape
from ...types import Reason
from ..findings import Finding, Measured, Required, Verdict

NAN = math.nan
OrderVerdict = Literal[
    "certified", "above declared", "below declared", "undecided", "measured", "exact", "floor", "not measured",
    "refused",
]  # fmt: skip
FitKind = Literal["power", "lost", "flat", "none", "exact"]
SymmetryVerdict = Literal["holds", "broken", "undecided", "failed", "refused", "not applicable"]


class Asked(Shape, frozen=True):
    """The run that was asked for."""

    problem: str
    variant: str
    solver: str
    case: str


class Note(StrEnum):
    """A reason why runs of a ladder were left out."""

    NO_SCALE = "no scale"
    CUT = "cut steps"
    UNRESOLVED = "unresolved errors"


class Order(Asked, frozen=True):
    """The order of one quantity of one solver on one variant."""

    quantity: str
    symbol: str
    unit: str
    against: Literal["dt", "mean step"]
    declared: float
    order: float
    low: float
    high: float
    dt: tuple[float, ...]
    error: tuple[float, ...]
    used: tuple[bool, ...]
    floor: float
    rtol: tuple[float, ...]
    exponent: float
    exponent_low: float
    exponent_high: float
    verdict: OrderVerdict
    fit: FitKind
    slopes: tuple[float, ...]  # those finer than the points used; all where no range of steps was found
    unfinished: int  # runs of the ladder that did not succeed
    notes: tuple[Note, ...]
    t_end_s: float
    settings_ids: tuple[str, ...]
    status: str = ""  # of the finest run that did not succeed, and its message, where too few did
    message: str = ""
    unmeasured: int = 0  # runs of the ladder that succeeded without an error to measure

    @property
    def is_measured(self) -> bool:
        """Whether enough runs have an error."""
        return self.verdict not in ("not measured", "refused")

    def as_finding(self, words: str = "") -> Finding:
        """The order beside the declared one; those of energy and reactions may differ from it and are only shown."""
        if self.fit == "power":
            words = words or f"[{self.low:.2f}, {self.high:.2f}] in the {self.against}"
        open_ = math.isnan(self.declared) or self.quantity in ("energy", "reaction") or not self.is_measured
        good = None if open_ or self.verdict == "undecided" else self.verdict != "below declared"
        measured = Measured(f"order, {self.problem}, {self.quantity}", self.order, "", words=words or self.verdict)
        required = Required(words="" if math.isnan(self.declared) else f"{self.declared:g} declared")
        return Finding(measured, required, Verdict.of(good), f"{self.variant} {self.case}")


class Drift(Asked, frozen=True):
    """Parts of a long run's energy error, with 95 % intervals."""

    settings_id: str
    status: str
    verdict: Literal["bounded", "trend", "wanders", "undecided", "failed", "too short"]
    span_s: float
    periods: int = 0
    oscillation_J: float = NAN
    trend_W: float = NAN
    trend_low_W: float = NAN
    trend_high_W: float = NAN
    walk_J_per_sqrt_s: float = NAN
    walk_low: float = NAN
    walk_high: float = NAN


class Unjudged(StrEnum):
    """Why a symmetry has no number."""

    BASE = "run as it stands"  # it ended with ``status``
    PRESENTED = "presented run"  # the same
    BOUND = "bound"  # a run that the bound is made of failed, or has no end
    SINGLE = "single body"  # nothing to renumber
    WAY_BACK = "way back"
    END = "end"


class Symmetry(Shape, frozen=True):
    """A check of one solver on one variant: how far apart two runs end [m], and how far they may."""

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
    factor: float = NAN  # of a changed unit
    unit: str = "m"
    deviation: float = NAN
    bound: float = NAN
    exact: bool | None = None  # kept as far as the steps are solved; None under error control
    exact_bound: float = NAN
    level: float = NAN  # change of the end at a tenth of the tolerance
    halved: float = NAN  # at half the step; 0 under error control
    rounding: float = NAN
    growth: float = NAN  # of a changed start, at the end

    @property
    def title(self) -> str:
        """The check with its factor or presentation."""
        how = f" x {self.factor:g}" if self.factor == self.factor else ""
        return f"{self.check}{how}, {self.presented}".removesuffix(", ")

    def as_finding(self) -> Finding:
        """The deviation beside its bound."""
        good = {"holds": True, "broken": False, "failed": False}.get(self.verdict)
        measured = Measured(
            f"symmetry: {self.title}", self.deviation, "m", words=f"{self.verdict} {self.message}".strip()
        )
        return Finding(measured, Required(most=self.bound), Verdict.of(good), f"{self.solver} {self.variant}")


class WorkPoint(Asked, frozen=True):
    """Cost and error of one run."""

    settings_id: str
    label: str
    best: bool
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
    """The least work at which one solver reaches each target that it reaches, of ``total``."""

    solver: str
    work: str
    total: int
    target_work: tuple[float, ...]


class Targets(Shape, frozen=True):
    """Errors of one variant that the reference, itself off by ``own``, can judge."""

    variant: str
    unit: str
    own: float
    errors: tuple[float, ...]


class Work(Shape, frozen=True):
    """All points, and profiles with the best of all settings and with default options."""

    points: tuple[WorkPoint, ...]
    profile: tuple[WorkProfile, ...]
    profile_default: tuple[WorkProfile, ...]
    targets: tuple[Targets, ...]


class FalseSuccess(Shape, frozen=True):
    """A run whose solver claims success while laws or symmetries say no."""

    case: str
    settings_id: str
    solver: str
    problem: str
    because: tuple[Reason, ...]
