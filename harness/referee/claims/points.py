"""The settings of a map as points: the numbers of each, and whether the claim holds there, fails, or is left open.

A setting is left open, and out of the count, where its runs settle nothing: a limit ended them (module endings), they
ended before the moment asked about, runs to be compared have no numbers, no partner or the same steps, or they lack
values that the claim names.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ...results.judgements.claims import Ending
from ...results.records import RunRecord
from ...results.work import operations
from .endings import ends_early, gets_to, in_time, is_settled, stops_in_start_up
from .evidence import MEASURES
from .maps import Place, is_printed
from .measures import reached_end
from .numbers import Numbers
from .predicates import COMBINE, COMPARE, NEAREST, RATIOS
from .register import Claim, Test

LOOSEST_FIRST = ("tolerance", "step", "max_step")
BESIDE = ("problem", "omega_z", "literal_start", "release", "duration", "frame", "chart", "tolerance", "max_step")
ACTS = 0.01  # of the mean step: a reduction that changes it by less has acted on no steps


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
    series: tuple[str, ...] = ()  # digests of the series it rests on; empty where one is missing
    failed: bool = False  # it rests on a run that stopped before the moment asked about
    beside: tuple[Place, ...] = ()  # the runs that it is compared with


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
            for own, spans in _split_ranges(claim, ordered):
                found = make(claim, own, partners, numbers)
                short = replace(found, holds=None, left_out=Ending.UNCOMPARED, stopped=False, met_at=())
                out.append(found if spans else short)
    return out


def _split_ranges(claim: Claim, group: Sequence[Place]) -> list[tuple[list[Place], bool]]:
    """The group, or its part in each range of the claim, a dimension of its own; and whether it spans what it must."""
    if not claim.ranges:
        return [(list(group), _spans(claim, group))]
    out = []
    for ends in claim.ranges:
        named = {_name_range(claim): f"{ends[0]:g} to {ends[1]:g}"}
        inside = [p for p in group if min(ends) <= p.dimensions[claim.across] <= max(ends)]
        if len(inside) > 1:
            spans = {p.dimensions[claim.across] for p in inside} >= set(ends)
            out.append(([replace(p, dimensions={**p.dimensions, **named}) for p in inside], spans))
    return out


def _name_range(claim: Claim) -> str:
    """The dimension that a range of values along ``across`` is."""
    return f"{claim.across} range"


def stands_beside(claim: Claim, p: Place, q: Place) -> bool:
    """Whether a control run ``q`` is of the motion, chart, tolerance and step limit of ``p``, as far as both have."""
    asked = (*BESIDE, _name_range(claim))
    shared = (k for k in asked if k in p.dimensions and k in q.dimensions and k != claim.across)
    return all(p.dimensions[k] == q.dimensions[k] for k in shared)


def is_partner(claim: Claim, p: Place, q: Place) -> bool:
    """Whether ``q`` is another run of equal ``pair_by``; a dimension that one of them has not got separates nothing."""
    shared = (k for k in claim.pair_by if k in p.dimensions and k in q.dimensions)
    return p.spec.settings_id != q.spec.settings_id and all(p.dimensions[k] == q.dimensions[k] for k in shared)


def _spans(claim: Claim, group: Sequence[Place]) -> bool:
    """Whether the group has the values along ``across``, or as many, as the claim is about."""
    values = {p.dimensions.get(claim.across) for p in group}
    return len(values) >= claim.along if isinstance(claim.along, int) else values >= set(claim.along)


def _point(claim: Claim, ordered: Sequence[Place], partners: Mapping[str, Sequence[Place]], numbers: Numbers) -> Point:
    found = tuple(_number(claim, t, ordered, partners, numbers) for t in claim.tests)
    beside = [q for p in ordered for q in partners[p.spec.settings_id]]
    used = [*ordered, *beside]
    each = [_finding(claim, t, v, ordered, beside, numbers) for t, v in zip(claim.tests, found, strict=True)]
    stopped = any(MEASURES[t.metric].of_stopped for t in claim.tests)
    holds = False if False in each else None if None in each else True
    if stopped and any(h is None for t, h in zip(claim.tests, each, strict=True) if MEASURES[t.metric].of_stopped):
        holds = None  # it did not stop by itself, which is what the claim is about
    printed = claim.map is not None and any(is_printed(p, claim.map.printed) for p in ordered)
    printed = printed or all(MEASURES[t.metric].of_problem for t in claim.tests)  # no setting of a solver enters
    endless = any(map(math.isinf, found)) and not all(reached_end(numbers.records[p.spec.settings_id]) for p in ordered)
    endings = {_ending(claim, p, numbers) for p in used} - {Ending.FINAL}
    asked = [(t, v) for t, v in zip(claim.tests, found, strict=True) if not _compares(t)]
    early = any(_ends_early(claim, t, v, used, numbers) for t, v in asked)
    rest = Ending.EARLY if early else Ending.ENDED if stopped else Ending.UNCOMPARED
    why = next((how for how in Ending if how in endings), rest) if holds is None else Ending.FINAL
    series = [numbers.records[p.spec.settings_id].series_sha256 for p in (*ordered, *_sort_places(beside))]
    failed = not all(gets_to(t, numbers.records[p.spec.settings_id]) for t in claim.tests for p in ordered)
    return Point(tuple(ordered), found, holds, printed, why, bool(holds and endless), (),
                 tuple(series) if all(series) else (), failed, tuple(beside))  # fmt: skip


def _nearest(
    claim: Claim, ordered: Sequence[Place], partners: Mapping[str, Sequence[Place]], numbers: Numbers
) -> Point:
    """Find a value along ``across`` that meets all tests, else the one that comes nearest."""
    each = [_point(claim, [p], partners, numbers) for p in ordered]

    def near(p: Point) -> tuple[float, int, float]:
        held = [t.band.holds(v) for t, v in zip(claim.tests, p.numbers, strict=True)]
        return {True: 2, None: 1, False: 0}[p.holds], sum(held), -claim.tests[0].band.beyond(p.numbers[0])

    best = max(each, key=near)
    places = (*best.places, *(p for p in ordered if p is not best.places[0]))
    met = tuple(p.dimensions[claim.across] for p, q in zip(ordered, each, strict=True) if q.holds)
    series = tuple(s for p in each for s in p.series) if all(p.series for p in each) else ()
    printed, failed = any(p.printed for p in each), best.failed and len(met) == 1
    beside = tuple(q for p in each for q in p.beside)
    return replace(best, places=places, printed=printed, met_at=met, series=series, failed=failed, beside=beside)


def _finding(
    claim: Claim, test: Test, value: float, own: Sequence[Place], beside: Sequence[Place], numbers: Numbers
) -> bool | None:
    """Whether one test holds; None where its runs leave that open."""
    runs = [(numbers.records[p.spec.settings_id], _ending(claim, p, numbers)) for p in (*own, *beside)]
    if _ends_early(claim, test, value, (*own, *beside), numbers):
        return None
    if math.isnan(value) and _compares(test):
        return None
    if not (is_settled(test, *runs[0], value) if len(runs) == 1 else all(in_time(test, *run) for run in runs)):
        return None
    if claim.at_equal_work and _dearer(own, beside, numbers):
        return None if test.band.beyond(value) < 0.0 else False  # with more work no better: less would not do
    return test.band.holds(value)


def _ends_early(claim: Claim, test: Test, value: float, runs: Sequence[Place], numbers: Numbers) -> bool:
    """Whether the number might be another, had no run ended before the moment asked about.

    That says nothing on what would have been there, whatever kind of test asks; where reaching it is the claim, a test
    asks for just that. Of several runs what the others do not bound is open: a ratio to complete runs can only grow.
    """
    if claim.starting or any(MEASURES[t.metric].of_stopped for t in claim.tests):
        return False  # of a claim on runs that stop, what there is of them is all that is asked about
    own, *others = (numbers.records[p.spec.settings_id] for p in runs)
    if not test.compare and test.combine not in ("", NEAREST):
        return not all(MEASURES[test.metric].of_end or gets_to(test, r) for r in (own, *others))
    beside = others if test.compare else ()
    return ends_early(test, own, value) or not all(MEASURES[test.metric].of_end or gets_to(test, r) for r in beside)


def _sort_places(places: Iterable[Place]) -> list[Place]:
    return sorted(places, key=lambda p: p.spec.settings_id)


def _compares(test: Test) -> bool:
    """Whether a number that does not exist means that there was nothing to compare, or no stop."""
    return bool(test.compare) or test.combine in RATIOS or MEASURES[test.metric].of_stopped


def _dearer(own: Sequence[Place], beside: Sequence[Place], numbers: Numbers) -> bool:
    """Whether all to be compared with took more operations than a run that got to its end."""
    runs, others = ([numbers.records[p.spec.settings_id] for p in places] for places in (own, beside))
    return all(reached_end(r) and operations(q) > operations(r) for r in runs for q in others)


def _ending(claim: Claim, p: Place, numbers: Numbers) -> Ending:
    how = numbers.endings[p.spec.settings_id]
    asks_when = any(MEASURES[t.metric].of_stopped for t in claim.tests)
    if how is Ending.FINAL and asks_when and stops_in_start_up(numbers.records[p.spec.settings_id]):
        return Ending.START_UP
    return Ending.FINAL if claim.starting and how is Ending.NO_START else how


def _partners(claim: Claim, p: Place, others: Sequence[Place], numbers: Numbers) -> list[Place]:
    """The runs to compare with; at equal work those that took no more than a run that got to its end.

    Where there are none, the cheapest that got to its end: what beats it at less work beats all at equal work.
    """
    found = [q for q in others if is_partner(claim, p, q) and not (claim.must_act and _is_same(p, q, numbers))]
    own = numbers.records[p.spec.settings_id]
    if not claim.at_equal_work or not reached_end(own):
        return found

    def work(q: Place) -> float:
        return operations(numbers.records[q.spec.settings_id])

    ended = sorted((q for q in found if reached_end(numbers.records[q.spec.settings_id])), key=work)
    return [q for q in found if work(q) <= operations(own)] or ended[:1]


def _is_same(p: Place, q: Place, numbers: Numbers) -> bool:
    """Whether two runs have one series."""
    one, other = (numbers.records[x.spec.settings_id].series_sha256 for x in (p, q))
    return bool(one) and one == other


def _leave_reduced(test: Test, ordered: Sequence[Place], numbers: Numbers) -> list[Place]:
    """Those whose steps differ from those of the one before: equal steps show nothing about reducing them."""
    kept: list[Place] = []
    for p in (ordered[0], ordered[-1]) if test.combine == "last over first" else ordered:
        one, other = (_mean_step(numbers.records[q.spec.settings_id]) for q in (kept[-1] if kept else p, p))
        if not kept or abs(one - other) > ACTS * max(one, other):
            kept.append(p)
    return kept


def _mean_step(r: RunRecord) -> float:
    return r.t_reached_s / r.steps if r.steps else math.nan


def _number(
    claim: Claim, test: Test, ordered: Sequence[Place], partners: Mapping[str, Sequence[Place]], numbers: Numbers
) -> float:
    values, of_pair = [], MEASURES[test.metric].of_pair
    if test.combine in RATIOS and claim.across in LOOSEST_FIRST:
        ordered = _leave_reduced(test, ordered, numbers)
    for own in (p.spec.settings_id for p in ordered):
        value = 0.0 if of_pair else numbers.of(own, test)
        if of_pair or test.compare:
            beside = (q.spec.settings_id for q in partners[own])
            them = [numbers.of_pair(own, q, test) if of_pair else numbers.of(q, test) for q in beside]
            value = COMPARE[test.compare](value, them)
        values.append(value)
    return values[0] if test.combine in ("", NEAREST) else COMBINE[test.combine](values)
