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
from .bands import COMBINE, COMPARE, NEAREST, Band
from .measures import MEASURES, Measure

REGISTER = Path(__file__).resolve().parents[4] / "results" / "claims.toml"
PRESENTATION = "presentation"  # a check that a problem is presented as in the paper, not a result about a solver
CHOICES: Mapping[str, Mapping[str, Any]] = {
    "metric": MEASURES,
    "combine": {**COMBINE, NEAREST: None},
    "compare": COMPARE,
}
MAPS = ("map", "against", "control")  # keys of a claim that name a map
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

    def __post_init__(self) -> None:
        """Raise ValueError if an argument or the band is missing, or the band is empty."""
        if absent := [k for k in self.measure.wants if k not in self.arguments]:
            raise ValueError(f"metric {self.metric} needs {absent[0]}")
        if math.isinf(self.at_least) and math.isinf(self.at_most):
            raise ValueError("a band is needed: at_least, at_most or both")
        if self.at_least > self.at_most:
            raise ValueError(f"the band is empty: at_least {self.at_least:g} is above at_most {self.at_most:g}")

    @property
    def measure(self) -> Measure:
        """The function that measures the number, with what it depends on."""
        return MEASURES[self.metric]

    @property
    def key(self) -> tuple[str, str]:
        """The metric with its arguments; tests that differ in their bands alone share it."""
        return self.metric, repr(sorted(self.arguments.items()))

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

    def __post_init__(self) -> None:
        """Raise ValueError unless one thing is needed."""
        if sum(map(bool, (self.solver, self.observable, self.given))) != 1:
            raise ValueError("give one of solver, observable, given, and why")


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

    def __post_init__(self) -> None:
        """Raise ValueError if a key is given without the one that it goes with."""
        if not self.needs and not (self.tests and self.map):
            raise ValueError("add `map` and `[[tests]]`, or say under `needs` why the claim cannot be tested")
        if len({t.combine == NEAREST for t in self.tests}) > 1:
            raise ValueError(f"combine = {NEAREST!r} goes with all tests or none: one and the same run meets them")
        for k, t in enumerate(self.tests):
            for one, other in (("combine", "across"), ("compare", "against")):
                if bool(getattr(t, one)) != bool(getattr(self, other)):
                    raise ValueError(f"test {k + 1}: {one} goes with {other}, and {other} with {one}")
        if (self.along != 2 or self.ranges) and not self.across:
            raise ValueError("along and ranges go with across")
        for key in ("at_equal_work", "must_act"):
            if getattr(self, key) and self.against is None:
                raise ValueError(f"{key} goes with against")

    @property
    def maps(self) -> tuple["Map | None", ...]:
        """The maps of its runs, of those that they are compared with, and of its control."""
        return self.map, self.against, self.control

    @property
    def one_suffices(self) -> bool:
        """True if one value along ``across`` that meets all tests suffices for the claim."""
        return any(t.combine == NEAREST for t in self.tests)

    @property
    def asks_when(self) -> bool:
        """True if a number is the time at which a run stopped."""
        return any(t.measure.of_stopped for t in self.tests)

    @property
    def is_of_problem(self) -> bool:
        """True if the problem alone is measured, so that no setting of a solver matters."""
        return all(t.measure.of_problem for t in self.tests)


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
    """Parse the TOML text of a register; raise FileError if it is invalid. ``where`` names the text in messages."""
    file = convert_shape(parse_toml(text, where), _File, where)
    maps: dict[str, Map] = {}
    for name, row in file.maps.items():
        maps[name] = _read_map(name, row, maps, f"{where}: maps.{name}")
    claims: dict[str, Claim] = {}
    for k, row in enumerate(file.claims):
        at = f"{where}: claim {row['id']!r}" if isinstance(row.get("id"), str) else f"{where}: claim {k + 1}"
        tests = row.get("tests", [])
        if isinstance(tests, list):
            tests = [_read_test(t, f"{at}: test {j + 1}") if isinstance(t, dict) else t for j, t in enumerate(tests)]
        named = {key: _look_up(row[key], maps, "map", f"{at}: {key}") for key in MAPS if key in row}
        claim = convert_shape({**row, "tests": tests, **named}, Claim, at)
        if claim.id in claims:
            raise FileError(f"{at}: the id is taken")
        claims[claim.id] = claim
    return Register(tuple(claims.values()), maps, file.solvers)


def _read_test(row: dict[str, Any], at: str) -> Test:
    """Return the test that a table of a claim, ``row``, declares; raise FileError if it is invalid.

    The keys that its metric takes are its arguments. ``at`` names the place of the test in messages.
    """
    for key, known in CHOICES.items():
        if key in row:
            _look_up(row[key], known, key, at)
    takes = MEASURES[row["metric"]].takes if "metric" in row else ()
    rest = {k: v for k, v in row.items() if k not in takes}
    return convert_shape({**rest, "arguments": {k: v for k, v in row.items() if k in takes}}, Test, at)


def _read_map(name: str, row: dict[str, Any], maps: Mapping[str, Map], at: str) -> Map:
    """Return the map that a table of the register, ``row``, declares; raise FileError if it is invalid.

    A selection with the key ``map`` stands for those of another map in ``maps``, with the other keys of the selection
    replaced in them. ``at`` names the place of the map in messages.
    """
    printed, over = row.get("printed", []), row.get("over")
    if isinstance(over, list):
        selections = []
        for k, given in enumerate(map(_split_keys, over)):
            if isinstance(given, dict) and "map" in given:
                base = _look_up(given.pop("map"), maps, "map", f"{at}: selection {k + 1}").over
                selections += [{**s, **given} for s in base]
            else:
                selections.append(given)
        over = selections
    printed = [_split_keys(p) for p in ([printed] if isinstance(printed, dict) else printed)]
    found = convert_shape({**row, "name": name, "over": over, "printed": printed}, Map, at)
    for k, selection in enumerate(found.over):
        convert_shape(selection, Selection, f"{at}: selection {k + 1}")
        for key, value in selection.items():
            if isinstance(value, dict):
                convert_shape(value, Range, f"{at}: selection {k + 1}: {key}")
    return found


def _split_keys(given: Any) -> Any:
    """Return a selection with keys of several names expanded: ``{ "a, b" = 1 }`` becomes ``{ a = 1, b = 1 }``.

    Anything but a table is returned unchanged.
    """
    return {n.strip(): v for k, v in given.items() for n in k.split(",")} if isinstance(given, dict) else given


def _look_up(name: Any, known: Mapping[str, Any], what: str, at: str) -> Any:
    """Return the value of ``name`` in ``known``; raise FileError, which suggests a similar name, if it has none.

    ``what`` is the kind of thing, such as ``map``, and ``at`` the place of the name, both for the message.
    """
    if name not in known:
        raise FileError(f"{at}: unknown {what} {name!r}{suggest_name(str(name), list(known))}")
    return known[name]
