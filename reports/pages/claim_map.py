"""The map of a claim: tolerance across, Baumgarte's gain down, a grid for each form, chart, error test and start."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ..model.words import Mark, mark, number
from .judgement import Entry
from .links import Links

PLACES = ("run", "case", "tolerance", "gain", "holds", "measured", "status", "printed")  # all else makes facets
SAID = {
    "lambda_in_error_test": ("λ in the error test", "λ outside the error test"),
    "consistent_start": ("consistent start", "start not made consistent"),
}
MOST = 6  # boxes in one place
HOLDS = Mark("✓", "holds", "good")
NOT = Mark("✗", "does not hold", "wrong")
FAILED = Mark("★", "the run stopped", "failed")
UNKNOWN = Mark("?", "not judged", "refused")


@dataclass(frozen=True)
class Box:
    """One tried setting; several runs may share a place (other frames, other cases)."""

    mark: Mark
    words: str  # all of it, for hover, focus and screen readers
    page: str
    printed: bool  # the settings that the paper prints


@dataclass(frozen=True)
class Grid:
    """One facet."""

    title: str
    tolerances: tuple[str, ...]
    gains: tuple[str, ...]
    rows: tuple[tuple[tuple[Box, ...], ...], ...]  # by gain, by tolerance


def grids(rows: Sequence[Entry], links: Links) -> tuple[Grid, ...]:
    """One a facet, all with the same tolerances and gains, so that places can be compared."""
    tolerances, gains = (_values(rows, key) for key in ("tolerance", "gain"))
    facets = tuple(dict.fromkeys(k for e in rows for k in e.given if k not in PLACES))
    found: dict[tuple[str, ...], list[Entry]] = {}
    for e in rows:
        found.setdefault(tuple(_said(e, f) for f in facets), []).append(e)
    varies = [k for k in range(len(facets)) if len({key[k] for key in found}) > 1]
    out = []
    for key, own in found.items():
        title = ", ".join(key[k] for k in varies if key[k]) or ", ".join(filter(None, key)) or "all settings"
        boxes = tuple(
            tuple(_place([e for e in own if (_value(e, "gain"), _value(e, "tolerance")) == (g, t)], links)
                  for t in tolerances) for g in gains
        )  # fmt: skip
        out.append(Grid(title, tolerances, gains, boxes))
    return tuple(sorted(out, key=lambda g: g.title))


def state(e: Entry) -> Mark:
    """Whether the claim holds there; a run that stopped and was not judged is a failure."""
    holds = e.flag("holds")
    stopped = bool(e.text("status")) and mark(e.text("status")).kind == "failed"
    if holds is None:
        return FAILED if stopped else UNKNOWN
    return HOLDS if holds else FAILED if stopped else NOT


def _place(rows: Sequence[Entry], links: Links) -> tuple[Box, ...]:
    """A box a run; one box for all of a place that many share."""
    if len(rows) <= MOST:
        return tuple(_box(e, links) for e in rows)
    held = sum(e.flag("holds") is True for e in rows)
    kind = HOLDS.kind if held == len(rows) else NOT.kind if held == 0 else FAILED.kind
    stopped = sum(state(e) is FAILED for e in rows)
    words = f"{held} of {len(rows)} runs hold, {stopped} do not and stopped; first {_box(rows[0], links).words}"
    mark_of = Mark(f"{held}/{len(rows)}", "", kind)
    return (Box(mark_of, words, links.page(rows[0].text("run")), any(e.flag("printed") is True for e in rows)),)


def _box(e: Entry, links: Links) -> Box:
    here = state(e)
    measured = e.number("measured")
    run = links.run(e.text("run"))  # its page has all settings; its place and its facet's title say those that vary
    words = [
        f"{run.variant} {run.record.solver}" if run else e.text("case") or links.words(e.text("run")),
        here.word,
    ]
    if not math.isnan(measured):
        words.append(f"measured {number(measured)}")
    if e.text("status"):
        words.append(f"ended {mark(e.text('status')).word}")
    if e.flag("printed"):
        words.append("as the paper prints it")
    return Box(here, f"{words[0]} – {', '.join(words[1:])}", links.page(e.text("run")), e.flag("printed") is True)


def _values(rows: Sequence[Entry], key: str) -> tuple[str, ...]:
    """All values of an axis; numbers in their order, texts (``1/h``) after them."""
    seen = {_value(e, key): e.number(key) for e in rows}
    return tuple(sorted(seen, key=lambda text: (math.isnan(seen[text]), -seen[text] if key == "tolerance" else
                                                seen[text], text)))  # fmt: skip


def _value(e: Entry, key: str) -> str:
    value = e.number(key)
    return e.text(key) or "none" if math.isnan(value) else f"{value:g}"


def _said(e: Entry, facet: str) -> str:
    flag = e.flag(facet)
    if flag is not None:
        yes, no = SAID.get(facet, (facet, f"not {facet}"))
        return yes if flag else no
    return e.text(facet)
