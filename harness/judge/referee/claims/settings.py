"""Judge a claim at each setting of its map: group runs, find their partners, measure, and compare with the bands.

A setting is left open, and out of the count, if its runs settle nothing: a limit ended them (module endings), they
ended before the time of the claim, runs to be compared have no numbers, no partner or the same steps, or they lack
values that the claim names.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ....results.judgements.claims import Ending
from ....results.records import RunRecord
from ....results.work import count_operations
from .bands import BEST, COMBINE, COMPARE, NEAREST, RATIOS, take_best
from .endings import is_decided, is_final, reaches_time, stops_in_start_up
from .frame import TriedRun, is_printed
from .measures import reached_end
from .register import Claim, Test

LOOSEST_FIRST = ("tolerance", "step", "max_step")  # dimensions whose values are taken from the largest down
# dimensions in which a control must equal the run that it is compared with
BESIDE = ("problem", "omega_z", "literal_start", "release", "duration", "frame", "chart", "tolerance", "max_step")
ACTS = 0.01  # relative change of the mean step below which a reduction had no effect
Partners = Mapping[str, Sequence[TriedRun]]  # the runs that each, by settings_id, is compared with


@dataclass(frozen=True, eq=False)
class Setting:
    """A setting of the map: its runs (several if a claim looks across a dimension), its numbers and its outcome."""

    runs: tuple[TriedRun, ...]
    beside: tuple[TriedRun, ...]  # the runs that they are compared with
    numbers: tuple[float, ...]  # one per test
    holds: bool | None  # whether the claim holds here; None if left open
    printed: bool
    left_out: Ending = Ending.FINAL  # reason if it is left open
    stopped: bool = False  # holds by a number that is infinite because the run stopped
    met_at: tuple[Any, ...] = ()  # the values along ``across`` that meet the claim, if one suffices
    series: tuple[str, ...] = ()  # digests of its series; empty if one is missing
    failed: bool = False  # True if it rests on a run that stopped before the time of the claim

    @property
    def solver(self) -> str:
        """The solver of its first run."""
        return self.runs[0].spec.solver


def find_settings(claim: Claim, own: Iterable[TriedRun], others: Sequence[TriedRun]) -> list[Setting]:
    """Return the settings of a claim's map, judged, in the order of the runs.

    ``own`` are the claim's runs, ``others`` those that they are compared with. A claim that looks across a dimension
    has a setting for each group of runs that differ in it alone, in each of its ranges. Groups with one value test
    nothing and are left out; those that lack values that the claim names are left open.
    """
    groups: dict[str, list[TriedRun]] = {}
    for p in own:
        rest = {k: str(v) for k, v in p.dimensions.items() if k != claim.across} if claim.across else p.settings_id
        groups.setdefault(repr(rest), []).append(p)
    out = []
    for group in groups.values():
        partners_of = {p.settings_id: _find_partners(claim, p, others) for p in group}
        if not claim.across:
            out.append(_judge_setting(claim, group, partners_of))
            continue
        ordered = sorted(group, key=lambda p: p.dimensions.get(claim.across) or 0.0)
        if claim.across in LOOSEST_FIRST:
            ordered.reverse()
        for part, wanted in _split_ranges(claim, ordered):
            if len(part) > 1:
                found = (_find_nearest if claim.one_suffices else _judge_setting)(claim, part, partners_of)
                values = {p.dimensions.get(claim.across) for p in part}
                whole = len(values) >= wanted if isinstance(wanted, int) else values >= set(wanted)
                out.append(found if whole else leave_open(found))
    return out


def leave_open(setting: Setting) -> Setting:
    """Return a setting left open because its runs cannot be compared."""
    return replace(setting, holds=None, left_out=Ending.UNCOMPARED, stopped=False, met_at=())


def _split_ranges(claim: Claim, group: list[TriedRun]) -> Iterable[tuple[list[TriedRun], int | tuple[float, ...]]]:
    """Yield the runs of ``group`` in each of the claim's ``ranges`` along ``across``, and the values they must have.

    These runs get the range as a further dimension, and must have its ends as values. Without ranges the whole group
    is yielded once, with the claim's values ``along``, or their least number.
    """
    if not claim.ranges:
        yield group, claim.along
    for ends in claim.ranges:
        named = {_name_range(claim): f"{ends[0]:g} to {ends[1]:g}"}
        inside = [p for p in group if min(ends) <= p.dimensions[claim.across] <= max(ends)]
        yield [replace(p, dimensions={**p.dimensions, **named}) for p in inside], ends


def _name_range(claim: Claim) -> str:
    """Return the name of the dimension whose values are the claim's ranges along ``across``."""
    return f"{claim.across} range"


def have_equal_values(p: TriedRun, q: TriedRun, names: Iterable[str]) -> bool:
    """Return whether two runs have equal values in the dimensions ``names``, as far as both have them."""
    return all(p.dimensions[k] == q.dimensions[k] for k in names if k in p.dimensions and k in q.dimensions)


def is_comparable_control(claim: Claim, p: TriedRun, q: TriedRun) -> bool:
    """Return whether control ``q`` has the motion, chart, tolerance and step limit of the claim's run ``p``."""
    return have_equal_values(p, q, {*BESIDE, _name_range(claim)} - {claim.across})


def is_partner(claim: Claim, p: TriedRun, q: TriedRun) -> bool:
    """Return whether ``q`` is another run that ``p`` may be compared with: equal in the claim's ``pair_by``."""
    return p.settings_id != q.settings_id and have_equal_values(p, q, claim.pair_by)


def keep_acting(p: TriedRun, found: list[TriedRun]) -> list[TriedRun]:
    """Return those of the runs ``found`` whose series differ from those of ``p`` (``must_act``).

    Where they are equal, the difference in settings had no effect.
    """
    own = p.record.series_sha256
    return [q for q in found if not own or q.record.series_sha256 != own]


def keep_cheaper(p: TriedRun, found: list[TriedRun]) -> list[TriedRun]:
    """Return those of the runs ``found`` that took no more operations than ``p`` (``at_equal_work``).

    If there is none, it is the cheapest that reached its end: what beats it at less work beats all at equal work. If
    ``p`` did not reach its end, all are returned.
    """
    if not reached_end(p.record):
        return found
    ended = sorted((q.record for q in found if reached_end(q.record)), key=count_operations)
    cheapest = [q for q in found if ended and q.record is ended[0]]
    return [q for q in found if count_operations(q.record) <= count_operations(p.record)] or cheapest


# rare keys of a claim: functions that select from the partners of a run, in the order applied
PARTNER_RULES: dict[str, Callable[[TriedRun, list[TriedRun]], list[TriedRun]]] = {
    "must_act": keep_acting,
    "at_equal_work": keep_cheaper,
}


def _find_partners(claim: Claim, p: TriedRun, others: Sequence[TriedRun]) -> list[TriedRun]:
    """Return the partners of ``p``: the runs that it is compared with, by the claim's rules."""
    found = [q for q in others if is_partner(claim, p, q)]
    for key, keep in PARTNER_RULES.items():
        found = keep(p, found) if getattr(claim, key) else found
    return found


def _judge_setting(claim: Claim, runs: Sequence[TriedRun], partners_of: Partners) -> Setting:
    """Return one setting: the number of each test, whether the claim holds, and why if it is left open."""
    beside = [q for p in runs for q in partners_of[p.settings_id]]
    used = [*runs, *beside]
    numbers = tuple(_find_number(claim, t, runs, partners_of) for t in claim.tests)
    tested = list(zip(claim.tests, numbers, strict=True))
    each = [_judge_test(claim, t, v, runs, beside) for t, v in tested]
    holds = False if False in each else None if None in each else True
    if any(h is None and t.measure.of_stopped for h, t in zip(each, claim.tests, strict=True)):
        holds = None  # it did not stop by itself, and the claim is about such stops
    why = Ending.FINAL
    if holds is None:
        early = any(not _is_undecided_by_nan(t) and _is_unsettled(claim, t, v, used) for t, v in tested)
        rest = Ending.EARLY if early else Ending.ENDED if claim.asks_when else Ending.UNCOMPARED
        endings = {find_ending(claim, p) for p in used}
        why = next((how for how in Ending if how in endings and how is not Ending.FINAL), rest)
    endless = any(map(math.isinf, numbers)) and not all(reached_end(p.record) for p in runs)
    printed = claim.map is not None and any(is_printed(p, claim.map.printed) for p in runs)
    series = [p.record.series_sha256 for p in (*runs, *sorted(beside, key=lambda q: q.settings_id))]
    return Setting(
        tuple(runs),
        tuple(beside),
        numbers,
        holds,
        printed or claim.is_of_problem,
        why,
        bool(holds and endless),
        series=tuple(series) if all(series) else (),
        failed=not all(reaches_time(t, p.record) for t in claim.tests for p in runs),
    )


def _find_nearest(claim: Claim, runs: Sequence[TriedRun], partners_of: Partners) -> Setting:
    """Return the setting of a group of runs in which one run that meets all tests suffices.

    Its numbers and outcome are those of a run that meets all tests or, without any, of the one that comes nearest.
    """
    each = [_judge_setting(claim, [p], partners_of) for p in runs]

    def rank(s: Setting) -> tuple[int, int, float]:
        """Return the sort key of a run's setting, largest for the best: outcome, tests met, nearness to first band."""
        held = [t.band.holds(v) for t, v in zip(claim.tests, s.numbers, strict=True)]
        near = -claim.tests[0].band.measure_excess(s.numbers[0])
        return {True: 2, None: 1, False: 0}[s.holds], sum(held), near

    best = max(each, key=rank)
    met = tuple(s.runs[0].dimensions[claim.across] for s in each if s.holds)
    return replace(
        best,
        runs=(*best.runs, *(p for p in runs if p is not best.runs[0])),
        beside=tuple(q for s in each for q in s.beside),
        printed=any(s.printed for s in each),
        met_at=met,
        series=tuple(one for s in each for one in s.series) if all(s.series for s in each) else (),
        failed=best.failed and len(met) == 1,
    )


def _judge_test(
    claim: Claim, test: Test, value: float, own: Sequence[TriedRun], beside: Sequence[TriedRun]
) -> bool | None:
    """Return whether a test holds by its number ``value``; None if its runs leave it open.

    ``own`` are the setting's runs, ``beside`` their partners. A single run without partners settles the test even if
    it was cut short, once no continuation could change the outcome.
    """
    first, *rest = (*own, *beside)
    how, settles = find_ending(claim, first), not rest and is_decided(test, first.record, value)
    final = is_final(test, first.record, how) or (settles and how is not Ending.NO_START)
    if (
        (math.isnan(value) and _is_undecided_by_nan(test))
        or _is_unsettled(claim, test, value, (first, *rest))
        or not (final and all(is_final(test, p.record, find_ending(claim, p)) for p in rest))
    ):
        return None
    # true without partners, too: a test that compares has no number then, and is open already
    pairs = ((p.record, q.record) for p in own for q in beside)
    only_dearer = all(reached_end(p) and count_operations(q) > count_operations(p) for p, q in pairs)
    if claim.at_equal_work and only_dearer:
        # What a partner missed with more work than the setting's own run it would miss with as much: the test fails. A
        # number inside the band may be due to that work: it is left open; one at an end of the band counts as missed.
        return None if test.band.measure_excess(value) < 0.0 else False
    return test.band.holds(value)


def _is_unsettled(claim: Claim, test: Test, value: float, runs: Sequence[TriedRun]) -> bool:
    """Return whether a test's number ``value`` is unsettled because runs ended before the time of the claim.

    ``runs`` begin with the setting's own first run. If only that one ended early, and the test is on one run or
    compares it with others, the number is settled once no continuation could change the outcome. Claims on runs that
    stop concern only what exists of them: False.
    """
    if claim.starting or claim.asks_when or test.measure.of_end:
        return False
    late = [p for p in runs if not reaches_time(test, p.record)]
    if late == [runs[0]] and (test.compare or test.combine in ("", NEAREST)):
        return not is_decided(test, late[0].record, value)
    return bool(late)


def _is_undecided_by_nan(test: Test) -> bool:
    """Return whether a test without a number stays undecided: it compares runs, or measures when a run stopped."""
    return bool(test.compare) or test.combine in RATIOS or test.measure.of_stopped


def find_ending(claim: Claim, p: TriedRun) -> Ending:
    """Return how a run ended, as far as this claim is concerned.

    For a claim on stops, one during start-up is not final. For a claim on starting, a run without a step is final.
    """
    if p.ending is Ending.FINAL and claim.asks_when and stops_in_start_up(p.record):
        return Ending.START_UP
    return Ending.FINAL if claim.starting and p.ending is Ending.NO_START else p.ending


def _find_number(claim: Claim, test: Test, runs: Sequence[TriedRun], partners_of: Partners) -> float:
    """Return the number of a test at a setting: that of its run, or combined over its runs along ``across``.

    If the test compares, each run's number is first compared with those of its partners (``partners_of``).
    """
    if test.combine in RATIOS and claim.across in LOOSEST_FIRST:
        runs = _drop_unreduced(test, runs)
    values = [_compare_run(test, p, partners_of[p.settings_id]) for p in runs]
    return values[0] if test.combine in ("", NEAREST) else COMBINE[test.combine](values)


def _compare_run(test: Test, p: TriedRun, partners: Sequence[TriedRun]) -> float:
    """Return the number of a test on a run, compared with those of its partners if the test compares."""
    if test.measure.of_pair:
        return COMPARE[test.compare](0.0, [p.find_distance(q, test) for q in partners])
    if not test.compare:
        return p.find_number(test)
    them = [q.find_number(test) for q in partners]
    them = take_best([q.spec.solver for q in partners], them) if test.compare == BEST else them
    return COMPARE[test.compare](p.find_number(test), them)


def _drop_unreduced(test: Test, runs: Sequence[TriedRun]) -> list[TriedRun]:
    """Return the runs without those that took the same mean step as the run before, though they were to take smaller.

    For the ratio of the last number to the first, only these two runs are considered.
    """
    kept: list[TriedRun] = []
    for p in (runs[0], runs[-1]) if test.combine == "last over first" else runs:
        one, other = (_measure_mean_step(q.record) for q in (kept[-1] if kept else p, p))
        if not kept or abs(one - other) > ACTS * max(one, other):
            kept.append(p)
    return kept


def _measure_mean_step(r: RunRecord) -> float:
    """Return the time reached over the number of steps [s]; NaN for a run without steps."""
    return r.t_reached_s / r.steps if r.steps else math.nan
