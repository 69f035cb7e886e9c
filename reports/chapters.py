"""A problem's chapter of the page: its facts, findings, figures and tables."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from reports.drawing import Written, write
from reports.figures.plan import chapters
from reports.findings import Finding, findings_of
from reports.motion import Motion
from reports.palette import Look
from reports.reading import Cell, Posing
from reports.words import NONE, number, plural, time, unit

MOST_EVENTS = 60  # of one cell in the table


@dataclass(frozen=True)
class Set:
    """Figures under one heading."""

    title: str
    figures: tuple[Written, ...]


@dataclass(frozen=True)
class Extra:
    """A table of what only this problem has, cells by names."""

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[Cell, tuple[tuple[float, str], ...]], ...]


@dataclass(frozen=True)
class Events:
    """What solvers reported on their way, e.g. singular passages: a row each, columns as the solvers named them."""

    heads: tuple[str, ...]
    rows: tuple[tuple[Cell, tuple[str, ...]], ...]
    left_out: int


@dataclass(frozen=True)
class Chapter:
    """All of one problem."""

    posing: Posing
    facts: tuple[str, ...]
    findings: tuple[Finding, ...]
    sets: tuple[Set, ...]
    extras: tuple[Extra, ...]
    events: Events | None


def chapter(
    posing: Posing, motions: Mapping[str, Motion], looks: Mapping[str, Look], *, brief: bool = False
) -> Chapter:
    """Computed from its cells and their curves; with fewer figures if ``brief``."""
    sets = [Set(c.title, tuple(write(d) for d in c.figures)) for c in chapters(posing, motions, looks, brief=brief)]
    extras = [
        _extra("Largest distance of observables from the reference", posing.cells, lambda c: c.observable_errors),
        _extra("Largest departure of invariants from their start", posing.cells, lambda c: c.invariant_drifts),
    ]
    return Chapter(
        posing,
        _facts(posing, motions),
        tuple(findings_of(posing)),
        tuple(sets),
        tuple(e for e in extras if e.heads),
        _events([motions[c.record.cell] for c in posing.cells]),
    )


def _facts(posing: Posing, motions: Mapping[str, Motion]) -> tuple[str, ...]:
    records = [c.record for c in posing.cells]
    out = [posing.section] if posing.section else []
    times = sorted({r.t_end_s for r in records if not math.isnan(r.t_end_s)})
    if times:
        out.append(f"{', '.join(time(t) for t in times)} s simulated")
    bodies = max((motions[c.record.cell].bodies for c in posing.cells), default=0)
    if bodies:
        out.append(plural(bodies, "body", "bodies"))
    scale = next((r for r in records if r.energy_scale_J > 0.0), None)
    if scale:
        out.append(f"energy to exchange {number(scale.energy_scale_J)} J, size {number(scale.length_scale_m)} m")
    known = next((r for r in records if r.reference), None)
    if known:
        out.append(
            f"reference: {known.reference}, certified to {number(known.reference_own_error_m)} m"
            + (f" up to {time(known.reference_horizon_s)} s" if math.isfinite(known.reference_horizon_s) else "")
        )
    else:
        out.append("no reference: errors are not known, laws are")
    return tuple(out)


def _extra(title: str, cells: Sequence[Cell], of) -> Extra:  # type: ignore[no-untyped-def]
    units = {n: str(e.get("unit", "")) for c in cells for n, e in of(c).items()}
    rows = tuple((c, tuple(_value(of(c).get(n)) for n in units)) for c in cells)
    return Extra(title, tuple(f"{n} [{unit(u)}]" if u else n for n, u in units.items()), rows)


def _value(found: Mapping | None) -> tuple[float, str]:
    try:
        value = float(found["max"]) if found else math.nan
    except (KeyError, TypeError, ValueError):
        value = math.nan
    return value, number(value) if found else NONE


def _events(motions: Sequence[Motion]) -> Events | None:
    heads = list(dict.fromkeys(k for m in motions for e in m.events for k in e))
    if not heads:
        return None
    rows = [(m.cell, tuple(_said(e.get(k)) for k in heads)) for m in motions for e in m.events[:MOST_EVENTS]]
    left_out = sum(max(len(m.events) - MOST_EVENTS, 0) for m in motions)
    return Events(tuple(h.replace("_", " ") for h in heads), tuple(rows), left_out)


def _said(value: Any) -> str:
    if isinstance(value, float):
        return number(value)
    return NONE if value is None else str(value)
