"""The claims register ``results/claims.toml``: read, checked, and refused in one line with the place.

What the keys mean and how to write one: ``docs/claims.md``.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from msgspec import Meta, field

from ...catalogue.options import nearest
from ...files import FileError, parse_toml, read_text
from ...shapes import LARGEST, Shape, Text, convert_shape
from .evidence import MEASURES
from .predicates import COMBINE, COMPARE, NEAREST, Band

REGISTER = Path(__file__).resolve().parents[3] / "results" / "claims.toml"
PRESENTATION = "presentation"  # a check that we present a problem as the paper does, no result about a solver
CHOICES = {"metric": tuple(MEASURES), "combine": (*COMBINE, NEAREST, ""), "compare": (*COMPARE, "")}
Names = str | tuple[str, ...]


class Test(Shape, frozen=True):
    """One measured number and the band it must lie in."""

    metric: str
    unit: str
    at_least: Annotated[float, Meta(ge=-LARGEST)] = -math.inf
    at_most: Annotated[float, Meta(le=LARGEST)] = math.inf
    combine: str = ""  # how the values along ``across`` become one
    compare: str = ""  # how the value is compared with those of the map ``against``
    arguments: dict[str, Any] = field(default_factory=dict)

    @property
    def band(self) -> Band:
        return Band(self.at_least, self.at_most)


class Map(Shape, frozen=True):
    """The runs a claim is tried on: a union of selections, the values each dimension must have, the printed ones."""

    name: str
    over: Annotated[tuple[dict[str, Any], ...], Meta(min_length=1)]
    dimensions: dict[str, Annotated[int, Meta(ge=1)]] = field(default_factory=dict)
    printed: tuple[dict[str, Any], ...] = ()


class Selection(Shape, frozen=True, forbid_unknown_fields=False):
    """Settings of runs; other keys are dimensions."""

    problem: Names
    solver: Names


class Range(Shape, frozen=True):
    """Values of a dimension between two numbers, both included."""

    begin: float = field(name="from")
    to: float


class Need(Shape, frozen=True):
    """A need, without which a claim cannot be tested: a solver, an observable, or what only the authors have."""

    why: Text
    solver: str = ""
    observable: str = ""  # ``problem.name``
    given: str = ""


class Claim(Shape, frozen=True):
    """One claim of the paper."""

    id: Text
    section: Text
    quote: Annotated[str, Meta(pattern=r"\S", max_length=400, description="a line of at most 400 characters")]
    claim: Text
    figure: tuple[Annotated[int, Meta(ge=1, le=12)], ...] = ()
    tests: tuple[Test, ...] = ()
    map: Map | None = None
    against: Map | None = None
    pair_by: tuple[str, ...] = ()
    at_equal_work: bool = False  # compared with the runs of no more operations alone
    must_act: bool = False  # runs of equal series are not compared: what they differ in acted on nothing
    across: str = ""
    along: Annotated[int, Meta(ge=2)] | tuple[float, ...] = 2  # the values that a group must have, or how many
    ranges: tuple[tuple[float, float], ...] = ()  # of ``across``, each a reading of its own: from the first to the last
    control: Map | None = None  # runs asked the same, each beside those of equal chart, tolerance and motion
    quantifier: Literal["all", "some"] = "all"
    needs: tuple[Need, ...] = ()
    caveats: tuple[Text, ...] = ()
    kind: Literal["result", "presentation"] = "result"
    starting: bool = False  # about starting: a run that took no step counts
    summary: bool = False  # on what the abstract or the conclusions say: shown first


@dataclass(frozen=True)
class Register:
    """All claims, and what each solver may be taken for."""

    claims: tuple[Claim, ...]
    maps: Mapping[str, Map]
    solvers: Mapping[str, str]


class _File(Shape, frozen=True):
    claims: Annotated[tuple[dict[str, Any], ...], Meta(min_length=1)]
    maps: dict[str, dict[str, Any]] = field(default_factory=dict)
    solvers: dict[str, Text] = field(default_factory=dict)


def read_register(path: Path = REGISTER) -> Register:
    """The register in ``path``, or FileError."""
    return parse_register(read_text(path, "claims"), str(path))


def parse_register(text: str, where: str = "claims") -> Register:
    """The register in ``text``; ``where`` names it in messages."""
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
    tests = row.get("tests", [])
    if isinstance(tests, list):
        tests = [_test(t, f"{at}: test {k + 1}") if isinstance(t, dict) else t for k, t in enumerate(tests)]
    named = {k: _find_map(row[k], maps, f"{at}: {k}") for k in ("map", "against", "control") if k in row}
    claim = convert_shape({**row, "tests": tests, **named}, Claim, at)
    for k, need in enumerate(claim.needs):
        if sum(map(bool, (need.solver, need.observable, need.given))) != 1:
            raise FileError(f"{at}: needs {k + 1}: give one of solver, observable, given, and why")
    if not claim.needs and not (claim.tests and claim.map):
        raise FileError(f"{at}: a map and a test are needed, or needs, which says what is missing")
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
    metric = row.get("metric", "")
    for key, known in CHOICES.items():
        if (given := row.get(key, known[-1])) not in known:
            raise FileError(f"{at}: unknown {key} {given!r}{nearest(str(given), [k for k in known if k])}")
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
    """A selection, or those of another map, narrowed or widened by the other keys."""
    own = _one_a_key(given)
    if not isinstance(own, dict) or "map" not in own:
        return [own]
    rest = {k: v for k, v in own.items() if k != "map"}
    return [{**s, **rest} for s in _find_map(own["map"], maps, at).over]


def _one_a_key(given: Any) -> Any:
    """``{ "a, b" = 1 }`` as ``{ a = 1, b = 1 }``."""
    return {n.strip(): v for k, v in given.items() for n in k.split(",")} if isinstance(given, dict) else given


def _find_map(name: Any, maps: Mapping[str, Map], at: str) -> Map:
    if name not in maps:
        raise FileError(f"{at}: unknown map {name!r}{nearest(str(name), list(maps))}")
    return maps[name]
