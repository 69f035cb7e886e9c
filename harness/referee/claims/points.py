"""The settings of a map as points: the numbers of each, and whether the claim holds there, fails, or is left open.

A setting is left open, and out of the count, where its runs settle nothing: a limit ended them (module endings), or
runs to be compared with each other have no numbers to compare.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ...results.judgements import Ending
from ..certificates.work import operations
from .endings import in_time, settled
from .evidence import MEASURES
from .maps import Place, is_printed
from .measured import Numbers
from .measures import reached_end
from .predicates import COMBINE, COMPARE, NEAREST, RATIOS
from .register import Claim, Test

LOOSEST_FIRST = ("tolerance", "step", "max_step")


@dataclass(frozen=True)
class Point:
    """One setting of the map: its runs (several where a claim looks across a dimension), the numbers, the finding."""

    places: tuple[Place, ...]
    numbers: tuple[float, ...]  # one a test
    holds: bool | None  # None: left open
    printed: bool
    left_out: Ending = Ending.FINAL  # why, where it is left open
    stopped: bool = False  # holds, and by a number that is endless because the run stopped
    met_at: tuple[Any, ...] = ()  # the values that meet the claim, where one along ``across`` suffices


def points(claim: Claim, own: Iterable[Place], others: Sequence[Place], numbers: Numbers) -> list[Point]:
    """In the order of the runs; groups with one value along ``across`` test nothing and are no settings."""
    groups: dict[str, list[Place]] = {}
    for p in own:
        rest = {k: str(v) for k, v in p.dimensions.items() if k != claim.across} if claim.across else p.spec.settings_id
        groups.setdefault(repr(rest), []).append(p)
    out = []
    for group in groups.values():
        partners = {p.spec.settings_id: _partners(claim, p, others, numbers) for p in group}
        if not claim.across:
            out.append(_point(claim, group, partners, numbers))
        elif len(group) > 1:
            ordered = sorted(group, key=lambda p: p.dimensions.get(claim.across) or 0.0)
            if claim.across in LOOSEST_FIRST:
                ordered.reverse()
            make = _nearest if claim.tests[0].combine == NEAREST else _point
            out.append(make(claim, ordered, partners, numbers))
    return out


def _point(claim: Claim, ordered: Sequence[Place], partners: Mapping[str, Sequence[Place]], numbers: Numbers) -> Point:
    found = tuple(_number(t, ordered, partners, numbers) for t in claim.tests)
    used = [*ordered, *(q for rows in partners.values() for q in rows)]
    each = [t.band.holds(v) if _settled(claim, t, v, used, numbers) else None
            for t, v in zip(claim.tests, found, strict=True)]  # fmt: skip
    holds = False if False in each else None if None in each else True
    printed = claim.map is not None and any(is_printed(p, claim.map.printed) for p in ordered)
    endless = any(map(math.isinf, found)) and not all(reached_end(numbers.records[p.spec.settings_id]) for p in ordered)
    endings = {_ending(claim, p, numbers) for p in used} - {Ending.FINAL}
    why = next((how for how in Ending if how in endings), Ending.UNCOMPARED) if holds is None else Ending.FINAL
    return Point(tuple(ordered), found, holds, printed, why, bool(holds and endless))


def _nearest(
    claim: Claim, ordered: Sequence[Place], partners: Mapping[str, Sequence[Place]], numbers: Numbers
) -> Point:
    """Of the values along ``across`` one that meets all tests, else the one that comes nearest."""
    each = [_point(claim, [p], partners, numbers) for p in ordered]

    def near(p: Point) -> tuple[float, int, float]:
        held = [t.band.holds(v) for t, v in zip(claim.tests, p.numbers, strict=True)]
        return {True: 2, None: 1, False: 0}[p.holds], sum(held), -claim.tests[0].band.beyond(p.numbers[0])

    best = max(each, key=near)
    places = (*best.places, *(p for p in ordered if p is not best.places[0]))
    met = tuple(p.dimensions[claim.across] for p, q in zip(ordered, each, strict=True) if q.holds)
    return replace(best, places=places, printed=any(p.printed for p in each), met_at=met)


def _settled(claim: Claim, test: Test, value: float, used: Sequence[Place], numbers: Numbers) -> bool:
    if (test.combine in RATIOS or claim.at_equal_work) and math.isnan(value):
        return False
    runs = [(numbers.records[p.spec.settings_id], _ending(claim, p, numbers)) for p in used]
    if len(runs) == 1:
        return settled(test, *runs[0], value)
    return all(in_time(test, record, how) for record, how in runs)


def _ending(claim: Claim, p: Place, numbers: Numbers) -> Ending:
    how = numbers.ending(p.spec.settings_id)
    return Ending.FINAL if claim.starting and how is Ending.NO_STEP else how


def _partners(claim: Claim, p: Place, others: Sequence[Place], numbers: Numbers) -> list[Place]:
    """The runs to compare with; at equal work those that took no more than a run that got to its end."""
    found = [q for q in others if all(q.dimensions.get(k) == p.dimensions.get(k) for k in claim.pair_by)]
    own = numbers.records[p.spec.settings_id]
    if not claim.at_equal_work or not reached_end(own):
        return found
    return [q for q in found if operations(numbers.records[q.spec.settings_id]) <= operations(own)]


def _number(test: Test, ordered: Sequence[Place], partners: Mapping[str, Sequence[Place]], numbers: Numbers) -> float:
    values, of_pair = [], MEASURES[test.metric].of_pair
    for own in (p.spec.settings_id for p in ordered):
        value = 0.0 if of_pair else numbers.of(own, test)
        if of_pair or test.compare:
            beside = (q.spec.settings_id for q in partners[own])
            them = [numbers.between(own, q, test) if of_pair else numbers.of(q, test) for q in beside]
            value = COMPARE[test.compare](value, them)
        values.append(value)
    return values[0] if test.combine in ("", NEAREST) else COMBINE[test.combine](values)
