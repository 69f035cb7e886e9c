"""Represent the settings of a map as points: their numbers, and whether the claim holds, fails, or is left open.

A setting is left open, and out of the count, if its runs settle nothing: a limit ended them (module endings), they
ended before the time of the claim, runs to be compared have no numbers, no partner or the same steps, or they lack
values that the claim names.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ....results.judgements.claims import Ending
from ....results.records import RunRecord
from ....results.work import operations
from .endings import covers_interval, ends_early, is_settled, reaches_time, stops_in_start_up
from .evidence import MEASURES
from .maps import PlacedRun, is_printed
from .measures import reached_end
from .numbers import RunNumbers
from .predicates import BEST, COMBINE, COMPARE, NEAREST, RATIOS, take_best
from .register import Claim, Test

LOOSEST_FIRST = ("tolerance", "step", "max_step")  # dimensions whose values are taken from the largest down
# dimensions in which a control must equal the run that it is compared with
BESIDE = ("problem", "omega_z", "literal_start", "release", "duration", "frame", "chart", "tolerance", "max_step")
ACTS = 0.01  # relative change of the mean step below which a reduction had no effect


@dataclass(frozen=True)
class Point:
    """A setting of the map: its runs (several if a claim looks across a dimension), its numbers and its outcome."""

    places: tuple[PlacedRun, ...]
    numbers: tuple[float, ...]  # one per test
    holds: bool | None  # whether the claim holds here; None if left open
    printed: bool
    left_out: Ending = Ending.FINAL  # reason if it is left open
    stopped: bool = False  # holds by a number that is infinite because the run stopped
    met_at: tuple[Any, ...] = ()  # the values along ``across`` that meet the claim, if one suffices
    series: tuple[str, ...] = ()  # digests of its series; empty if one is missing
    failed: bool = False  # True if it rests on a run that stopped before the time of the claim
    beside: tuple[PlacedRun, ...] = ()  # the runs that it is compared with


def points(claim: Claim, own: Iterable[PlacedRun], others: Sequence[PlacedRun], numbers: RunNumbers) -> list[Point]:
    """Return the settings of a claim's map as points, in the order of the runs.

    ``own`` are the claim's runs, ``others`` those that they are compared with. A claim that looks across a
    dimension has a point for each group of runs that differ in it alone; groups with one value test nothing and are
    left out.
    """
    groups: dict[str, list[PlacedRun]] = {}
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


def _split_ranges(claim: Claim, group: Sequence[PlacedRun]) -> list[tuple[list[PlacedRun], bool]]:
    """Return the runs of the group in each range of the claim, each with whether they have the required values.

    Without ranges the whole group is returned; ranges with fewer than two runs are left out.
    """
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
    """Return the name of the dimension whose values are the claim's ranges along ``across``."""
    return f"{claim.across} range"


def is_comparable_control(claim: Claim, p: PlacedRun, q: PlacedRun) -> bool:
    """Return whether control ``q`` has the motion, chart, tolerance and step limit of ``p``, where both have them."""
    asked = (*BESIDE, _name_range(claim))
    shared = (k for k in asked if k in p.dimensions and k in q.dimensions and k != claim.across)
    return all(p.dimensions[k] == q.dimensions[k] for k in shared)


def is_partner(claim: Claim, p: PlacedRun, q: PlacedRun) -> bool:
    """Return whether ``q`` is another run that ``p`` may be compared with: equal in the claim's ``pair_by``.

    A dimension that one run lacks does not count.
    """
    shared = (k for k in claim.pair_by if k in p.dimensions and k in q.dimensions)
    return p.spec.settings_id != q.spec.settings_id and all(p.dimensions[k] == q.dimensions[k] for k in shared)


def _spans(claim: Claim, group: Sequence[PlacedRun]) -> bool:
    """Return whether the group has the values along ``across``, or as many, as the claim requires."""
    values = {p.dimensions.get(claim.across) for p in group}
    return len(values) >= claim.along if isinstance(claim.along, int) else values >= set(claim.along)


def _point(
    claim: Claim, ordered: Sequence[PlacedRun], partners: Mapping[str, Sequence[PlacedRun]], numbers: RunNumbers
) -> Point:
    """Return the point of one setting: the number of each test, whether the claim holds, and why if it is left open.

    ``ordered`` are its runs, ``partners`` the runs that each, by settings_id, is compared with.
    """
    found = tuple(_number(claim, t, ordered, partners, numbers) for t in claim.tests)
    beside = [q for p in ordered for q in partners[p.spec.settings_id]]
    used = [*ordered, *beside]
    each = [_finding(claim, t, v, ordered, beside, numbers) for t, v in zip(claim.tests, found, strict=True)]
    stopped = any(MEASURES[t.metric].of_stopped for t in claim.tests)
    holds = False if False in each else None if None in each else True
    if stopped and any(h is None for t, h in zip(claim.tests, each, strict=True) if MEASURES[t.metric].of_stopped):
        holds = None  # it did not stop by itself, and the claim is about such stops
    printed = claim.map is not None and any(is_printed(p, claim.map.printed) for p in ordered)
    printed = printed or all(MEASURES[t.metric].of_problem for t in claim.tests)  # no setting of a solver matters
    endless = any(map(math.isinf, found)) and not all(reached_end(numbers.records[p.spec.settings_id]) for p in ordered)
    endings = {_ending(claim, p, numbers) for p in used} - {Ending.FINAL}
    asked = [(t, v) for t, v in zip(claim.tests, found, strict=True) if not _compares(t)]
    early = any(_ends_early(claim, t, v, used, numbers) for t, v in asked)
    rest = Ending.EARLY if early else Ending.ENDED if stopped else Ending.UNCOMPARED
    why = next((how for how in Ending if how in endings), rest) if holds is None else Ending.FINAL
    series = [numbers.records[p.spec.settings_id].series_sha256 for p in (*ordered, *_sort_places(beside))]
    failed = not all(reaches_time(t, numbers.records[p.spec.settings_id]) for t in claim.tests for p in ordered)
    return Point(
        tuple(ordered),
        found,
        holds,
        printed,
        why,
        bool(holds and endless),
        (),
        tuple(series) if all(series) else (),
        failed,
        tuple(beside),
    )


def _nearest(
    claim: Claim, ordered: Sequence[PlacedRun], partners: Mapping[str, Sequence[PlacedRun]], numbers: RunNumbers
) -> Point:
    """Return the point of a group of runs in which one run that meets all tests suffices.

    Its numbers are those at a value along ``across`` that meets all tests or, without any, at the one that comes
    nearest.
    """
    each = [_point(claim, [p], partners, numbers) for p in ordered]

    def near(p: Point) -> tuple[float, int, float]:
        """Return the sort key of a run's point, largest for the one that meets the claim best."""
        held = [t.band.holds(v) for t, v in zip(claim.tests, p.numbers, strict=True)]
        return {True: 2, None: 1, False: 0}[p.holds], sum(held), -claim.tests[0].band.measure_excess(p.numbers[0])

    best = max(each, key=near)
    places = (*best.places, *(p for p in ordered if p is not best.places[0]))
    met = tuple(p.dimensions[claim.across] for p, q in zip(ordered, each, strict=True) if q.holds)
    series = tuple(s for p in each for s in p.series) if all(p.series for p in each) else ()
    printed, failed = any(p.printed for p in each), best.failed and len(met) == 1
    beside = tuple(q for p in each for q in p.beside)
    return replace(best, places=places, printed=printed, met_at=met, series=series, failed=failed, beside=beside)


def _finding(
    claim: Claim, test: Test, value: float, own: Sequence[PlacedRun], beside: Sequence[PlacedRun], numbers: RunNumbers
) -> bool | None:
    """Return whether one test holds for its number ``value``; None if its runs leave it open.

    ``own`` are the setting's runs, ``beside`` those that they are compared with.
    """
    runs = [(numbers.records[p.spec.settings_id], _ending(claim, p, numbers)) for p in (*own, *beside)]
    if _ends_early(claim, test, value, (*own, *beside), numbers):
        return None
    if math.isnan(value) and _compares(test):
        return None
    if not (is_settled(test, *runs[0], value) if len(runs) == 1 else all(covers_interval(test, *run) for run in runs)):
        return None
    if claim.at_equal_work and _all_cost_more(own, beside, numbers):
        return None if test.band.measure_excess(value) < 0.0 else False  # not met with more work, so not with less
    return test.band.holds(value)


def _ends_early(claim: Claim, test: Test, value: float, runs: Sequence[PlacedRun], numbers: RunNumbers) -> bool:
    """Return whether the number might differ if no run had ended before the time of the claim.

    ``runs`` begin with the setting's own first run. The missing part of a run is unknown for every kind of test; a
    claim about reaching a time has a test of its own. A number of several runs is open unless the others bound it:
    a ratio to complete runs can only grow.
    """
    if claim.starting or any(MEASURES[t.metric].of_stopped for t in claim.tests):
        return False  # a claim on runs that stop concerns only what exists of them
    own, *others = (numbers.records[p.spec.settings_id] for p in runs)
    if not test.compare and test.combine not in ("", NEAREST):
        return not all(MEASURES[test.metric].of_end or reaches_time(test, r) for r in (own, *others))
    beside = others if test.compare else ()
    return ends_early(test, own, value) or not all(
        MEASURES[test.metric].of_end or reaches_time(test, r) for r in beside
    )


def _sort_places(places: Iterable[PlacedRun]) -> list[PlacedRun]:
    """Return the runs sorted by their settings_id."""
    return sorted(places, key=lambda p: p.spec.settings_id)


def _compares(test: Test) -> bool:
    """Return whether a test without a number stays undecided: it compares runs, or measures when a run stopped."""
    return bool(test.compare) or test.combine in RATIOS or MEASURES[test.metric].of_stopped


def _all_cost_more(own: Sequence[PlacedRun], beside: Sequence[PlacedRun], numbers: RunNumbers) -> bool:
    """Return whether the ``own`` runs reached their end, each with fewer operations than all runs ``beside``."""
    runs, others = ([numbers.records[p.spec.settings_id] for p in places] for places in (own, beside))
    return all(reached_end(r) and operations(q) > operations(r) for r in runs for q in others)


def _ending(claim: Claim, p: PlacedRun, numbers: RunNumbers) -> Ending:
    """Return how a run ended, as far as this claim is concerned.

    For a claim on stops, one during start-up is not final. For a claim on starting, a run without a step is final.
    """
    how = numbers.endings[p.spec.settings_id]
    asks_when = any(MEASURES[t.metric].of_stopped for t in claim.tests)
    if how is Ending.FINAL and asks_when and stops_in_start_up(numbers.records[p.spec.settings_id]):
        return Ending.START_UP
    return Ending.FINAL if claim.starting and how is Ending.NO_START else how


def _partners(claim: Claim, p: PlacedRun, others: Sequence[PlacedRun], numbers: RunNumbers) -> list[PlacedRun]:
    """Return the runs that ``p`` is compared with; for a claim at equal work, those that took no more operations.

    If there are none of these, the cheapest that reached its end is used: what beats it at less work beats all at equal
    work. A run that did not reach its end is compared with all.
    """
    found = [q for q in others if is_partner(claim, p, q) and not (claim.must_act and _is_same(p, q, numbers))]
    own = numbers.records[p.spec.settings_id]
    if not claim.at_equal_work or not reached_end(own):
        return found

    def work(q: PlacedRun) -> float:
        """Return the operations of a run."""
        return operations(numbers.records[q.spec.settings_id])

    ended = sorted((q for q in found if reached_end(numbers.records[q.spec.settings_id])), key=work)
    return [q for q in found if work(q) <= operations(own)] or ended[:1]


def _is_same(p: PlacedRun, q: PlacedRun, numbers: RunNumbers) -> bool:
    """Return whether two runs have equal series, so that their difference in settings had no effect."""
    one, other = (numbers.records[x.spec.settings_id].series_sha256 for x in (p, q))
    return bool(one) and one == other


def _leave_reduced(test: Test, ordered: Sequence[PlacedRun], numbers: RunNumbers) -> list[PlacedRun]:
    """Return the runs without those whose mean step equals that of the run before, for a claim on smaller steps.

    For the ratio of last to first, only these two runs are considered.
    """
    kept: list[PlacedRun] = []
    for p in (ordered[0], ordered[-1]) if test.combine == "last over first" else ordered:
        one, other = (_mean_step(numbers.records[q.spec.settings_id]) for q in (kept[-1] if kept else p, p))
        if not kept or abs(one - other) > ACTS * max(one, other):
            kept.append(p)
    return kept


def _mean_step(r: RunRecord) -> float:
    """Return the time reached over the number of steps [s]; NaN for a run without steps."""
    return r.t_reached_s / r.steps if r.steps else math.nan


def _number(
    claim: Claim,
    test: Test,
    ordered: Sequence[PlacedRun],
    partners: Mapping[str, Sequence[PlacedRun]],
    numbers: RunNumbers,
) -> float:
    """Return the number of a test at a setting: that of its run, or combined over its runs along ``across``.

    If the test compares, each run's number is first compared with those of its partners.
    """
    values, of_pair = [], MEASURES[test.metric].of_pair
    if test.combine in RATIOS and claim.across in LOOSEST_FIRST:
        ordered = _leave_reduced(test, ordered, numbers)
    for own in (p.spec.settings_id for p in ordered):
        value = 0.0 if of_pair else numbers.evaluate_run(own, test)
        if of_pair or test.compare:
            beside = [q.spec.settings_id for q in partners[own]]
            them = [numbers.of_pair(own, q, test) if of_pair else numbers.evaluate_run(q, test) for q in beside]
            if test.compare == BEST:
                them = take_best([q.spec.solver for q in partners[own]], them)
            value = COMPARE[test.compare](value, them)
        values.append(value)
    return values[0] if test.combine in ("", NEAREST) else COMBINE[test.combine](values)
