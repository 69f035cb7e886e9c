"""Show every claim of the paper and of the field with its verdicts, its value against its band, and its map."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from markupsafe import Markup

from ....harness.results.judgements.claims import ClaimGap, ClaimVerdict, JudgedClaim, MapRow, Value
from ....harness.results.judgements.files import CLAIMS, FIELD_CLAIMS, PUBLISHED, File
from ...model import claim_groups, claim_words
from ...model.claim_words import format_setting
from ...model.results import StoredResults, StoredRun, group_by, make_natural_key, make_slug
from ...model.words import Mark, mark_status, number, unit
from ..base import JUDGE, Page, Site, address_run, read_judged_or_published, read_or_explain
from ..svg import draw_number_line

AXES = ("tolerance", "gain")  # all other dimensions make facets
MOST = 6  # most boxes in one place
HOLDS = Mark("✓", "holds", "good")
NOT = Mark("✗", "does not hold", "wrong")
FAILED = Mark("★", "the run stopped", "failed")
UNKNOWN = Mark("?", "not judged", "refused")
VERDICTS: Mapping[ClaimVerdict, Mark] = {
    ClaimVerdict.NOT_REPRODUCED: Mark("✗", "not reproduced", "wrong"),
    ClaimVerdict.REPRODUCED_IF: Mark("◐", "reproduced if", "failed"),
    ClaimVerdict.REPRODUCED: Mark("✓", "reproduced", "good"),
    ClaimVerdict.CANNOT_BE_TOLD: Mark("?", "cannot be told", "refused"),
}
LISTED = 40  # most runs listed beside the map


def make_grids(rows: Sequence[MapRow], by_settings: Mapping[str, StoredRun]) -> list[dict[str, Any]]:
    """Return one grid of boxes per facet, all with the same tolerances and gains so that they can be compared.

    A facet has one value of every dimension of the map except tolerance and gain. A row of boxes has one gain; a
    tolerance has several boxes if runs differ in nothing else that the grid shows (other frames, other cases).
    ``by_settings`` holds the runs of these results by settings_id.
    """
    tolerances, gains = (_sort_values([m.at.get(key) for m in rows], falling=key == "tolerance") for key in AXES)
    facets = tuple(dict.fromkeys(k for m in rows for k in m.at if k not in AXES))
    found = group_by(rows, lambda m: tuple(format_setting(f, m.at[f]) if f in m.at else "" for f in facets))
    varies = [k for k in range(len(facets)) if len({key[k] for key in found}) > 1]
    out = []
    for key, own in found.items():
        title = ", ".join(key[k] for k in varies if key[k]) or ", ".join(filter(None, key)) or "all settings"
        places = group_by(own, lambda m: (_format_value(m.at.get("gain")), _format_value(m.at.get("tolerance"))))
        boxes = [[_make_boxes(places.get((g, t), ()), by_settings) for t in tolerances] for g in gains]
        out.append({"title": title, "tolerances": tolerances, "gains": gains, "rows": boxes})
    return sorted(out, key=lambda g: g["title"])


def mark_setting(m: MapRow) -> Mark:
    """Return the mark of a setting: holds, does not hold or not judged; unless it holds, a stopped run has its own."""
    stopped = mark_status(m.status).kind == "failed"
    if m.holds is None:
        return FAILED if stopped else UNKNOWN
    return HOLDS if m.holds else FAILED if stopped else NOT


def _make_boxes(rows: Sequence[MapRow], by_settings: Mapping[str, StoredRun]) -> list[dict[str, Any]]:
    """Return the boxes at one place of a grid: one per run, or a single one for more than ``MOST``.

    A box has its mark, words on it, the page of its run and whether the paper prints its setting.
    """
    out = []
    for m in rows:
        mark, run = mark_setting(m), by_settings.get(m.settings_id)
        measured = "" if math.isnan(m.measured) else f", measured {number(m.measured)}"
        printed = ", as the paper prints it" if m.printed else ""
        # the settings are on its page and in its place and facet
        name = f"{run.variant} {run.record.solver}" if run else m.case
        words = f"{name} – {mark.word}{measured}, ended {mark_status(m.status).word}{printed}"
        out.append({"mark": mark, "words": words, "page": address_run(run) if run else "", "printed": m.printed})
    if len(rows) <= MOST:
        return out
    holds, stopped = (sum(mark_setting(m) is kind for m in rows) for kind in (HOLDS, FAILED))
    kind = HOLDS.kind if holds == len(rows) else NOT.kind if holds == 0 else FAILED.kind
    words = f"{holds} of {len(rows)} runs hold, {stopped} do not and stopped; first {out[0]['words']}"
    return [
        out[0]
        | {"mark": Mark(f"{holds}/{len(rows)}", "", kind), "words": words, "printed": any(m.printed for m in rows)}
    ]


def _sort_values(given: Sequence[Value], *, falling: bool) -> tuple[str, ...]:
    """Return the distinct values of an axis as texts: numbers ``falling`` or rising, then texts (``1/h``) and None."""

    def key(v: Value) -> tuple[bool, float, str]:
        """Return the sort key that puts numbers in order before texts."""
        size = float(v) if isinstance(v, int | float) else math.nan
        return (True, 0.0, _format_value(v)) if math.isnan(size) else (False, -size if falling else size, "")

    return tuple(dict.fromkeys(_format_value(v) for v in sorted(given, key=key)))


def _format_value(value: Value) -> str:
    """Format the value of a dimension; "none" for None."""
    return "none" if value is None else claim_words.format_value("", value)


@dataclass(frozen=True)
class ClaimView:
    """A claim as the page shows it."""

    of: JudgedClaim
    anchor: str  # of its place on the page
    line: Markup | None  # its measured number against its band; None without a test
    runs: tuple[tuple[str, str], ...]  # runs not on the map: words and address, empty for one not in these results
    solvers: tuple[str, ...]  # those whose runs in these results it was tried on
    grids: list[dict[str, Any]]  # its map, see ``make_grids``
    published: bool = False  # the published verdict is shown, since these results lack its runs

    @property
    def mark(self) -> Mark:
        """The mark of the claim's verdict."""
        return VERDICTS[self.of.verdict]

    @property
    def group(self) -> str:
        """The group that lists the claim, one of ``claim_groups.GROUPS``."""
        return claim_groups.name_group(self.of)

    @property
    def section(self) -> str:
        """The heading under which the claim is listed: its group, or its section for what else the paper says."""
        if self.group != claim_groups.OTHERS:
            return self.group
        return f"Sect. {self.of.section}" if self.of.section[:1].isdigit() else self.of.section

    @property
    def shown(self) -> tuple[str, str]:
        """The setting whose numbers are shown, in words, and the command that repeats its run; empty without one."""
        return claim_groups.name_shown_setting(self.of), claim_groups.find_command(self.of)

    @property
    def sides(self) -> tuple[tuple[str, Mark, str], ...]:
        """The settings (printed or beyond), the verdict on them, and for how many of those tried the claim holds."""
        return tuple(
            (where, VERDICTS[f.verdict], claim_words.format_condition_and_share(f))
            for where, f in claim_words.list_sides(self.of)
        )

    @property
    def verdict(self) -> str:
        """The verdict in words, at the paper's settings if there are any."""
        findings = self.of.findings
        return claim_words.format_verdict(findings[0]) if findings else str(self.of.verdict)

    @property
    def presentation(self) -> bool:
        """True if the claim is no result about a solver but a check of the set-up."""
        return self.group == claim_groups.CHECKS


def select_claims(
    claims: Sequence[JudgedClaim], by_settings: Mapping[str, StoredRun], published: Sequence[JudgedClaim] = ()
) -> tuple[ClaimView, ...]:
    """Return the claims for the page, in the order of their groups.

    A claim that lacks runs in these results is shown with its verdict in ``published``, without map and runs.
    """
    taken: set[str] = set()
    kept = {c.id: c for c in published}
    instead = {c.id: kept[c.id] for c in claims if lacks_runs(c) and c.id in kept}
    ordered = claim_groups.order_claims(instead.get(c.id, c) for c in claims)
    shown = (_show_claim(c, by_settings, make_slug(c.id, taken)) for c in ordered)
    return tuple(replace(s, published=True, grids=[], runs=()) if s.of.id in instead else s for s in shown)


def lacks_runs(claim: JudgedClaim) -> bool:
    """Return whether settings of the claim were not run in the results that it was judged from."""
    return any(m.gap is ClaimGap.RUNS for m in claim.missing)


def count_judged(claims: Iterable[JudgedClaim]) -> int:
    """Count the claims with a verdict from runs; a claim that no run can test has none."""
    return sum(c.verdict is not ClaimVerdict.CANNOT_BE_TOLD for c in claims if not lacks_runs(c))


def describe_origins(claims: Sequence[JudgedClaim], published: int, whose: str = "") -> str:
    """Return a sentence on how many claims are judged from these runs, lack runs, or can be tested by no run.

    ``published`` is the number of those that lack runs and show a published verdict; ``whose`` follows "claims".
    """
    lacking = sum(map(lacks_runs, claims))
    here = count_judged(claims)
    known = f"{len(claims)} claims{f' {whose}' if whose else ''}"
    parts = [
        f"{here or 'None'} of {known} {'is' if here in (0, 1) else 'are'} judged from these runs",
        f"for {lacking} they lack runs: {published} of these show the published verdict, marked so",
        f"{len(claims) - lacking - here} can be tested by no run, for the reason given there",
    ]
    return "; ".join(parts) + "."


def count_verdicts(claims: Iterable[ClaimView]) -> list[tuple[Mark, int]]:
    """Count the claims of each verdict, without checks of the set-up; verdicts without a claim are kept."""
    found = Counter(c.of.verdict for c in claims if not c.presentation)
    return [(m, found[v]) for v, m in VERDICTS.items()]


def list_differences(
    claims: Sequence[JudgedClaim], published: Sequence[JudgedClaim], shown: Sequence[ClaimView]
) -> list[dict[str, Any]]:
    """Return the changes from the ``published`` claims: changed verdicts first, then removed and then added claims."""
    now, then = ({c.id: c for c in found} for found in (claims, published))
    anchors = {c.of.id: c.anchor for c in shown}
    out = []
    for name in now.keys() | then.keys():
        new, old = now.get(name), then.get(name)
        if new and old and new.verdicts == old.verdicts:
            continue
        words = (
            f"{old.verdicts}: {_format_first(old)} before; {new.verdicts}: {_format_first(new)} now"
            if new and old
            else ("not published yet" if new else "published, but not judged here")
        )
        before, after = (VERDICTS[c.verdict] if c else None for c in (old, new))
        out.append({"id": name, "anchor": anchors.get(name, ""), "before": before, "after": after, "words": words})
    return sorted(out, key=lambda d: (d["before"] is None, d["after"] is None, make_natural_key(d["id"])))


def _format_first(c: JudgedClaim) -> str:
    """Format the value that the first test of a claim measured."""
    return claim_words.format_measured(c.tests[0]) if c.tests else "nothing"


def _show_claim(c: JudgedClaim, by_settings: Mapping[str, StoredRun], anchor: str) -> ClaimView:
    """Return a claim as the page shows it; of the judged runs off its map ``LISTED`` are named, the others counted."""
    line = None
    if c.tests:
        first = c.tests[0]
        low, high = (v if v is not None else end for v, end in zip(first.band, (-math.inf, math.inf), strict=True))
        line = draw_number_line(first.measured, low, high, unit(first.unit), VERDICTS[c.verdict].kind, c.measured_range)
    rest = [k for k in c.settings_ids if k not in {m.settings_id for m in c.map}]
    found = [by_settings[k] for k in rest if k in by_settings]
    counted = (len(found) - LISTED, "more in these results"), (len(rest) - len(found), "not in these results")
    runs = [(run.record.case, address_run(run)) for run in found[:LISTED]]
    runs += [(f"{n} {words}", "") for n, words in counted if n > 0]
    solvers = sorted({by_settings[k].record.solver for k in c.settings_ids if k in by_settings})
    return ClaimView(c, anchor, line, tuple(runs), tuple(solvers), make_grids(c.map, by_settings))


@dataclass(frozen=True)
class RegisterView:
    """The claims of one register as the page shows them, with what is said of where their verdicts come from."""

    file: str  # name of the file of its verdicts
    claims: tuple[ClaimView, ...]
    why: str  # why there is no verdict at all
    kept: str  # why some or all verdicts are the published ones
    instead: bool  # True if all are the published ones
    differences: list[dict[str, Any]]  # from the published verdicts
    published_why: str  # why there are no published verdicts to compare with
    judged_here: int


def view_register(results: StoredResults, file: File[tuple[JudgedClaim, ...]], whose: str = "") -> RegisterView:
    """Return the claims of the register whose verdicts are in ``file``, judged from these results or as published.

    ``whose`` names the register in a sentence.
    """
    found = read_judged_or_published(results.folder, file)
    published = read_or_explain(PUBLISHED, file, f"{JUDGE} --publish")
    claims = select_claims(found.found or (), results.by_settings, published.found or ())
    if found.published:
        claims = tuple(replace(c, published=True, grids=[], runs=()) for c in claims)
    lacking = sum(c.published for c in claims)
    own = () if found.published else [c for c in found.found or () if not lacks_runs(c)]
    here = {c.id for c in own}
    kept = found.published or (describe_origins(found.found or (), lacking, whose) if lacking else "")
    before = [c for c in published.found or () if c.id in here or not lacking] if own else []
    different = list_differences(own, before, claims)
    why, instead = published.why if claims else "", bool(found.published)
    return RegisterView(file.name, claims, found.why, kept, instead, different, why, count_judged(own))


def write(results: StoredResults, site: Site) -> Page | None:
    """Add ``claims.html`` to the site and return the page."""
    paper, field = view_register(results, CLAIMS), view_register(results, FIELD_CLAIMS, "of textbooks and manuals")
    claims = sorted((*paper.claims, *field.claims), key=lambda c: claim_groups.GROUPS.index(c.group))
    page = Page("Claims", "claims.html", nav=bool(claims), order=20)
    return site.write(
        page,
        "claims.html",
        scripts=["assets/judgement.js"],
        registers=[paper, field],
        claims=claims,
        counts=count_verdicts(paper.claims),
        say=claim_words,
        split=claim_groups.split_claim,
        groups={k: group_by(own, lambda c: c.section) for k, own in group_by(claims, lambda c: c.group).items()},
        first=claim_groups.FIRST,
        others=claim_groups.OTHERS,
        sections=dict.fromkeys(c.section for c in claims),
        solvers=sorted({s for c in claims for s in c.solvers}),
    )
