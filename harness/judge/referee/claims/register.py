"""Read and check the claims register ``results/claims.toml``; an error names its place in one line.

The keys and how to write a claim are described in ``docs/claims.md``.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from msgspec import Meta, field

from ....base.files import FileError, parse_toml, read_text
from ....base.hints import suggest_name
from ....base.shapes import LARGEST, Shape, Text, convert_shape
from .evidence import MEASURES
from .predicates import COMBINE, COMPARE, NEAREST, Band

REGISTER = Path(__file__).resolve().parents[4] / "results" / "claims.toml"
PRESENTATION = "presentation"  # a check that a problem is presented as in the paper, not a result about a solver
CHOICES = {"metric": tuple(MEASURES), "combine": (*COMBINE, NEAREST, ""), "compare": (*COMPARE, "")}
Names = str | tuple[str, ...]


class Test(Shape, frozen=True):
    """A measured number and the band it must lie in."""

    metric: str
    unit: str
    at_least: Annotated[float, Meta(ge=-LARGEST)] = -math.inf
    at_most: Annotated[float, Meta(le=LARGEST)] = math.inf
    combine: str = ""  # how the values along ``across`` are combined
    compare: str = ""  # how the value is compared with those of the map ``against``
    arguments: dict[str, Any] = field(default_factory=dict)

    @property
    def band(self) -> Band:
        """The band that the number must lie in."""
        return Band(self.at_least, self.at_most)


class Map(Shape, frozen=True):
    """The runs that a claim is tried on: a union of selections, with the values required and the settings printed."""

    name: str
    over: Annotated[tuple[dict[str, Any], ...], Meta(min_length=1)]  # the selections
    # least number of values that each named dimension must have
    dimensions: dict[str, Annotated[int, Meta(ge=1)]] = field(default_factory=dict)
    printed: tuple[dict[str, Any], ...] = ()  # settings that the paper prints


class Selection(Shape, frozen=True, forbid_unknown_fields=False):
    """The settings of runs; other keys are dimensions."""

    problem: Names
    solver: Names


class Range(Shape, frozen=True):
    """The values of a dimension between two numbers, both included."""

    begin: float = field(name="from")
    to: float


class Need(Shape, frozen=True):
    """Something without which a claim cannot be tested: a solver, an observable, or data that only the authors have."""

    why: Text
    solver: str = ""
    observable: str = ""  # ``problem.name``
    given: str = ""  # data that only the authors have, in words


class Claim(Shape, frozen=True):
    """A claim of the paper."""

    id: Text
    section: Text
    quote: Annotated[str, Meta(pattern=r"\S", max_length=400, description="a line of at most 400 characters")]
    claim: Text
    figure: tuple[Annotated[int, Meta(ge=1, le=12)], ...] = ()
    tests: tuple[Test, ...] = ()
    map: Map | None = None
    against: Map | None = None  # runs that those of ``map`` are compared with
    pair_by: tuple[str, ...] = ()  # dimensions in which two compared runs must agree
    at_equal_work: bool = False  # True to compare only with runs of no more operations
    must_act: bool = False  # True to exclude runs with equal series, whose difference had no effect
    across: str = ""  # dimension over which runs are considered together
    along: Annotated[int, Meta(ge=2)] | tuple[float, ...] = 2  # the values that a group must have, or their number
    # ranges of ``across``, each judged by itself: from the first to the last
    ranges: tuple[tuple[float, float], ...] = ()
    control: Map | None = None  # runs with the same tests, each compared at equal chart, tolerance and motion
    quantifier: Literal["all", "some"] = "all"  # settings for which it must hold
    needs: tuple[Need, ...] = ()  # solvers, observables or data without which it cannot be tested
    caveats: tuple[Text, ...] = ()
    kind: Literal["result", "presentation"] = "result"
    starting: bool = False  # True if about starting: a run that took no step counts
    summary: bool = False  # True for a statement of the abstract or the conclusions, shown first


@dataclass(frozen=True)
class Register:
    """All claims, and the solvers that each judged solver may represent."""

    claims: tuple[Claim, ...]
    maps: Mapping[str, Map]
    solvers: Mapping[str, str]  # by judged solver: what it may represent, in words


class _File(Shape, frozen=True):
    """The content of the register's file, with claims and maps not yet checked."""

    claims: Annotated[tuple[dict[str, Any], ...], Meta(min_length=1)]
    maps: dict[str, dict[str, Any]] = field(default_factory=dict)
    solvers: dict[str, Text] = field(default_factory=dict)


def read_register(path: Path = REGISTER) -> Register:
    """Read the register in ``path``; raise FileError if it is invalid."""
    return parse_register(read_text(path, "claims"), str(path))


def parse_register(text: str, where: str = "claims") -> Register:
    """Parse a register; ``where`` names it in messages."""
    file = convert_shape(parse_toml(text, where), _File, where)
    maps: dict[str, Map] = {}
    for name, row in file.maps.items():
        maps[name] = _map(name, row, maps, f"{where}: maps.{name}")
    claims: dict[str, Claim] = {}
    for k, row in enumerate(file.claims):
        at = f"{where}: claim {row['id']!r}" if isinstance(row.get("id"), str) else f"{where}: claim {k + 1}"
        claim = _claim(row, maps, at)
        if claim.id in claims:
            raise FileError(f"{at}: the id is taken")
        claims[claim.id] = claim
    return Register(tuple(claims.values()), maps, file.solvers)


def _claim(row: dict[str, Any], maps: Mapping[str, Map], at: str) -> Claim:
    """Return the claim in a row of the register; raise FileError, which begins with its place ``at``, if invalid."""
    tests = row.get("tests", [])
    if isinstance(tests, list):
        tests = [_test(t, f"{at}: test {k + 1}") if isinstance(t, dict) else t for k, t in enumerate(tests)]
    named = {k: _find_map(row[k], maps, f"{at}: {k}") for k in ("map", "against", "control") if k in row}
    claim = convert_shape({**row, "tests": tests, **named}, Claim, at)
    for k, need in enumerate(claim.needs):
        if sum(map(bool, (need.solver, need.observable, need.given))) != 1:
            raise FileError(f"{at}: needs {k + 1}: give one of solver, observable, given, and why")
    if not claim.needs and not (claim.tests and claim.map):
        raise FileError(f"{at}: add `map` and `[[tests]]`, or say under `needs` why the claim cannot be tested")
    if len({t.combine == NEAREST for t in claim.tests}) > 1:
        raise FileError(f"{at}: combine = {NEAREST!r} goes with all tests or none: one and the same run meets them")
    for k, t in enumerate(claim.tests):
        if bool(t.combine) != bool(claim.across):
            raise FileError(f"{at}: test {k + 1}: combine goes with across, and across with combine")
        if ("along" in row or claim.ranges) and not claim.across:
            raise FileError(f"{at}: along and ranges go with across")
        if claim.at_equal_work and claim.against is None:
            raise FileError(f"{at}: at_equal_work goes with against")
        if claim.must_act and claim.against is None:
            raise FileError(f"{at}: must_act goes with against")
        if bool(t.compare) != (claim.against is not None):
            raise FileError(f"{at}: test {k + 1}: compare goes with against, and against with compare")
    return claim


def _test(row: dict[str, Any], at: str) -> Test:
    """Return the test in a row of a claim; raise FileError if a name is unknown or an argument or band missing."""
    metric = row.get("metric", "")
    for key, known in CHOICES.items():
        if (given := row.get(key, known[-1])) not in known:
            raise FileError(f"{at}: unknown {key} {given!r}{suggest_name(str(given), [k for k in known if k])}")
    takes, wants = (MEASURES[metric].takes, MEASURES[metric].wants) if metric else ((), ())
    arguments = {k: v for k, v in row.items() if k in takes}
    rest = {k: v for k, v in row.items() if k not in takes}
    test = convert_shape({**rest, "arguments": arguments}, Test, at)
    if absent := [k for k in wants if k not in row]:
        raise FileError(f"{at}: metric {metric} needs {absent[0]}")
    if math.isinf(test.at_least) and math.isinf(test.at_most):
        raise FileError(f"{at}: a band is needed: at_least, at_most or both")
    if test.at_least > test.at_most:
        raise FileError(f"{at}: the band is empty: at_least {test.at_least:g} is above at_most {test.at_most:g}")
    return test


def _map(name: str, row: dict[str, Any], maps: Mapping[str, Map], at: str) -> Map:
    """Return the map in a row of the register, with selections of other maps inserted.

    Raise FileError if it is invalid.
    """
    printed, over = row.get("printed", []), row.get("over")
    if isinstance(over, list):
        over = [s for k, given in enumerate(over) for s in _selections(given, maps, f"{at}: selection {k + 1}")]
    printed = [_one_a_key(p) for p in ([printed] if isinstance(printed, dict) else printed)]
    found = convert_shape({**row, "name": name, "over": over, "printed": printed}, Map, at)
    for k, selection in enumerate(found.over):
        convert_shape(selection, Selection, f"{at}: selection {k + 1}")
        for name, value in selection.items():
            if isinstance(value, dict):
                convert_shape(value, Range, f"{at}: selection {k + 1}: {name}")
    return found


def _selections(given: Any, maps: Mapping[str, Map], at: str) -> list[Any]:
    """Return the selections that an entry of a map's ``over`` represents.

    The entry is a selection itself, or its key ``map`` names another map, whose selections are taken with the other
    keys of the entry changed.
    """
    own = _one_a_key(given)
    if not isinstance(own, dict) or "map" not in own:
        return [own]
    rest = {k: v for k, v in own.items() if k != "map"}
    return [{**s, **rest} for s in _find_map(own["map"], maps, at).over]


def _one_a_key(given: Any) -> Any:
    """Return a selection with keys of several names expanded: ``{ "a, b" = 1 }`` becomes ``{ a = 1, b = 1 }``."""
    return {n.strip(): v for k, v in given.items() for n in k.split(",")} if isinstance(given, dict) else given


def _find_map(name: Any, maps: Mapping[str, Map], at: str) -> Map:
    """Return the map of that name; raise FileError, with a similar name, if there is none."""
    if name not in maps:
        raise FileError(f"{at}: unknown map {name!r}{suggest_name(str(name), list(maps))}")
    return maps[name]
