"""The claims register ``results/claims.toml``: read, checked, and refused in one line with the place.

What the keys mean and how to write one: ``docs/claims.md``.
"""

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...catalogue.options import nearest
from .evidence import MEASURES
from .predicates import COMBINE, COMPARE, NEAREST, Band

REGISTER = Path(__file__).resolve().parents[3] / "results" / "claims.toml"
LONGEST_QUOTE = 140  # a line of the paper, not a paragraph
QUANTIFIERS = ("all", "some")
RESULT, PRESENTATION = KINDS = (
    "result",
    "presentation",
)  # a finding about solvers; a check that we pose what the paper does
CLAIM_KEYS = (
    "id", "section", "figure", "quote", "claim", "map", "against", "pair_by", "across", "quantifier", "tests",
    "needs", "caveats", "kind", "starting",
)  # fmt: skip
TEST_KEYS = ("metric", "unit", "at_least", "at_most", "combine", "compare")
MAP_KEYS = ("over", "dimensions", "printed")
NEEDS = ("solver", "observable", "given")


class ClaimsError(ValueError):
    """A register that cannot be judged by; the message is one line with the place."""


@dataclass(frozen=True)
class Test:
    """One measured number and the band it must lie in."""

    metric: str
    arguments: Mapping[str, Any]
    band: Band
    unit: str
    combine: str = ""  # how the values along ``across`` become one
    compare: str = ""  # how the value is set against those of the map ``against``


@dataclass(frozen=True)
class Map:
    """The runs a claim is tried on: a union of selections, the values each dimension must have, the printed ones."""

    name: str
    over: tuple[Mapping[str, Any], ...]
    dimensions: Mapping[str, int] = field(default_factory=dict)
    printed: tuple[Mapping[str, Any], ...] = ()


@dataclass(frozen=True)
class Claim:
    """One claim of the paper as data."""

    id: str
    section: str
    figures: tuple[int, ...]
    quote: str
    claim: str
    tests: tuple[Test, ...]
    map: Map | None
    against: Map | None = None
    pair_by: tuple[str, ...] = ()
    across: str = ""
    quantifier: str = "all"
    needs: tuple[Mapping[str, str], ...] = ()
    caveats: tuple[str, ...] = ()
    kind: str = RESULT
    starting: bool = False  # about starting: a run that took no step counts


@dataclass(frozen=True)
class Register:
    """All claims, and what each solver may be taken for."""

    claims: tuple[Claim, ...]
    maps: Mapping[str, Map]
    solvers: Mapping[str, str]


def read_register(path: Path = REGISTER) -> Register:
    """The register in ``path``, or ClaimsError."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ClaimsError(f"cannot read claims {path}: {getattr(error, 'strerror', None) or error}") from None
    return parse_register(text, str(path))


def parse_register(text: str, where: str = "claims") -> Register:
    """The register in ``text``; ``where`` names it in messages."""
    try:
        plain = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ClaimsError(f"{where}: {error}") from None
    _known(plain, ("solvers", "maps", "claims"), where)
    solvers = _table(plain.get("solvers", {}), f"{where}: solvers")
    for name, words in solvers.items():
        _text(words, f"{where}: solvers.{name}")
    given = _table(plain.get("maps", {}), f"{where}: maps")
    maps = {name: _map(name, m, f"{where}: maps.{name}") for name, m in given.items()}
    rows = plain.get("claims", [])
    if not isinstance(rows, list) or not rows:
        raise ClaimsError(f"{where}: at least one [[claims]] is needed")
    claims: list[Claim] = []
    for k, row in enumerate(rows):
        at = f"{where}: claim {k + 1}"
        if isinstance(row, dict) and isinstance(row.get("id"), str) and row["id"]:
            at = f"{where}: claim {row['id']!r}"
        claim = _claim(row, maps, at)
        if any(c.id == claim.id for c in claims):
            raise ClaimsError(f"{at}: the id is taken")
        claims.append(claim)
    return Register(tuple(claims), maps, solvers)


def _claim(row: Any, maps: Mapping[str, Map], at: str) -> Claim:
    _known(_table(row, at), CLAIM_KEYS, at)
    texts = {k: _text(row.get(k), f"{at}: {k}") for k in ("id", "section", "quote", "claim")}
    if len(texts["quote"]) > LONGEST_QUOTE:
        raise ClaimsError(f"{at}: quote has {len(texts['quote'])} characters, a line has {LONGEST_QUOTE}")
    figures = row.get("figure", [])
    if not isinstance(figures, list) or not all(isinstance(n, int) and 1 <= n <= 12 for n in figures):
        raise ClaimsError(f"{at}: figure must be a list of numbers from 1 to 12 (got {figures!r})")
    needs = _needs(row.get("needs", []), at)
    tests = tuple(_test(t, f"{at}: test {k + 1}") for k, t in enumerate(_list(row.get("tests", []), f"{at}: tests")))
    named = {k: _named_map(row[k], maps, f"{at}: {k}") for k in ("map", "against") if k in row}
    if not needs and not (tests and "map" in named):
        raise ClaimsError(f"{at}: a map and a test are needed, or needs, which says what is missing")
    quantifier = row.get("quantifier", "all")
    if quantifier not in QUANTIFIERS:
        raise ClaimsError(f"{at}: quantifier must be all or some (got {quantifier!r})")
    kind, starting = row.get("kind", RESULT), row.get("starting", False)
    if kind not in KINDS:
        raise ClaimsError(f"{at}: kind must be {' or '.join(KINDS)} (got {kind!r})")
    if not isinstance(starting, bool):
        raise ClaimsError(f"{at}: starting must be true or false (got {starting!r})")
    across = row.get("across", "")
    if len({t.combine == NEAREST for t in tests}) > 1:
        raise ClaimsError(f"{at}: combine = {NEAREST!r} goes with all tests or none: one and the same run meets them")
    for k, t in enumerate(tests):
        if bool(t.combine) != bool(across):
            raise ClaimsError(f"{at}: test {k + 1}: combine goes with across, and across with combine")
        if bool(t.compare) != ("against" in named):
            raise ClaimsError(f"{at}: test {k + 1}: compare goes with against, and against with compare")
    return Claim(
        **{k: texts[k] for k in ("id", "section", "quote", "claim")},
        figures=tuple(figures),
        tests=tests,
        map=named.get("map"),
        against=named.get("against"),
        pair_by=tuple(_list(row.get("pair_by", []), f"{at}: pair_by")),
        across=across,
        quantifier=quantifier,
        needs=needs,
        caveats=tuple(_text(c, f"{at}: caveats") for c in _list(row.get("caveats", []), f"{at}: caveats")),
        kind=kind,
        starting=starting,
    )


def _test(row: Any, at: str) -> Test:
    given = dict(_table(row, at))
    name = given.get("metric")
    if name not in MEASURES:
        raise ClaimsError(f"{at}: unknown metric {name!r}{nearest(str(name), list(MEASURES))}")
    _known(given, (*TEST_KEYS, *MEASURES[name].takes), at)
    for k in MEASURES[name].wants:
        if k not in given:
            raise ClaimsError(f"{at}: metric {name} needs {k}")
    low, high = given.get("at_least", -math.inf), given.get("at_most", math.inf)
    for k, v in (("at_least", low), ("at_most", high)):
        if isinstance(v, bool) or not isinstance(v, int | float) or math.isnan(v):
            raise ClaimsError(f"{at}: {k} must be a number (got {v!r})")
    if math.isinf(low) and math.isinf(high):
        raise ClaimsError(f"{at}: a band is needed: at_least, at_most or both")
    if low > high:
        raise ClaimsError(f"{at}: the band is empty: at_least {low:g} is above at_most {high:g}")
    for key, known in (("combine", (*COMBINE, NEAREST)), ("compare", COMPARE)):
        if key in given and given[key] not in known:
            raise ClaimsError(f"{at}: {key} must be one of {', '.join(known)} (got {given[key]!r})")
    if not isinstance(given.get("unit"), str):
        raise ClaimsError(f"{at}: unit must be text, empty for a pure number (got {given.get('unit')!r})")
    arguments = {k: v for k, v in given.items() if k in MEASURES[name].takes}
    band = Band(float(low), float(high))
    return Test(name, arguments, band, given["unit"], given.get("combine", ""), given.get("compare", ""))


def _map(name: str, row: Any, at: str) -> Map:
    _known(_table(row, at), MAP_KEYS, at)
    over = _list(row.get("over", []), f"{at}: over")
    if not over:
        raise ClaimsError(f"{at}: over needs at least one selection")
    for k, selection in enumerate(over):
        _table(selection, f"{at}: selection {k + 1}")
        for key in ("problem", "solver"):
            if not isinstance(selection.get(key), str | list):
                raise ClaimsError(f"{at}: selection {k + 1}: {key} must be a name or a list of names")
    dimensions = _table(row.get("dimensions", {}), f"{at}: dimensions")
    if not all(isinstance(n, int) and n > 0 for n in dimensions.values()):
        raise ClaimsError(f"{at}: dimensions must be whole numbers > 0, how many values each has")
    given = row.get("printed", [])
    printed = [_table(p, f"{at}: printed") for p in (given if isinstance(given, list) else [given])]
    return Map(name, tuple(over), dimensions, tuple(printed))


def _named_map(name: Any, maps: Mapping[str, Map], at: str) -> Map:
    if name not in maps:
        raise ClaimsError(f"{at}: unknown map {name!r}{nearest(str(name), list(maps))}")
    return maps[name]


def _needs(given: Any, at: str) -> tuple[Mapping[str, str], ...]:
    for k, need in enumerate(_list(given, f"{at}: needs")):
        _known(_table(need, f"{at}: needs {k + 1}"), (*NEEDS, "why"), f"{at}: needs {k + 1}")
        if sum(key in need for key in NEEDS) != 1 or "why" not in need:
            raise ClaimsError(f"{at}: needs {k + 1}: give one of {', '.join(NEEDS)}, and why")
    return tuple(given)


def _known(given: Mapping[str, Any], known: tuple[str, ...], at: str) -> None:
    for key in given:
        if key not in known:
            raise ClaimsError(f"{at}: unknown key {key!r}{nearest(key, list(known))}")


def _table(given: Any, at: str) -> Mapping[str, Any]:
    if not isinstance(given, dict):
        raise ClaimsError(f"{at}: expected a table (got {given!r})")
    return given


def _list(given: Any, at: str) -> list[Any]:
    if not isinstance(given, list):
        raise ClaimsError(f"{at}: expected a list (got {given!r})")
    return given


def _text(given: Any, at: str) -> str:
    if not isinstance(given, str) or not given.strip():
        raise ClaimsError(f"{at}: expected text (got {given!r})")
    return given
