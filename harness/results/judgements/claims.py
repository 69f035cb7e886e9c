"""Verdicts on claims of the paper, with what they rest on."""

from enum import StrEnum
from typing import Any

from ...shapes import Shape

Value = bool | int | float | str | None  # of a dimension of a map; None where it does not exist
Band = tuple[float | None, float | None]  # None: open at that end


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
