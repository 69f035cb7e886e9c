"""Every claim of the paper with its verdict, the number measured against its band, its settings and its map."""

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from markupsafe import Markup

from ..model.results import Results, natural, slug
from ..model.words import Mark, number, unit
from .base import Page, Site
from .claim_map import Grid, grids
from .judgement import JUDGE, PUBLISHED, Entry, judged, rows_of
from .links import Links, links_of
from .svg import number_line, said

VERDICTS: Mapping[str, Mark] = {
    "SUPPORTED": Mark("✓", "supported", "good"),
    "CONDITIONAL": Mark("◐", "conditional", "failed"),
    "REFUTED": Mark("✗", "refuted", "wrong"),
    "UNTESTABLE": Mark("?", "untestable", "refused"),
}
PRESENTATION = "presentation"
MOST_DIGITS = 1e6
LISTED = 40  # runs beside the map
ORDER = ("REFUTED", "CONDITIONAL", "SUPPORTED", "UNTESTABLE")


@dataclass(frozen=True)
class Asked:
    """One number asked for, in words."""

    metric: str
    band: str
    measured: str


@dataclass(frozen=True)
class Factor:
    """A dimension of the map: each value with how many settings hold, of how many."""

    name: str
    values: tuple[tuple[str, int, int], ...]


@dataclass(frozen=True)
class Claim:
    """One claim as the page shows it."""

    id: str
    anchor: str
    section: str
    figure: str
    quote: str
    claim: str
    verdict: Mark
    measured: str
    band: str
    line: Markup | None
    because: str
    missing: str
    tests: tuple[Asked, ...]  # all that is asked; the line shows the first
    factors: tuple[Factor, ...]
    settings: tuple[tuple[str, str], ...]
    total: int  # runs it was judged from
    runs: tuple[tuple[str, str], ...]  # those not on the map: words and address, empty for one this run does not hold
    solvers: tuple[str, ...]
    grids: tuple[Grid, ...]
    tried: str  # how many settings of the map hold
    presentation: bool  # no result: a check that the problem is posed as the paper poses it


@dataclass(frozen=True)
class Difference:
    """A claim that is judged otherwise than in the published results."""

    id: str
    anchor: str
    before: Mark | None
    after: Mark | None
    words: str


def claims_of(rows: Sequence[Entry], links: Links) -> tuple[Claim, ...]:
    """By section and figure, else in the order of the register."""
    ordered = sorted(rows, key=lambda e: (natural(e.text("section")), natural(e.text("figure"))))
    taken: set[str] = set()
    return tuple(_claim(e, links, slug(e.text("id"), taken)) for e in ordered)


def counts(claims: Iterable[Claim]) -> list[tuple[Mark, int]]:
    """How many of each verdict among the results, also those of which there is none."""
    found = Counter(c.verdict.word for c in claims if not c.presentation)
    known = [(VERDICTS[v], found.pop(VERDICTS[v].word, 0)) for v in ORDER]
    return known + [(verdict(word), n) for word, n in found.items()]


def verdict(text: str) -> Mark:
    """The mark of a verdict; one we do not know counts against us."""
    return VERDICTS.get(text.upper(), Mark("?", text.lower() or "no verdict", "failed"))


def differences(rows: Sequence[Entry], published: Sequence[Entry], claims: Sequence[Claim]) -> list[Difference]:
    """Against the published verdicts: changed ones first, then claims that came and went."""
    now, then = ({e.text("id"): e for e in found} for found in (rows, published))
    anchors = {c.id: c.anchor for c in claims}
    out = []
    for name, e in now.items():
        old = then.get(name)
        if old is None:
            out.append(Difference(name, anchors.get(name, ""), None, verdict(e.text("verdict")), "not published yet"))
        elif old.text("verdict") != e.text("verdict"):
            pair = verdict(old.text("verdict")), verdict(e.text("verdict"))
            words = f"{_measured(old)} before, {_measured(e)} now"
            out.append(Difference(name, anchors.get(name, ""), *pair, words))
    gone = [n for n in then if n not in now]
    out += [Difference(n, "", verdict(then[n].text("verdict")), None, "published, but not judged here") for n in gone]
    return sorted(out, key=lambda d: (d.before is None, d.after is None, natural(d.id)))


def band_of(e: Entry) -> tuple[float, float] | None:
    """The two ends, infinite where open; None where the band is no pair of numbers."""
    given = e.given.get("band")
    if isinstance(given, dict):
        inner = Entry(given)
        low, high = (inner.number(k) for k in ("low", "high"))
    elif isinstance(given, list) and len(given) == 2:
        low, high = e.numbers("band")
    else:
        return None
    low, high = (-math.inf if math.isnan(low) else low), (math.inf if math.isnan(high) else high)
    return None if math.isinf(low) and math.isinf(high) else (low, high)


def _claim(e: Entry, links: Links, anchor: str) -> Claim:
    mark, band, measured = verdict(e.text("verdict")), band_of(e), e.number("measured")
    measure_unit = unit(e.text("unit"))
    spread, missing = e.numbers("measured_range"), "; ".join(e.texts("missing"))
    line = None if band is None else number_line(measured, *band, measure_unit, mark.kind, spread)
    map_rows = e.entries("map")
    on_map = [m.text("run") for m in map_rows]
    keys = dict.fromkeys((*e.texts("runs"), *on_map))
    return Claim(
        e.text("id"),
        anchor,
        _numbered("Sect.", e.text("section")),
        _numbered("Fig.", e.text("figure")),
        e.text("quote"),
        e.text("claim"),
        mark,
        _measured(e),
        e.text("band") if band is None else said(math.nan, *band, measure_unit).split("; band ")[1],
        line,
        "" if e.text("because") and e.text("because") in missing else e.text("because"),
        missing,
        tuple(map(_asked, e.entries("tests"))),
        _factors(e),
        _settings(e),
        len(keys),
        _elsewhere(e.texts("runs"), set(on_map), links),
        tuple(sorted({s for k in keys if (s := links.solver(k))})),
        grids(map_rows, links),
        _tried(map_rows),
        e.text("kind") == PRESENTATION,
    )


def _tried(rows: Sequence[Entry]) -> str:
    """Of the settings that settle the claim; those left open beside it."""
    if not rows:
        return ""
    open_ = sum(m.flag("holds") is None for m in rows)
    said_open = f", {open_} left out" if open_ else ""
    return f"{sum(m.flag('holds') is True for m in rows)} of {len(rows) - open_} settings hold{said_open}"


def _elsewhere(keys: Sequence[str], on_map: set[str], links: Links) -> tuple[tuple[str, str], ...]:
    """Runs that are not on the map, a few of them; those that this run does not hold are counted."""
    rest = [k for k in keys if k not in on_map]
    here = [k for k in rest if links.run(k) is not None]
    out = [(links.words(k), links.page(k)) for k in here[:LISTED]]
    for n, words in ((len(here) - LISTED, "more in this run"), (len(rest) - len(here), "not in this run")):
        out += [(f"{n} {words}", "")] if n > 0 else []
    return tuple(out)


def _numbered(what: str, text: str) -> str:
    """``5.1`` as ``Sect. 5.1``; a text that says so already as it is."""
    return f"{what} {text}" if text[:1].isdigit() else text


def _measured(e: Entry) -> str:
    value = e.number("measured")
    if math.isnan(value):
        return unit(e.text("measured_words") or e.text("measured")) or "nothing"
    if not e.text("unit") and value.is_integer() and abs(value) < MOST_DIGITS:
        return f"{value:.0f}"  # a count
    return f"{number(value)} {unit(e.text('unit'))}".strip()


def _asked(e: Entry) -> Asked:
    """A column of the records is named by itself."""
    return Asked(re.sub(r"^column \[name ([^\],]+)\]", r"\1", e.text("metric")), e.text("band"), _measured(e))


def _factors(e: Entry) -> tuple[Factor, ...]:
    given = e.given.get("factors")
    out = []
    for name, values in given.items() if isinstance(given, dict) else ():
        pairs = [(str(k), v) for k, v in values.items()] if isinstance(values, dict) else []
        counted = tuple((k, v[0], v[1]) for k, v in pairs if isinstance(v, list) and len(v) == 2
                        and all(isinstance(n, int) for n in v))  # fmt: skip
        if counted:
            out.append(Factor(str(name).replace("_", " "), counted))
    return tuple(out)


def _settings(e: Entry) -> tuple[tuple[str, str], ...]:
    given = e.given.get("settings")
    if isinstance(given, dict):
        inner = Entry(given)
        return tuple((str(k).replace("_", " "), inner.text(k)) for k in given)
    return tuple(("", text) for text in e.texts("settings"))


def sections_of(claims: Sequence[Claim]) -> list[tuple[str, tuple[Claim, ...]]]:
    """Claims by section, in their order."""
    found: dict[str, list[Claim]] = {}
    for c in claims:
        found.setdefault(c.section, []).append(c)
    return [(k, tuple(v)) for k, v in found.items()]


def write(results: Results, site: Site) -> Page | None:
    """``claims.html``."""
    links, found = links_of(results.runs), judged(results.folder, "claims")
    published = rows_of(PUBLISHED / "claims.json", command=JUDGE)
    claims = claims_of(found.rows, links)
    page = Page("Claims", "claims.html", nav=True, order=20)
    return site.write(
        page, "claims.html", scripts=["assets/judgement.js"], why=found.why, claims=claims, counts=counts(claims),
        checks=[c for c in claims if c.presentation],
        sections=sections_of(claims), solvers=sorted({s for c in claims for s in c.solvers}),
        differences=differences(found.rows, published.rows, claims), published_why=published.why,
    )  # fmt: skip
