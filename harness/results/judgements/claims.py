"""Define the types of verdicts on claims of the paper and of the field, with their evidence."""

import math
from enum import StrEnum
from typing import Any, Literal

import msgspec

from ...base.shapes import Shape

# value of a dimension of a map, several numbers for a vector; None if a setting does not have the dimension
Value = bool | int | float | str | tuple[float, ...] | None
Band = tuple[float | None, float | None]  # least and largest number allowed; None: no limit at that end


SCHEMA: Literal[3] = 3  # schema of claims.json


class ClaimVerdict(StrEnum):
    """A verdict on a claim at some settings."""

    NOT_REPRODUCED = "not reproduced"  # it holds for none of the choices tried
    REPRODUCED_IF = "reproduced if"  # it holds for some of them, named by the finding's ``decision``
    REPRODUCED = "reproduced"  # it holds for all of them; for at least one with the quantifier "some"
    CANNOT_BE_TOLD = "cannot be told"


class Ending(StrEnum):
    """The way a run ended, or the reason why a setting cannot decide a claim."""

    FINAL = "final"
    MACHINE = "limit of the machine"
    UNCOMPARED = "nothing to compare"
    SLOW = "budget of steps"
    APART = "joints came apart"  # ended by the guard that all solvers share, not by the solver
    NO_START = "no start"
    START_UP = "start-up"  # a stop in the first hundredth of the time, if the claim is about stops
    ENDED = "no early end"
    EARLY = "an early end"


class ClaimGap(StrEnum):
    """The kind of thing that is missing to test a claim."""

    NEED = "need"  # ``name`` describes it in the register's words
    VALUES = "values"  # the suite has ``found`` of ``wanted`` values of the dimension ``name``
    RUNS = "runs"  # the results hold ``found`` of ``wanted`` runs; ``name`` is missing
    GROUPS = "groups"  # no two runs differ in ``name`` alone
    SETTLED = "settled"  # no setting settles it
    NUMBER = "number"  # no run has the number ``name``
    REACHED = "reached"  # ``found`` of ``wanted`` settings reached the time of the claim
    HANGS = "hangs"  # the verdict depends on the one run ``name``, which failed


class MissingReason(Shape, frozen=True):
    """A reason why a claim cannot be tested."""

    gap: ClaimGap
    name: str = ""
    map: str = ""
    found: int = 0
    wanted: int = 0


class JudgedTest(Shape, frozen=True):
    """A test of a claim: a measured number and the band in which it must lie."""

    metric: str
    arguments: dict[str, Any]
    combine: str
    compare: str
    unit: str
    band: Band
    measured: float  # at the setting shown; NaN for an unbounded number too
    unbounded: bool = False
    rival: str = ""  # the run with the smallest or largest number compared with


class SettingsCount(Shape, frozen=True):
    """The number of ``settings`` with one value of a dimension, and of those where the claim ``holds``."""

    value: Value
    holds: int
    settings: int


class Condition(Shape, frozen=True):
    """The number of ``settings`` with the values ``at`` of some dimensions, and of those where the claim ``holds``."""

    at: dict[str, Value]
    holds: int
    settings: int


class Decision(Shape, frozen=True):
    """The condition on dimensions that separates the settings where a claim holds from the others.

    ``by`` has values of one or two dimensions: the claim holds for settings with these values and for no others, or,
    with ``unless``, only for the others. If no such condition exists, the claim always holds under each of ``any_of``,
    and in ``rest`` further settings; ``conditions`` are the largest sets of settings where it always or never holds,
    and ``telling`` is the dimension that separates best.
    """

    by: dict[str, tuple[Value, ...]]  # values by dimension; empty without such a condition
    unless: bool = False
    conditions: tuple[Condition, ...] = ()
    telling: str = ""
    any_of: tuple[Condition, ...] = ()
    rest: int = 0
    told: tuple[SettingsCount, ...] = ()  # the settings with each value of ``telling``


class ExcludedSettings(Shape, frozen=True):
    """The number of settings that are excluded from the count for one reason."""

    why: Ending
    settings: int


class MovedVerdict(Shape, frozen=True):
    """A verdict on a claim that differs from the given one because the band of one test is wider or narrower."""

    test: int  # index of the test, from 0
    by: Literal["wider", "narrower"]
    verdict: ClaimVerdict
    holds: int  # settings where the claim then holds, of ``settings``
    settings: int


class ClaimFinding(Shape, frozen=True):
    """A verdict on a claim at the settings that the paper prints, or at the others, with its counts of settings."""

    verdict: ClaimVerdict
    holds: int = 0  # settings where the claim holds
    settings: int = 0  # settings that count towards the verdict; equal series are counted once
    rows: int = 0  # settings that count towards the verdict, each counted
    stopped: int = 0  # settings that hold by an unbounded number, because a run stopped
    decision: Decision | None = None
    borderline: tuple[MovedVerdict, ...] = ()  # other verdicts when a band moves by a factor of 1.5
    left_out: tuple[ExcludedSettings, ...] = ()
    met: tuple[int, int] | None = None  # values along ``across`` that meet it and values tried, if one suffices
    missing: tuple[MissingReason, ...] = ()  # reasons why a count settles nothing
    like: int = 0  # unprinted settings counted with a printed one that has the same series
    lone: int = 0  # settings met along ``across`` by one failed run only: counted as not met


class Control(Shape, frozen=True):
    """The outcome of other solvers that are tested on the same claim, with the same chart, tolerance and motion."""

    solvers: tuple[str, ...]
    finding: ClaimFinding  # on the control's runs at the settings of the first verdict
    both: int = 0  # settings where the claim holds for the solver and for the control
    alone: int = 0  # settings where the claim holds and the control is missing or open


class VerdictEvidence(Shape, frozen=True):
    """The evidence for a verdict in addition to the counts of settings."""

    across: str = ""  # the dimension along which runs are considered together
    met_at: tuple[SettingsCount, ...] = ()  # values along ``across`` that meet the claim, if one suffices
    stand_ins: tuple[str, ...] = ()  # solvers that the judged ones represent, in the register's words
    unjudged: tuple[str, ...] = ()  # solvers with runs in the map but no judged setting


class MapRow(Shape, frozen=True):
    """A setting of a map, with the number measured there and whether the claim holds."""

    settings_id: str
    case: str
    more: int  # further runs considered with it, along ``across``
    at: dict[str, Value]
    holds: bool | None
    measured: float
    status: str
    printed: bool
    twin: bool = False  # True if its series equals that of an earlier row
    control: float = math.nan  # the control's number at the same settings
    control_holds: bool | None = None
    command: str = ""  # the command that repeats its run, the first of several


class JudgedClaim(Shape, frozen=True):
    """A claim of the paper, or of the field's textbooks and manuals, with its verdict and evidence."""

    id: str
    kind: str
    section: str
    figure: tuple[int, ...]
    quote: str
    claim: str
    paper: ClaimFinding | None  # at the settings that the paper prints; None if the map has none
    beyond: ClaimFinding | None  # at the other settings
    tests: tuple[JudgedTest, ...]
    measured_range: tuple[float, ...]  # least and largest of the first number; empty if nothing was measured
    because: VerdictEvidence
    missing: tuple[MissingReason, ...]
    caveats: tuple[str, ...]
    settings: dict[str, tuple[Value, ...]]
    against: tuple[str, ...]  # cases that the numbers are compared with
    settings_ids: tuple[str, ...]
    factors: dict[str, tuple[SettingsCount, ...]]
    map: tuple[MapRow, ...]
    # the finding ``paper`` by solver, if there are several
    by_solver: dict[str, ClaimFinding] = msgspec.field(default_factory=dict)
    by_solver_beyond: dict[str, ClaimFinding] = msgspec.field(default_factory=dict)  # the finding ``beyond`` by solver
    control: Control | None = None
    summary: bool = False  # True for a statement of the abstract or the conclusions
    register: Literal["paper", "field"] = "paper"  # whose claim it is

    @property
    def findings(self) -> tuple[ClaimFinding, ...]:
        """The findings that exist, that at the paper's settings first."""
        return tuple(f for f in (self.paper, self.beyond) if f)

    @property
    def verdict(self) -> ClaimVerdict:
        """The verdict at the paper's settings if the map has any, else at the others; unknown if it has neither."""
        return self.findings[0].verdict if self.findings else ClaimVerdict.CANNOT_BE_TOLD

    @property
    def verdicts(self) -> str:
        """Both verdicts as one text: ``reproduced, beyond not reproduced``."""
        beyond = f"beyond {self.beyond.verdict}" if self.beyond else ""
        return ", ".join(filter(None, (str(self.paper.verdict) if self.paper else "", beyond)))


class CodeDigests(Shape, frozen=True):
    """The digests of the code and runs that verdicts were computed from (``harness.catalogue.codes``)."""

    solvers: dict[str, str]
    problems: dict[str, str]
    measuring: str  # without the functions of columns; in older files of all that runs and measures
    judging: str
    runs: str  # digest of the register and of the runs that its maps select
    running: str = ""  # of what runs solvers; empty in older files
    # of the function of each column; empty in older files
    columns: dict[str, str] = msgspec.field(default_factory=dict)


class PublishedClaims(Shape, frozen=True):
    """The content of ``claims.json``."""

    schema: Literal[3]
    code: CodeDigests
    claims: tuple[JudgedClaim, ...]
    commands: dict[str, str] = msgspec.field(default_factory=dict)  # by settings_id, for rows without a command
