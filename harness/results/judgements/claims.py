"""Verdicts on claims of the paper, with what they rest on."""

import math
from enum import StrEnum
from typing import Any, Literal

import msgspec

from ...shapes import Shape

Value = bool | int | float | str | None  # of a dimension of a map; None where it does not exist
Band = tuple[float | None, float | None]  # None: open at that end


SCHEMA: Literal[3] = 3  # of claims.json


class Verdict(StrEnum):
    """A verdict on a claim at some settings: what could be reproduced of it, in words."""

    NOT_REPRODUCED = "not reproduced"  # for none of the choices tried
    REPRODUCED_IF = "reproduced if"  # for some of them, which the finding's ``decision`` names by value
    REPRODUCED = "reproduced"  # for all of them
    CANNOT_BE_TOLD = "cannot be told"


class Ending(StrEnum):
    """The end of a run, or the reason why a setting settles nothing."""

    FINAL = "final"
    MACHINE = "limit of the machine"
    UNCOMPARED = "nothing to compare"
    SLOW = "budget of steps"
    APART = "joints came apart"  # the guard that all solvers share ended it, not the solver
    NO_START = "no start"
    START_UP = "start-up"  # it stopped in the first hundredth of its time, where it is asked when runs stop
    ENDED = "no early end"
    EARLY = "an early end"


class Gap(StrEnum):
    """The kind of thing that is missing to test a claim."""

    NEED = "need"  # ``name`` says what, in the register's words
    VALUES = "values"  # the suite has ``found`` of ``wanted`` values of the dimension ``name``
    RUNS = "runs"  # the results hold ``found`` of ``wanted`` runs, not ``name``
    GROUPS = "groups"  # no two runs differ in ``name`` alone
    SETTLED = "settled"  # no setting settles it
    NUMBER = "number"  # no run has the number ``name``
    REACHED = "reached"  # ``found`` of ``wanted`` settings got to the moment asked about
    HANGS = "hangs"  # without the run ``name``, which failed, the verdict would be another


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
    rival: str = ""  # the run with the smallest or largest of the numbers that it is compared with


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
    """The condition that separates the settings where a claim holds from the others.

    ``by``: the values of one or two dimensions with all of which together it always holds and without which it never
    does, or the other way round (``unless``). Where none separates, with each of ``any_of`` it always holds, and it
    holds in ``rest`` settings more; ``conditions`` are the largest where it always or never does, and ``telling`` is
    the dimension that tells most.
    """

    by: dict[str, tuple[Value, ...]]
    unless: bool = False
    conditions: tuple[Condition, ...] = ()
    telling: str = ""
    any_of: tuple[Condition, ...] = ()
    rest: int = 0
    told: tuple[Count, ...] = ()  # the settings with each value of ``telling``


class LeftOut(Shape, frozen=True):
    """Settings that settle nothing."""

    why: Ending
    settings: int


class Moved(Shape, frozen=True):
    """Another verdict, with the band of one test moved."""

    test: int  # from 0
    by: Literal["wider", "narrower"]
    verdict: Verdict
    holds: int
    settings: int


class Finding(Shape, frozen=True):
    """A verdict on the settings that the paper prints, or on the others."""

    verdict: Verdict
    holds: int = 0
    settings: int = 0  # that settle the claim, those with equal series counted once
    rows: int = 0  # the same, each counted
    stopped: int = 0  # of those that hold: by a number that is unbounded because a run stopped
    decision: Decision | None = None
    borderline: tuple[Moved, ...] = ()  # verdicts that it flips to when a band moves by a factor of 1.5
    left_out: tuple[LeftOut, ...] = ()
    met: tuple[int, int] | None = None  # values along ``across`` that meet it, of those tried, where one suffices
    missing: tuple[Missing, ...] = ()  # why a count settles nothing
    like: int = 0  # settings that the paper does not print, with the series of one that it does: counted with that
    lone: int = 0  # settings that one failed run alone meets, along ``across``: counted as not met beside others


class Control(Shape, frozen=True):
    """What other solvers do that are asked the same in the same chart, at the same tolerance and on the same motion."""

    solvers: tuple[str, ...]
    finding: Finding  # on those beside the settings of the first verdict
    both: int = 0  # of these settings: the claim holds in them, and so it does for the control beside
    alone: int = 0  # of these: the claim holds in them, and the control is not there or left open


class Because(Shape, frozen=True):
    """Evidence for verdicts beside their counts."""

    across: str = ""  # the dimension along which runs are looked at together
    met_at: tuple[Count, ...] = ()  # values along ``across`` that meet the claim, where one suffices
    stand_ins: tuple[str, ...] = ()  # what the judged solvers may be taken for, in the register's words
    unjudged: tuple[str, ...] = ()  # solvers whose runs are in the map, and of which no setting is judged


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
    twin: bool = False  # its series is that of an earlier row
    control: float = math.nan  # the same number of the control beside it
    control_holds: bool | None = None
    command: str = ""  # that repeats its run, the first of several


class Claim(Shape, frozen=True):
    """A claim of the paper with its verdict and evidence."""

    id: str
    kind: str
    section: str
    figure: tuple[int, ...]
    quote: str
    claim: str
    paper: Finding | None  # at the settings that the paper prints; None where the map has none
    beyond: Finding | None  # at the others
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
    by_solver: dict[str, Finding] = msgspec.field(default_factory=dict)  # the first finding, where there are several
    by_solver_beyond: dict[str, Finding] = msgspec.field(default_factory=dict)  # that beyond the paper's settings
    control: Control | None = None
    summary: bool = False  # on what the abstract or the conclusions say

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The findings, at the paper's settings first."""
        return tuple(f for f in (self.paper, self.beyond) if f)

    @property
    def verdict(self) -> Verdict:
        """The verdict at the paper's settings where the map has such, else beyond them."""
        return self.findings[0].verdict if self.findings else Verdict.CANNOT_BE_TOLD

    @property
    def verdicts(self) -> str:
        """Both verdicts as one text: ``reproduced, beyond not reproduced``."""
        beyond = f"beyond {self.beyond.verdict}" if self.beyond else ""
        return ", ".join(filter(None, (str(self.paper.verdict) if self.paper else "", beyond)))


class Code(Shape, frozen=True):
    """Digests of what verdicts were computed from (``harness.results.codes``)."""

    solvers: dict[str, str]
    problems: dict[str, str]
    measuring: str
    judging: str
    runs: str  # of the register and of the runs that its maps select


class Published(Shape, frozen=True):
    """The content of ``claims.json``."""

    schema: Literal[3]
    code: Code
    claims: tuple[Claim, ...]
    commands: dict[str, str] = msgspec.field(default_factory=dict)  # by settings_id, for rows that have none
