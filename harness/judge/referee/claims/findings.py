"""Conclude on the settings of a claim: at those that the paper prints and the others, by solver, and of a control."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace as replace_point
from typing import NamedTuple

from msgspec.structs import replace

from ....results.judgements.claims import (
    ClaimFinding,
    ClaimGap,
    ClaimVerdict,
    Control,
    Ending,
    ExcludedSettings,
    MissingReason,
    Value,
)
from . import register as given
from .conditions import decide_along, decision
from .evidence import MEASURES
from .maps import PlacedRun, list_values, select
from .numbers import RunNumbers
from .points import Point, is_comparable_control, points
from .predicates import NEAREST, SPREADS

CUT = (Ending.MACHINE, Ending.SLOW, Ending.APART, Ending.EARLY)  # a run ended before the time of the claim
FEW = 0.1  # fraction of the settings: if fewer reached that time, they settle nothing


class RunsOfClaim(NamedTuple):
    """The runs of a claim, the runs that it is compared with, and the runs of its control."""

    own: tuple[PlacedRun, ...]
    others: tuple[PlacedRun, ...]
    controls: tuple[PlacedRun, ...]

    @classmethod
    def select(cls, claim: given.Claim, places: Sequence[PlacedRun]) -> "RunsOfClaim":
        """Return those of the runs ``places`` that the claim's three maps select."""
        return cls(*(select(places, m.over) if m else () for m in (claim.map, claim.against, claim.control)))


def ask_control(
    claim: given.Claim, rows: Sequence[Sequence[Point]], tried: RunsOfClaim, numbers: RunNumbers
) -> tuple[Control | None, dict[int, Point]]:
    """Return the finding on the control for the first verdict's settings, and the control's point for each setting.

    The second result maps the id() of a setting's point to the control's point. The finding is None if no setting has a
    control.
    """
    asked: dict[tuple[object, ...], list[Point]] = {}  # by the values along ``across`` of a setting
    beside = {}
    for p in (p for row in rows for p in row):
        along = _values_along(claim, p)
        if along not in asked:
            asked[along] = _ask_over(claim, along, tried, numbers)
        found = [q for q in asked[along] if is_comparable_control(claim, p.places[0], q.places[0])]
        if found:
            beside[id(p)] = min(found, key=lambda q: q.holds is None)
    first = _first_side(rows)
    used = {id(q): q for row in first for p in row if (q := beside.get(id(p)))}
    if not used:
        return None, beside
    both = sum(any((q := beside.get(id(p))) and _both_hold(p, q) for p in row) for row in first)
    alone = sum(bool(row[0].holds) and not any(_settles(beside.get(id(p))) for p in row) for row in first)
    finding = find(claim, merge_equal(claim, list(used.values())), decide=True, explain=True)
    return Control(tuple(list_values(p.spec.solver for p in tried.controls)), finding, both, alone), beside


def _values_along(claim: given.Claim, p: Point) -> tuple[object, ...]:
    """Return a setting's values of the dimension that the claim looks ``across``; empty for a claim without one."""
    return tuple(list_values(q.dimensions[claim.across] for q in p.places)) if claim.across else ()


def _ask_over(claim: given.Claim, along: tuple[object, ...], tried: RunsOfClaim, numbers: RunNumbers) -> list[Point]:
    """Return the points of the control's runs that have exactly the values ``along`` of the dimension ``across``."""
    own = [q for q in tried.controls if not along or q.dimensions.get(claim.across) in along]
    asked = points(replace(claim, map=claim.control), own, tried.others, numbers)
    found = [q for q in asked if _values_along(claim, q) == along]
    return [
        replace_point(q, holds=None, left_out=Ending.UNCOMPARED) if _stands_still(claim, q, numbers) else q
        for q in found
    ]


def _stands_still(claim: given.Claim, q: Point, numbers: RunNumbers) -> bool:
    """Return whether the claim tests a spread and the control's runs have equal series, so that nothing varied them."""
    series = {numbers.records[p.spec.settings_id].series_sha256 for p in q.places}
    return len(series) == 1 and all(series) and any(t.combine in SPREADS for t in claim.tests)


def _settles(q: Point | None) -> bool:
    """Return whether a setting's control ``q`` exists, and its runs decide the claim."""
    return q is not None and q.holds is not None


def _both_hold(p: Point, q: Point) -> bool:
    """Return whether a setting and its control meet the claim, at the same value if one value suffices."""
    return bool(p.holds and q.holds and (not p.met_at or set(p.met_at) & set(q.met_at)))


def split_by_solver(claim: given.Claim, rows: Sequence[Sequence[Point]]) -> dict[str, ClaimFinding]:
    """Return the finding on these settings for each solver; empty unless there are several solvers.

    If a verdict depends on one failed run, it is left open only if that of all solvers together does so, too.
    """
    own: dict[str, list[Sequence[Point]]] = {}
    for row in rows:
        own.setdefault(row[0].places[0].spec.solver, []).append(row)
    if len(own) < 2:
        return {}
    hangs = any(m.gap is ClaimGap.HANGS for m in find(claim, rows, True, False).missing)
    return {name: find(claim, own[name], True, True, hangs=hangs) for name in sorted(own)}


def split_sides(rows: Sequence[Sequence[Point]]) -> tuple[list[Sequence[Point]], list[Sequence[Point]]]:
    """Split groups of equal settings into those that the paper prints and the others.

    A setting with the series of a printed setting is in its group and so counts as printed.
    """
    printed = [row for row in rows if any(p.printed for p in row)]
    return printed, [row for row in rows if not any(p.printed for p in row)]


def _first_side(rows: Sequence[Sequence[Point]]) -> list[Sequence[Point]]:
    """Return the groups of settings that the paper prints or, if it prints none, all."""
    return split_sides(rows)[0] or list(rows)


def merge_equal(claim: given.Claim, found: Sequence[Point]) -> list[list[Point]]:
    """Group settings that count once, because their series are equal; the first represents its group.

    If all tests measure the problem alone, settings of one problem with the same outcome form a group.
    """
    out: dict[object, list[Point]] = {}
    identity = all(MEASURES[t.metric].of_problem for t in claim.tests)
    for k, p in enumerate(found):
        key: object = (p.series, repr(p.numbers), p.holds, p.left_out) if p.series else k
        key = (p.places[0].spec.problem, p.holds, p.left_out) if identity else key
        out.setdefault(key, []).append(p)
    return list(out.values())


def find_sides(
    claim: given.Claim, rows: Sequence[Sequence[Point]], decide: bool = True, explain: bool = True
) -> tuple[ClaimFinding | None, ClaimFinding | None]:
    """Return the findings at the settings that the paper prints and at the others; None for a side without settings.

    ``rows`` are the groups of equal settings, as of ``merge_equal``; the flags are those of ``find``.
    """
    sides = (find(claim, side, decide, explain) if side else None for side in split_sides(rows))
    return tuple(sides)  # type: ignore[return-value]


def find(
    claim: given.Claim, rows: Sequence[Sequence[Point]], decide: bool, explain: bool, *, hangs: bool = True
) -> ClaimFinding:
    """Count the settings where the claim holds, and conclude with a verdict.

    ``rows`` are groups of equal settings, each counted once. Without ``decide`` the verdict is left open, as for an
    incomplete map. ``explain`` names the choices with which the claim holds. With ``hangs`` a verdict that depends
    on one failed run is left open.
    """
    counted, lone = _set_back([row for row in rows if row[0].holds is not None])
    holding = [row for row in counted if row[0].holds]
    # a printed setting is represented by itself, not by equal ones
    own = [[p for p in row if p.printed] or row for row in counted]
    every = [p for row in own for p in row]
    left = Counter(row[0].left_out for row in rows if row[0].holds is None)
    verdict = _verdict(claim, len(holding), len(counted)) if decide else ClaimVerdict.CANNOT_BE_TOLD
    missing = _list_doubts(claim, [row[0] for row in counted], left) if decide else []
    missing = [m for m in missing if hangs or m.gap is not ClaimGap.HANGS]
    values = {q.dimensions[claim.across] for row in rows for p in row for q in p.places} if _one_suffices(claim) else ()
    met = {v for p in every for v in p.met_at}
    some = bool(values) and any(len(set(row[0].met_at)) < len(values) for row in counted)
    why = None
    if missing:
        verdict = ClaimVerdict.CANNOT_BE_TOLD
    elif verdict is ClaimVerdict.REPRODUCED and some:
        verdict = ClaimVerdict.REPRODUCED_IF
        shared = set.intersection(*(set(row[0].met_at) for row in counted))
        why = decide_along(claim.across, tuple(shared), list_values(values)) if shared else None
    divided = claim.quantifier == "some" and verdict is ClaimVerdict.REPRODUCED and len(holding) < len(counted)
    if (verdict is ClaimVerdict.REPRODUCED_IF or divided) and explain and why is None:
        why = decision(_spread_along(claim, every) if some else list_dimensions(claim, every))
    return ClaimFinding(
        verdict,
        len(holding),
        len(counted),
        len(every),
        sum(row[0].stopped for row in holding),
        why,
        (),
        tuple(ExcludedSettings(how, left[how]) for how in Ending if left[how]),
        (len(met), len(values)) if values else None,
        tuple(missing),
        sum(map(len, counted)) - len(every),
        lone,
    )


def _set_back(counted: Sequence[Sequence[Point]]) -> tuple[list[Sequence[Point]], int]:
    """Return the groups of settings with some set to "not met", and the number of these.

    The changed settings meet the claim by one failed run alone, while other settings meet it without such a run.
    """
    lone = [bool(row[0].holds and row[0].failed and row[0].met_at) for row in counted]
    if not any(row[0].holds and not alone for row, alone in zip(counted, lone, strict=True)):
        return list(counted), 0
    return [_not_met(row) if alone else row for row, alone in zip(counted, lone, strict=True)], sum(lone)


def _not_met(row: Sequence[Point]) -> list[Point]:
    """Return the settings changed so that they do not meet the claim, with no value that does and no failed run."""
    return [replace_point(p, holds=False, met_at=(), failed=False) for p in row]


def _one_suffices(claim: given.Claim) -> bool:
    """Return whether one value along ``across`` that meets all tests suffices for the claim."""
    return any(t.combine == NEAREST for t in claim.tests)


def _verdict(claim: given.Claim, holding: int, counted: int) -> ClaimVerdict:
    """Return the verdict if ``holding`` of ``counted`` settings meet the claim: all, some or none of them.

    With the quantifier "some" one setting that meets it suffices; with no setting counted the verdict is unknown.
    """
    if not counted:
        return ClaimVerdict.CANNOT_BE_TOLD
    if holding == counted or (holding and claim.quantifier == "some"):
        return ClaimVerdict.REPRODUCED
    return ClaimVerdict.REPRODUCED_IF if holding else ClaimVerdict.NOT_REPRODUCED


def _list_doubts(claim: given.Claim, counted: Sequence[Point], left: Mapping[Ending, int]) -> list[MissingReason]:
    """Return reasons why a count decides nothing: most runs ended early, or the verdict depends on one failed run.

    ``counted`` are the settings that count, ``left`` the numbers of those left out, by reason.
    """
    asked = len(counted) + sum(left[how] for how in CUT)
    if counted and len(counted) < FEW * asked:
        return [MissingReason(ClaimGap.REACHED, found=len(counted), wanted=asked)]
    holding, total = sum(p.holds is True for p in counted), len(counted)
    if total == 1 and counted[0].failed and any(left.values()):  # only one failed run is left of several
        return [MissingReason(ClaimGap.HANGS, counted[0].places[0].spec.case)]
    for p in counted:
        rest = total if p.met_at else total - 1  # without one of several values the setting remains, but is not met
        without = _verdict(claim, holding - bool(p.holds), rest)
        if p.failed and rest and without is not _verdict(claim, holding, total):
            return [MissingReason(ClaimGap.HANGS, p.places[0].spec.case)]
    return []


def list_dimensions(claim: given.Claim, points: Sequence[Point]) -> list[tuple[Mapping[str, Value], bool]]:
    """Return the dimensions of each setting that some run chose, and whether the claim holds there.

    Defaults differ between problems and solvers, and an option that a solver's runs leave alone is none of its
    choices.
    """
    places = [q for p in points for q in p.places]
    chosen = find_chosen(places) - {claim.across}
    own = {s: find_chosen(q for q in places if q.spec.solver == s) for s in {q.spec.solver for q in places}}

    def at(q: PlacedRun) -> dict[str, Value]:
        """Return the chosen dimensions of a run, without options that the runs of its solver leave alone."""
        left_alone = q.options - own[q.spec.solver]
        return {k: v for k, v in q.dimensions.items() if k in chosen and k not in left_alone}

    return [(at(p.places[0]), p.holds is True) for p in points]


def _spread_along(claim: given.Claim, points: Sequence[Point]) -> list[tuple[Mapping[str, Value], bool]]:
    """Return each setting with each value along ``across``, and whether that value meets the claim."""
    at = list_dimensions(claim, points)
    return [
        ({**own, claim.across: value}, value in p.met_at)
        for (own, _), p in zip(at, points, strict=True)
        for value in list_values(q.dimensions[claim.across] for q in p.places)
    ]


def find_chosen(places: Iterable[PlacedRun]) -> set[str]:
    """Return the names of the dimensions that some run sets to other than the default, and problem and solver."""
    return {"problem", "solver"}.union(*(p.dimensions.keys() - p.usual for p in places))
