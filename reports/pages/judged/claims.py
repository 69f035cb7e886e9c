"""Every claim of the paper with its two verdicts, the number measured against its band, its settings and its map."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from markupsafe import Markup

from ....harness.results.judgements.claims import Claim, Gap, MapRow, Value, Verdict
from ....harness.results.judgements.files import CLAIMS, PUBLISHED
from ...model import claim_words
from ...model.claim_words import setting
from ...model.results import Results, Run, group_by, natural, slug
from ...model.words import Mark, mark, number, unit
from ..base import JUDGE, Page, Site, page_of, read_judged_or_published, read_or_why
from ..svg import number_line

AXES = ("tolerance", "gain")  # other dimensions make facets
MOST = 6  # boxes in one place
HOLDS = Mark("✓", "holds", "good")
NOT = Mark("✗", "does not hold", "wrong")
FAILED = Mark("★", "the run stopped", "failed")
UNKNOWN = Mark("?", "not judged", "refused")
VERDICTS: Mapping[Verdict, Mark] = {
    Verdict.NOT_REPRODUCED: Mark("✗", "not reproduced", "wrong"),
    Verdict.REPRODUCED_IF: Mark("◐", "reproduced if", "failed"),
    Verdict.REPRODUCED: Mark("✓", "reproduced", "good"),
    Verdict.CANNOT_BE_TOLD: Mark("?", "cannot be told", "refused"),
}
LISTED = 40  # runs beside the map
SUMMARY = "What abstract and conclusions say"


def grids(rows: Sequence[MapRow], here: Mapping[str, Run]) -> list[dict[str, Any]]:
    """One a facet, all with the same tolerances and gains, so that places can be compared.

    A row of boxes a gain, several boxes a tolerance where runs share a place (other frames, other cases).
    """
    tolerances, gains = (_values([m.at.get(key) for m in rows], falling=key == "tolerance") for key in AXES)
    facets = tuple(dict.fromkeys(k for m in rows for k in m.at if k not in AXES))
    found = group_by(rows, lambda m: tuple(setting(f, m.at[f]) if f in m.at else "" for f in facets))
    varies = [k for k in range(len(facets)) if len({key[k] for key in found}) > 1]
    out = []
    for key, own in found.items():
        title = ", ".join(key[k] for k in varies if key[k]) or ", ".join(filter(None, key)) or "all settings"
        places = group_by(own, lambda m: (_text(m.at.get("gain")), _text(m.at.get("tolerance"))))
        boxes = [[_place(places.get((g, t), ()), here) for t in tolerances] for g in gains]
        out.append({"title": title, "tolerances": tolerances, "gains": gains, "rows": boxes})
    return sorted(out, key=lambda g: g["title"])


def state(m: MapRow) -> Mark:
    """Whether the claim holds there; a run that stopped and was not judged is a failure."""
    stopped = mark(m.status).kind == "failed"
    if m.holds is None:
        return FAILED if stopped else UNKNOWN
    return HOLDS if m.holds else FAILED if stopped else NOT


def _place(rows: Sequence[MapRow], here: Mapping[str, Run]) -> list[dict[str, Any]]:
    """A box a run; one box for all of a place that many share. ``words`` are for hover, focus and screen readers."""
    out = []
    for m in rows:
        mark_of_it, run = state(m), here.get(m.settings_id)
        measured = "" if math.isnan(m.measured) else f", measured {number(m.measured)}"
        printed = ", as the paper prints it" if m.printed else ""
        name = f"{run.variant} {run.record.solver}" if run else m.case  # its page, place and facet have the settings
        words = f"{name} – {mark_of_it.word}{measured}, ended {mark(m.status).word}{printed}"
        out.append({"mark": mark_of_it, "words": words, "page": page_of(run) if run else "", "printed": m.printed})
    if len(rows) <= MOST:
        return out
    holds, stopped = (sum(state(m) is kind for m in rows) for kind in (HOLDS, FAILED))
    kind = HOLDS.kind if holds == len(rows) else NOT.kind if holds == 0 else FAILED.kind
    words = f"{holds} of {len(rows)} runs hold, {stopped} do not and stopped; first {out[0]['words']}"
    return [out[0] | {"mark": Mark(f"{holds}/{len(rows)}", "", kind), "words": words,
                      "printed": any(m.printed for m in rows)}]  # fmt: skip


def _values(given: Sequence[Value], *, falling: bool) -> tuple[str, ...]:
    """All values of an axis; numbers in their order, texts (``1/h``) and none after them."""

    def key(v: Value) -> tuple[bool, float, str]:
        size = float(v) if isinstance(v, int | float) else math.nan
        return (True, 0.0, _text(v)) if math.isnan(size) else (False, -size if falling else size, "")

    return tuple(dict.fromkeys(_text(v) for v in sorted(given, key=key)))


def _text(value: Value) -> str:
    return "none" if value is None else value if isinstance(value, str) else f"{value:g}"


@dataclass(frozen=True)
class Shown:
    """One claim as the page shows it."""

    of: Claim
    anchor: str
    line: Markup | None
    runs: tuple[tuple[str, str], ...]  # those not on the map: words and address, empty for one that is not here
    solvers: tuple[str, ...]
    grids: list[dict[str, Any]]
    published: bool = False  # these results lack its runs: the published verdict

    @property
    def mark(self) -> Mark:
        return VERDICTS[self.of.verdict]

    @property
    def section(self) -> str:
        if self.of.summary:
            return SUMMARY
        return f"Sect. {self.of.section}" if self.of.section[:1].isdigit() else self.of.section

    @property
    def sides(self) -> tuple[tuple[str, Mark, str], ...]:
        """Where, the verdict there, and for which choices, and how many of those tried, the claim holds."""
        return tuple(
            (where, VERDICTS[f.verdict], claim_words.condition_and_share(f)) for where, f in claim_words.sides(self.of)
        )

    @property
    def verdict(self) -> str:
        """The verdict in words, at the paper's settings where it has such."""
        findings = self.of.findings
        return claim_words.verdict(findings[0]) if findings else str(self.of.verdict)

    @property
    def presentation(self) -> bool:
        """No result: a check that the problem is presented as in the paper."""
        return self.of.kind == "presentation"


def claims_of(claims: Sequence[Claim], here: Mapping[str, Run], published: Sequence[Claim] = ()) -> tuple[Shown, ...]:
    """Those on abstract and conclusions, then by section and figure, else in the order of the register.

    A claim that lacks runs here is shown as it was published.
    """
    taken: set[str] = set()
    kept = {c.id: c for c in published}
    instead = {c.id: kept[c.id] for c in claims if lacks_runs(c) and c.id in kept}
    ordered = sorted(
        (instead.get(c.id, c) for c in claims), key=lambda c: (not c.summary, natural(c.section), c.figure)
    )
    shown = (_show_claim(c, here, slug(c.id, taken)) for c in ordered)
    return tuple(replace(s, published=True, grids=[], runs=()) if s.of.id in instead else s for s in shown)


def lacks_runs(claim: Claim) -> bool:
    """Its settings were not run in the results that it was judged from."""
    return any(m.gap is Gap.RUNS for m in claim.missing)


def judged_here(claims: Iterable[Claim]) -> int:
    """How many have a verdict from runs; one that no run can test has none."""
    return sum(c.verdict is not Verdict.CANNOT_BE_TOLD for c in claims if not lacks_runs(c))


def origins(claims: Sequence[Claim], published: int) -> str:
    """Whose verdicts the page shows, counted so that the parts add up to all claims."""
    lacking = sum(map(lacks_runs, claims))
    here = judged_here(claims)
    parts = [f"{here or 'None'} of {len(claims)} claims {'is' if here in (0, 1) else 'are'} judged from these runs",
             f"for {lacking} they lack runs: {published} of these show the published verdict, marked so",
             f"{len(claims) - lacking - here} can be tested by no run, for the reason given there"]  # fmt: skip
    return "; ".join(parts) + "."


def counts(claims: Iterable[Shown]) -> list[tuple[Mark, int]]:
    """How many of each verdict among the results, the first of each claim, also those of which there is none."""
    found = Counter(c.of.verdict for c in claims if not c.presentation)
    return [(m, found[v]) for v, m in VERDICTS.items()]


def differences(claims: Sequence[Claim], published: Sequence[Claim], shown: Sequence[Shown]) -> list[dict[str, Any]]:
    """From the published verdicts: changed ones first, then claims that came and went."""
    now, then = ({c.id: c for c in found} for found in (claims, published))
    anchors = {c.of.id: c.anchor for c in shown}
    out = []
    for name in now.keys() | then.keys():
        new, old = now.get(name), then.get(name)
        if new and old and new.verdicts == old.verdicts:
            continue
        words = f"{old.verdicts}: {_first(old)} before; {new.verdicts}: {_first(new)} now" if new and old else (
            "not published yet" if new else "published, but not judged here")  # fmt: skip
        before, after = (VERDICTS[c.verdict] if c else None for c in (old, new))
        out.append({"id": name, "anchor": anchors.get(name, ""), "before": before, "after": after, "words": words})
    return sorted(out, key=lambda d: (d["before"] is None, d["after"] is None, natural(d["id"])))


def _first(c: Claim) -> str:
    return claim_words.format_measured(c.tests[0]) if c.tests else "nothing"


def _show_claim(c: Claim, here: Mapping[str, Run], anchor: str) -> Shown:
    """With the runs that are not on the map, a few of them; those that are not in these results are counted."""
    line = None
    if c.tests:
        first = c.tests[0]
        low, high = (v if v is not None else end for v, end in zip(first.band, (-math.inf, math.inf), strict=True))
        line = number_line(first.measured, low, high, unit(first.unit), VERDICTS[c.verdict].kind, c.measured_range)
    rest = [k for k in c.settings_ids if k not in {m.settings_id for m in c.map}]
    found = [here[k] for k in rest if k in here]
    counted = (len(found) - LISTED, "more in these results"), (len(rest) - len(found), "not in these results")
    runs = [(run.record.case, page_of(run)) for run in found[:LISTED]]
    runs += [(f"{n} {words}", "") for n, words in counted if n > 0]
    solvers = sorted({here[k].record.solver for k in c.settings_ids if k in here})
    return Shown(c, anchor, line, tuple(runs), tuple(solvers), grids(c.map, here))


def write(results: Results, site: Site) -> Page | None:
    """``claims.html``."""
    found = read_judged_or_published(results.folder, CLAIMS)
    published = read_or_why(PUBLISHED, CLAIMS, f"{JUDGE} --publish")
    claims = claims_of(found.found or (), results.by_settings, published.found or ())
    if found.published:
        claims = tuple(replace(c, published=True, grids=[], runs=()) for c in claims)
    lacking = sum(c.published for c in claims)
    own = () if found.published else [c for c in found.found or () if not lacks_runs(c)]
    here = {c.id for c in own}
    kept = found.published or (origins(found.found or (), lacking) if lacking else "")
    page = Page("Claims", "claims.html", nav=bool(claims), order=20)
    before = [c for c in published.found or () if c.id in here or not lacking] if own else []
    return site.write(
        page, "claims.html", scripts=["assets/judgement.js"], why=found.why, kept=kept, claims=claims,
        counts=counts(claims), checks=[c for c in claims if c.presentation], say=claim_words,
        sections=group_by(claims, lambda c: c.section), solvers=sorted({s for c in claims for s in c.solvers}),
        differences=differences(own, before, claims), published_why=published.why, judged_here=judged_here(own),
    )  # fmt: skip
