"""Findings on the settings of a claim: at those that the paper prints and the others, by solver, and of a control."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace as replace_point
from typing import NamedTuple

from msgspec.structs import replace

from ...results.judgements.claims import Control, Ending, Finding, Gap, LeftOut, Missing, Value, Verdict
from . import register as given
from .conditions import decide_along, decision
from .evidence import MEASURES
from .maps import Place, select, values_of
from .numbers import Numbers
from .points import Point, points, stands_beside
from .predicates import NEAREST

CUT = (Ending.MACHINE, Ending.SLOW, Ending.APART, Ending.EARLY)  # a run ended before the moment asked about
FEW = 0.1  # of the settings asked: fewer that got to that moment settle nothing


class Tried(NamedTuple):
    """The runs of a claim: its own, those compared with, and those of its control."""

    own: tuple[Place, ...]
    others: tuple[Place, ...]
    controls: tuple[Place, ...]

    @classmethod
    def of(cls, claim: given.Claim, places: Sequence[Place]) -> "Tried":
        """Those that its maps select."""
        return cls(*(select(places, m.over) if m else () for m in (claim.map, claim.against, claim.control)))


def ask_control(
    claim: given.Claim, rows: Sequence[Sequence[Point]], tried: Tried, numbers: Numbers
) -> tuple[Control | None, dict[int, Point]]:
    """The finding on the control runs beside the settings of the first verdict, and the one beside each point."""
    asked: dict[tuple[object, ...], list[Point]] = {}  # by the values along ``across`` that a setting has
    beside = {}
    for p in (p for row in rows for p in row):
        along = _values_along(claim, p)
        if along not in asked:
            asked[along] = _ask_over(claim, along, tried, numbers)
        found = [q for q in asked[along] if stands_beside(claim, p.places[0], q.places[0])]
        if found:
            beside[id(p)] = min(found, key=lambda q: q.holds is None)
    first = _first_side(rows)
    used = {id(q): q for row in first for p in row if (q := beside.get(id(p)))}
    if not used:
        return None, beside
    both = sum(any((q := beside.get(id(p))) and _both_hold(p, q) for p in row) for row in first)
    alone = sum(bool(row[0].holds) and not any(_settles(beside.get(id(p))) for p in row) for row in first)
    finding = find(claim, merge_equal(claim, list(used.values())), decide=True, explain=True)
    return Control(tuple(values_of(p.spec.solver for p in tried.controls)), finding, both, alone), beside


def _values_along(claim: given.Claim, p: Point) -> tuple[object, ...]:
    """The values along ``across`` of a setting; without it there are none."""
    return tuple(values_of(q.dimensions[claim.across] for q in p.places)) if claim.across else ()


def _ask_over(claim: given.Claim, along: tuple[object, ...], tried: Tried, numbers: Numbers) -> list[Point]:
    """The control asked over the values of the setting that it stands beside, where it has each of them."""
    own = [q for q in tried.controls if not along or q.dimensions.get(claim.across) in along]
    asked = points(replace(claim, map=claim.control), own, tried.others, numbers)
    return [q for q in asked if _values_along(claim, q) == along]


def _settles(q: Point | None) -> bool:
    """Whether a control stands there and decides."""
    return q is not None and q.holds is not None


def _both_hold(p: Point, q: Point) -> bool:
    """Whether a setting and its control meet the claim; where one value suffices, with the same one."""
    return bool(p.holds and q.holds and (not p.met_at or set(p.met_at) & set(q.met_at)))


def split_by_solver(claim: given.Claim, rows: Sequence[Sequence[Point]]) -> dict[str, Finding]:
    """The finding on these settings for each solver, where there are several.

    What hangs on one failed run is said of all of them together: of a part it would contradict the whole.
    """
    own: dict[str, list[Sequence[Point]]] = {}
    for row in rows:
        own.setdefault(row[0].places[0].spec.solver, []).append(row)
    if len(own) < 2:
        return {}
    hangs = any(m.gap is Gap.HANGS for m in find(claim, rows, True, False).missing)
    return {name: find(claim, own[name], True, True, hangs=hangs) for name in sorted(own)}


def split_sides(rows: Sequence[Sequence[Point]]) -> tuple[list[Sequence[Point]], list[Sequence[Point]]]:
    """The settings that the paper prints, and the others; one whose series is that of a printed one is among these."""
    printed = [row for row in rows if any(p.printed for p in row)]
    return printed, [row for row in rows if not any(p.printed for p in row)]


def _first_side(rows: Sequence[Sequence[Point]]) -> list[Sequence[Point]]:
    """The rows that the paper prints, else all."""
    return split_sides(rows)[0] or list(rows)


def merge_equal(claim: given.Claim, found: Sequence[Point]) -> list[list[Point]]:
    """Settings of equal series, or whose numbers are those of one problem, together: the first stands for all."""
    out: dict[object, list[Point]] = {}
    identity = all(MEASURES[t.metric].of_problem for t in claim.tests)
    for k, p in enumerate(found):
        key: object = (p.series, repr(p.numbers), p.holds, p.left_out) if p.series else k
        key = (p.places[0].spec.problem, p.holds, p.left_out) if identity else key
        out.setdefault(key, []).append(p)
    return list(out.values())


def find_sides(
    claim: given.Claim, rows: Sequence[Sequence[Point]], decide: bool = True, explain: bool = True
) -> tuple[Finding | None, Finding | None]:
    """At the settings that the paper prints, and at the others; a row of which one is printed is at the paper's."""
    sides = (find(claim, side, decide, explain) if side else None for side in split_sides(rows))
    return tuple(sides)  # type: ignore[return-value]


def find(
    claim: given.Claim, rows: Sequence[Sequence[Point]], decide: bool, explain: bool, *, hangs: bool = True
) -> Finding:
    """Count the settings that hold, and conclude; ``explain``: name the choices with which they do.

    ``hangs``: conclude nothing where the verdict hangs on one run that failed.
    """
    counted, lone = _set_back([row for row in rows if row[0].holds is not None])
    holding = [row for row in counted if row[0].holds]
    own = [[p for p in row if p.printed] or row for row in counted]  # a printed setting is not told by others like it
    every = [p for row in own for p in row]
    left = Counter(row[0].left_out for row in rows if row[0].holds is None)
    verdict = _verdict(claim, len(holding), len(counted)) if decide else Verdict.CANNOT_BE_TOLD
    missing = _doubts(claim, [row[0] for row in counted], left) if decide else []
    missing = [m for m in missing if hangs or m.gap is not Gap.HANGS]
    values = {q.dimensions[claim.across] for row in rows for p in row for q in p.places} if _one_suffices(claim) else ()
    met = {v for p in every for v in p.met_at}
    some = bool(values) and any(len(set(row[0].met_at)) < len(values) for row in counted)
    why = None
    if missing:
        verdict = Verdict.CANNOT_BE_TOLD
    elif verdict is Verdict.REPRODUCED and some:
        verdict = Verdict.REPRODUCED_IF
        shared = set.intersection(*(set(row[0].met_at) for row in counted))
        why = decide_along(claim.across, tuple(shared), values_of(values)) if shared else None
    divided = claim.quantifier == "some" and verdict is Verdict.REPRODUCED and len(holding) < len(counted)
    if (verdict is Verdict.REPRODUCED_IF or divided) and explain and why is None:
        why = decision(_spread_along(claim, every) if some else dimensions_of(claim, every))
    return Finding(
        verdict, len(holding), len(counted), len(every), sum(row[0].stopped for row in holding), why, (),
        tuple(LeftOut(how, left[how]) for how in Ending if left[how]),
        (len(met), len(values)) if values else None, tuple(missing), sum(map(len, counted)) - len(every), lone,
    )  # fmt: skip


def _set_back(counted: Sequence[Sequence[Point]]) -> tuple[list[Sequence[Point]], int]:
    """The settings with those that one failed run alone meets as not met, if others hold; and how many these are."""
    lone = [bool(row[0].holds and row[0].failed and row[0].met_at) for row in counted]
    if not any(row[0].holds and not alone for row, alone in zip(counted, lone, strict=True)):
        return list(counted), 0
    return [_not_met(row) if alone else row for row, alone in zip(counted, lone, strict=True)], sum(lone)


def _not_met(row: Sequence[Point]) -> list[Point]:
    """The same settings where nothing meets the claim, whether or not the failed run counts."""
    return [replace_point(p, holds=False, met_at=(), failed=False) for p in row]


def _one_suffices(claim: given.Claim) -> bool:
    return any(t.combine == NEAREST for t in claim.tests)


def _verdict(claim: given.Claim, holding: int, counted: int) -> Verdict:
    """The verdict on some settings: for all of them, for some, which are to be named, or for none."""
    if not counted:
        return Verdict.CANNOT_BE_TOLD
    if holding == counted or (holding and claim.quantifier == "some"):
        return Verdict.REPRODUCED
    return Verdict.REPRODUCED_IF if holding else Verdict.NOT_REPRODUCED


def _doubts(claim: given.Claim, counted: Sequence[Point], left: Mapping[Ending, int]) -> list[Missing]:
    """Reasons why a count settles nothing: most runs ended before, or the verdict hangs on one run that failed."""
    asked = len(counted) + sum(left[how] for how in CUT)
    if counted and len(counted) < FEW * asked:
        return [Missing(Gap.REACHED, found=len(counted), wanted=asked)]
    holding, total = sum(p.holds is True for p in counted), len(counted)
    if total == 1 and counted[0].failed and any(left.values()):  # one failed run is all that is left of several
        return [Missing(Gap.HANGS, counted[0].places[0].spec.case)]
    for p in counted:
        rest = total if p.met_at else total - 1  # one of several values less leaves the setting, but nothing meets it
        without = _verdict(claim, holding - bool(p.holds), rest)
        if p.failed and rest and without is not _verdict(claim, holding, total):
            return [Missing(Gap.HANGS, p.places[0].spec.case)]
    return []


def dimensions_of(claim: given.Claim, points: Sequence[Point]) -> list[tuple[Mapping[str, Value], bool]]:
    """Those that some run chose: defaults differ between problems and solvers, and would stand for these."""
    chosen = find_chosen(q for p in points for q in p.places) - {claim.across}
    return [({k: v for k, v in p.places[0].dimensions.items() if k in chosen}, p.holds is True) for p in points]


def _spread_along(claim: given.Claim, points: Sequence[Point]) -> list[tuple[Mapping[str, Value], bool]]:
    """Each setting with each value along ``across``, and whether that one meets the claim."""
    at = dimensions_of(claim, points)
    return [
        ({**own, claim.across: value}, value in p.met_at)
        for (own, _), p in zip(at, points, strict=True)
        for value in values_of(q.dimensions[claim.across] for q in p.places)
    ]


def find_chosen(places: Iterable[Place]) -> set[str]:
    """The dimensions that some run chose, and problem and solver."""
    return {"problem", "solver"}.union(*(p.dimensions.keys() - p.usual for p in places))
