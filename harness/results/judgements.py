"""What the referee finds, typed from where it is found to where it is shown: ``<results>/judgement/*.json``.

Numbers that do not exist are NaN, in files null. Words are made where they are shown, never stored or parsed.
"""

import json
import math
from dataclasses import dataclass, is_dataclass
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import Any, Generic, Literal, TypeVar, get_args, get_origin, get_type_hints

import msgspec

from ..files import parse_json, read_text, to_json
from ..shapes import Shape, shaped
from ..types import Reason

FOLDER = "judgement"
PUBLISHED = Path(__file__).resolve().parents[2] / "results" / "published"
NAN = math.nan
T = TypeVar("T")
Value = bool | int | float | str | None  # of a dimension of a map; None where it does not exist
OrderVerdict = Literal["certified", "above declared", "below declared", "undecided", "measured", "exact", "floor"]
FitKind = Literal["power", "lost", "flat", "none", "exact"]
SymmetryVerdict = Literal["holds", "broken", "undecided", "failed", "refused", "not applicable"]
Band = tuple[float | None, float | None]  # None: open at that end


class JudgementError(ValueError):
    """A file that is missing or has another shape; the message is one line."""


class Verdict(StrEnum):
    """On a claim."""

    REFUTED = "REFUTED"
    CONDITIONAL = "CONDITIONAL"
    SUPPORTED = "SUPPORTED"
    UNTESTABLE = "UNTESTABLE"


class Ending(StrEnum):
    """How a run ended, or why a setting settles nothing."""

    FINAL = "final"
    MACHINE = "limit of the machine"
    UNCOMPARED = "nothing to compare"
    SLOW = "budget of steps"
    NO_STEP = "no first step"
    ENDED = "no early end"


class Gap(StrEnum):
    """What kind of thing is missing to test a claim."""

    NEED = "need"  # ``name`` says what, in the register's words
    VALUES = "values"  # the suite has ``found`` of ``wanted`` values of the dimension ``name``
    RUNS = "runs"  # the results hold ``found`` of ``wanted`` runs, not ``name``
    GROUPS = "groups"  # no two runs differ in ``name`` alone
    SETTLED = "settled"  # no setting settles it
    NUMBER = "number"  # no run has the number ``name``


class Missing(Shape, frozen=True):
    """One reason why a claim cannot be tested."""

    gap: Gap
    name: str = ""
    map: str = ""
    found: int = 0
    wanted: int = 0


class Test(Shape, frozen=True):
    """One measured number and its band."""

    metric: str
    arguments: dict[str, Any]
    combine: str
    compare: str
    unit: str
    band: Band
    measured: float  # at the setting shown; NaN for an unbounded number too
    unbounded: bool = False


class Count(Shape, frozen=True):
    """Settings with one value of a dimension."""

    value: Value
    holds: int
    settings: int


class Condition(Shape, frozen=True):
    """Settings with these values of some dimensions."""

    at: dict[str, Value]
    holds: int
    settings: int


class Decision(Shape, frozen=True):
    """What separates the settings where a claim holds from the others.

    ``by``: the one or two dimensions that do, ``conditions`` all their combinations. Without them ``conditions`` are
    those where it always or never holds, ``telling`` the dimension that tells most.
    """

    by: tuple[str, ...]
    conditions: tuple[Condition, ...]
    telling: str = ""


class LeftOut(Shape, frozen=True):
    """Settings that settle nothing."""

    why: Ending
    settings: int


class Because(Shape, frozen=True):
    """The counts and conditions that a verdict rests on."""

    holds: int
    settings: int  # that settle the claim
    across: str = ""  # the dimension along which runs are looked at together
    stopped: int = 0  # of those that hold: by a number that is unbounded because a run stopped
    printed_holds: int = 0
    printed: int = 0  # settings that the paper prints
    met_at: tuple[Count, ...] = ()  # values along ``across`` that meet the claim, where one suffices
    decision: Decision | None = None
    left_out: tuple[LeftOut, ...] = ()
    stand_ins: tuple[str, ...] = ()  # what the solvers may be taken for, in the register's words


class MapRow(Shape, frozen=True):
    """One setting of a map."""

    settings_id: str
    case: str
    more: int  # runs looked at with it, along ``across``
    at: dict[str, Value]
    holds: bool | None
    measured: float
    status: str
    printed: bool


class Claim(Shape, frozen=True):
    """A claim of the paper with its verdict and evidence."""

    id: str
    kind: str
    section: str
    figure: tuple[int, ...]
    quote: str
    claim: str
    verdict: Verdict
    tests: tuple[Test, ...]
    measured_range: tuple[float, ...]  # least and largest of the first number; empty where nothing was measured
    because: Because
    missing: tuple[Missing, ...]
    caveats: tuple[str, ...]
    settings: dict[str, tuple[Value, ...]]
    against: tuple[str, ...]  # cases that the numbers are compared with
    settings_ids: tuple[str, ...]
    factors: dict[str, tuple[Count, ...]]
    map: tuple[MapRow, ...]


class Asked(Shape, frozen=True):
    """What was run."""

    problem: str
    variant: str
    solver: str
    case: str


class Note(StrEnum):
    """What was left out of a ladder, or is not known."""

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
    unfinished: int  # runs of the ladder without an error
    notes: tuple[Note, ...]
    t_end_s: float
    settings_ids: tuple[str, ...]


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


class WorkPoint(Asked, frozen=True):
    """What one run cost and how far off it was."""

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


@dataclass(frozen=True)
class File(Generic[T]):
    """One judgement file and its type."""

    name: str
    kind: type[T]


CLAIMS = File("claims", tuple[Claim, ...])
ORDERS = File("certificates", tuple[Order, ...])
DRIFTS = File("drift", tuple[Drift, ...])
SYMMETRIES = File("symmetries", tuple[Symmetry, ...])
WORK = File("work", Work)
WRONG = File("wrong", tuple[FalseSuccess, ...])


def read(file: File[T], folder: Path) -> T:
    """The judgement in ``folder``; JudgementError where it is not one, FileNotFoundError where there is none."""
    path = folder / f"{file.name}.json"
    if not path.exists():
        raise FileNotFoundError(path)
    where = f"{path.parent.name}/{path.name}"
    plain = parse_json(read_text(path, "the judgement", JudgementError), where, JudgementError)
    return shaped(_numbers(plain, file.kind), file.kind, where, JudgementError)


def as_text(judged: Any) -> str:
    """Strict JSON of which a diff can be read: a line a row of every list of tables; NaN and infinity are null."""
    return _text(json.loads(to_json(judged)), 0) + "\n"


def _text(plain: Any, depth: int) -> str:
    pad = " " * (depth + 1)
    if isinstance(plain, dict) and plain and depth < 2:
        rows = [f"{json.dumps(k, ensure_ascii=False)}: {_text(v, depth + 1)}" for k, v in plain.items()]
        return "{\n" + ",\n".join(pad + r for r in rows) + "\n" + pad[:-1] + "}"
    if isinstance(plain, list) and any(isinstance(v, dict | list) for v in plain):
        return "[\n" + ",\n".join(pad + _text(v, depth + 1) for v in plain) + "\n" + pad[:-1] + "]"
    return json.dumps(plain, ensure_ascii=False)


def _numbers(plain: Any, kind: Any) -> Any:
    """``plain`` with NaN for null where ``kind`` is a number."""
    if plain is None:
        return NAN if kind is float else None
    inner = get_args(kind)
    if isinstance(plain, list) and inner:
        return [_numbers(v, inner[0]) for v in plain]
    if isinstance(plain, dict):
        fields = dict.fromkeys(plain, inner[1]) if get_origin(kind) is dict else _fields(kind)
        return {k: _numbers(v, fields.get(k)) for k, v in plain.items()}
    return plain


@cache
def _fields(kind: Any) -> dict[str, Any]:
    for k in (kind, *get_args(kind)):
        if isinstance(k, type) and (issubclass(k, msgspec.Struct) or is_dataclass(k)):
            return get_type_hints(k)
    return {}
