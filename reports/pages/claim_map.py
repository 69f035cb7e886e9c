"""The map of a claim: tolerance across, Baumgarte's gain down, a grid for each form, chart, error test and start."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ...harness.results.judgements import MapRow, Value
from ..model.claim_words import setting
from ..model.results import grouped
from ..model.words import Mark, mark, number
from .judgement import Links

AXES = ("tolerance", "gain")  # other dimensions make facets
MOST = 6  # boxes in one place
HOLDS = Mark("✓", "holds", "good")
NOT = Mark("✗", "does not hold", "wrong")
FAILED = Mark("★", "the run stopped", "failed")
UNKNOWN = Mark("?", "not judged", "refused")


@dataclass(frozen=True)
class Box:
    """One setting; several runs may share a place (other frames, other cases)."""

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


def grids(rows: Sequence[MapRow], links: Links) -> tuple[Grid, ...]:
    """One a facet, all with the same tolerances and gains, so that places can be compared."""
    tolerances, gains = (_values([m.at.get(key) for m in rows], falling=key == "tolerance") for key in AXES)
    facets = tuple(dict.fromkeys(k for m in rows for k in m.at if k not in AXES))
    found = grouped(rows, lambda m: tuple(setting(f, m.at[f]) if f in m.at else "" for f in facets))
    varies = [k for k in range(len(facets)) if len({key[k] for key in found}) > 1]
    out = []
    for key, own in found.items():
        title = ", ".join(key[k] for k in varies if key[k]) or ", ".join(filter(None, key)) or "all settings"
        boxes = tuple(
            tuple(_place([m for m in own if (_text(m.at.get("gain")), _text(m.at.get("tolerance"))) == (g, t)], links)
                  for t in tolerances) for g in gains
        )  # fmt: skip
        out.append(Grid(title, tolerances, gains, boxes))
    return tuple(sorted(out, key=lambda g: g.title))


def state(m: MapRow) -> Mark:
    """Whether the claim holds there; a run that stopped and was not judged is a failure."""
    stopped = mark(m.status).kind == "failed"
    if m.holds is None:
        return FAILED if stopped else UNKNOWN
    return HOLDS if m.holds else FAILED if stopped else NOT


def _place(rows: Sequence[MapRow], links: Links) -> tuple[Box, ...]:
    """A box a run; one box for all of a place that many share."""
    if len(rows) <= MOST:
        return tuple(_box(m, links) for m in rows)
    holds = sum(m.holds is True for m in rows)
    kind = HOLDS.kind if holds == len(rows) else NOT.kind if holds == 0 else FAILED.kind
    stopped = sum(state(m) is FAILED for m in rows)
    words = f"{holds} of {len(rows)} runs hold, {stopped} do not and stopped; first {_box(rows[0], links).words}"
    page = links.page(rows[0].settings_id)
    return (Box(Mark(f"{holds}/{len(rows)}", "", kind), words, page, any(m.printed for m in rows)),)


def _box(m: MapRow, links: Links) -> Box:
    here, run = state(m), links.runs.get(m.settings_id)
    measured = "" if math.isnan(m.measured) else f", measured {number(m.measured)}"
    printed = ", as the paper prints it" if m.printed else ""
    name = f"{run.variant} {run.record.solver}" if run else m.case  # its page, place and facet have the settings
    words = f"{name} – {here.word}{measured}, ended {mark(m.status).word}{printed}"
    return Box(here, words, links.page(m.settings_id), m.printed)


def _values(given: Sequence[Value], *, falling: bool) -> tuple[str, ...]:
    """All values of an axis; numbers in their order, texts (``1/h``) and none after them."""

    def key(v: Value) -> tuple[bool, float, str]:
        size = float(v) if isinstance(v, int | float) else math.nan
        return (True, 0.0, _text(v)) if math.isnan(size) else (False, -size if falling else size, "")

    return tuple(dict.fromkeys(_text(v) for v in sorted(given, key=key)))


def _text(value: Value) -> str:
    return "none" if value is None else value if isinstance(value, str) else f"{value:g}"
