"""What is specific to a problem: its facts, observables and invariants, and the events that solvers reported."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from .motion import Motion
from .results import Run, Variant
from .words import NONE, number, plural, time, unit

MOST_EVENTS = 20  # of one run in the table


@dataclass(frozen=True)
class Extra:
    """A table of what only this problem has, runs by names."""

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[Run, tuple[tuple[float, str], ...]], ...]


@dataclass(frozen=True)
class Events:
    """What solvers reported during a run, e.g. singular passages: a row each, columns as the solvers named them."""

    heads: tuple[str, ...]
    rows: tuple[tuple[Run, tuple[str, ...]], ...]
    left_out: int


def extras(runs: Sequence[Run]) -> list[Extra]:
    """Observables against the reference, invariants against their start; only tables that have a column."""
    tables = {"Largest distance of observables from the reference": [c.observable_errors for c in runs],
              "Largest departure of invariants from their start": [c.invariant_drifts for c in runs]}  # fmt: skip
    return [_extra(title, runs, found) for title, found in tables.items() if any(found)]


def facts_of(variant: Variant, bodies: int) -> tuple[str, ...]:
    """The facts about the problem at the head of its page."""
    records = [c.record for c in variant.runs]
    out = [variant.section] if variant.section else []
    times = sorted({r.t_end_s for r in records if not math.isnan(r.t_end_s)})
    if times:
        out.append(f"{', '.join(time(t) for t in times)} s simulated")
    if bodies:
        out.append(plural(bodies, "body", "bodies"))
    scale = next((r for r in records if r.energy_scale_J > 0.0), None)
    if scale:
        out.append(f"energy scale {number(scale.energy_scale_J)} J, size {number(scale.length_scale_m)} m")
    known = next((r for r in records if r.reference), None)
    if known is None:
        return (*out, "no exact solution: only energy and constraints are checked")
    until = f" up to {time(known.reference_horizon_s)} s" if math.isfinite(known.reference_horizon_s) else ""
    return (*out, f"reference: {known.reference}, certified to {number(known.reference_own_error_m)} m{until}")


def _extra(title: str, runs: Sequence[Run], found: Sequence[Mapping[str, Mapping[str, Any]]]) -> Extra:
    units = {n: str(e.get("unit", "")) for of in found for n, e in of.items()}
    rows = tuple((c, tuple(_value(of.get(n)) for n in units)) for c, of in zip(runs, found, strict=True))
    return Extra(title, tuple(f"{n} [{unit(u)}]" if u else n for n, u in units.items()), rows)


def _value(found: Mapping[str, Any] | None) -> tuple[float, str]:
    try:
        value = float(found["max"]) if found else math.nan
    except (KeyError, TypeError, ValueError):
        value = math.nan
    return value, number(value) if found else NONE


def events(motions: Sequence[Motion]) -> Events | None:
    """One table of all events of these motions; None when there is none."""
    heads = list(dict.fromkeys(k for m in motions for e in m.events for k in e))
    if not heads:
        return None
    rows = [(m.run, tuple(_said(e.get(k)) for k in heads)) for m in motions for e in m.events[:MOST_EVENTS]]
    left_out = sum(max(len(m.events) - MOST_EVENTS, 0) for m in motions)
    return Events(tuple(h.replace("_", " ") for h in heads), tuple(rows), left_out)


def _said(value: Any) -> str:
    if isinstance(value, float):
        return number(value)
    return NONE if value is None else str(value)
