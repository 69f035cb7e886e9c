"""Conclude on the settings of a claim: at those that the paper prints and the others, by solver, and of a control.

Settings are counted in rows: a row holds settings of equal series, which count once, and its first represents it.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

from msgspec.structs import replace as change

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
from .bands import SPREADS
from .conditions import decide_along, find_decision
from .frame import TriedRun, find_chosen, list_values
from .register import Claim
from .settings import Setting, find_settings, is_comparable_control, leave_open

CUT = (Ending.MACHINE, Ending.SLOW, Ending.APART, Ending.EARLY)  # a run ended before the time of the claim
FEW = 0.1  # fraction of the settings: if fewer reached that time, they settle nothing
Row = Sequence[Setting]
Sides = tuple[ClaimFinding | None, ClaimFinding | None]  # at the settings that the paper prints, and at the others


def ask_control(
    claim: Claim, rows: Sequence[Row], others: Sequence[TriedRun], controls: Sequence[TriedRun]
) -> tuple[Control | None, dict[Setting, Setting]]:
    """Return the finding on the claim's control, and the setting of the control that belongs to each setting.

    ``others`` are the runs that the claim's are compared with, ``controls`` those of its control. The finding is on the
    settings that the paper prints or, without any, on all; it is None if none of them has a control. Settings without
    a comparable control are not in the second result.
    """
    asked: dict[tuple[object, ...], list[Setting]] = {}  # by the values along ``across`` of a setting
    beside = {}
    for s in (s for row in rows for s in row):
        along = _list_along(claim, s)
        if along not in asked:
            asked[along] = _judge_control(claim, along, others, controls)
        found = [q for q in asked[along] if is_comparable_control(claim, s.runs[0], q.runs[0])]
        if found:
            beside[s] = min(found, key=lambda q: q.holds is None)
    first = split_sides(rows)[0] or rows
    used = list(dict.fromkeys(beside[s] for row in first for s in row if s in beside))
    if not used:
        return None, beside
    both = alone = 0
    for row in first:
        pairs = [(s, q) for s in row if (q := beside.get(s)) and q.holds is not None]
        # at the same value, if one value suffices
        both += any(s.holds and q.holds and (not s.met_at or set(s.met_at) & set(q.met_at)) for s, q in pairs)
        alone += bool(row[0].holds and not pairs)
    finding = conclude(claim, merge_equal(claim, used))
    return Control(tuple(list_values(p.spec.solver for p in controls)), finding, both, alone), beside


def _list_along(claim: Claim, s: Setting) -> tuple[object, ...]:
    """Return a setting's values of the dimension that the claim looks ``across``; empty for a claim without one."""
    return tuple(list_values(q.dimensions[claim.across] for q in s.runs)) if claim.across else ()


def _judge_control(
    claim: Claim, along: tuple[object, ...], others: Sequence[TriedRun], controls: Sequence[TriedRun]
) -> list[Setting]:
    """Return the judged settings of the control's runs that have exactly the values ``along`` of ``across``.

    ``others`` are the runs that they are compared with. A spread over runs of equal series is left open: the dimension
    had no effect on them.
    """
    own = [q for q in controls if not along or q.dimensions.get(claim.across) in along]
    out = []
    for s in find_settings(change(claim, map=claim.control), own, others):
        if _list_along(claim, s) == along:
            series = {p.record.series_sha256 for p in s.runs}
            still = len(series) == 1 and all(series) and any(t.combine in SPREADS for t in claim.tests)
            out.append(leave_open(s) if still else s)
    return out


def split_by_solver(claim: Claim, rows: Sequence[Row]) -> dict[str, ClaimFinding]:
    """Return the finding on these settings for each solver, by name; empty unless there are several solvers.

    A verdict that depends on one failed run is left open only if that of all solvers together depends on one, too.
    """
    own: dict[str, list[Row]] = {}
    for row in rows:
        own.setdefault(row[0].solver, []).append(row)
    if len(own) < 2:
        return {}
    hangs = any(m.gap is ClaimGap.HANGS for m in conclude(claim, rows, explain=False).missing)
    return {name: conclude(claim, own[name], hangs=hangs) for name in sorted(own)}


def split_sides(rows: Sequence[Row]) -> tuple[list[Row], list[Row]]:
    """Split rows into those with settings that the paper prints and the others."""
    printed = [row for row in rows if any(s.printed for s in row)]
    return printed, [row for row in rows if not any(s.printed for s in row)]


def merge_equal(claim: Claim, found: Sequence[Setting]) -> list[list[Setting]]:
    """Return settings in rows that count once each: a row has those of equal series, numbers and outcome.

    If all tests measure the problem alone, a row has the settings of one problem with the same outcome. A setting of
    which a series is missing has a row of its own.
    """
    out: dict[object, list[Setting]] = {}
    for k, s in enumerate(found):
        equal: object = (s.series, repr(s.numbers), s.holds, s.left_out) if s.series else k
        out.setdefault((s.runs[0].spec.problem, s.holds, s.left_out) if claim.is_of_problem else equal, []).append(s)
    return list(out.values())


def find_sides(claim: Claim, rows: Sequence[Row], *, decide: bool = True, explain: bool = True) -> Sides:
    """Return the findings at the settings that the paper prints and at the others; None for a side without settings."""
    printed, rest = (conclude(claim, r, decide=decide, explain=explain) if r else None for r in split_sides(rows))
    return printed, rest


def conclude(
    claim: Claim, rows: Sequence[Row], *, decide: bool = True, explain: bool = True, hangs: bool = True
) -> ClaimFinding:
    """Count the settings where the claim holds, and return the finding with the verdict.

    Without ``decide`` the verdict is left open, as for an incomplete map. With ``explain`` it
    names the choices with which the claim holds. With ``hangs`` a verdict that depends on one failed run is left open.
    """
    counted, lone = _set_aside_lone([row for row in rows if row[0].holds is not None])
    representatives = [row[0] for row in counted]
    holding = [s for s in representatives if s.holds]
    # a printed setting is represented by itself, not by equal ones
    settings = [s for row in counted for s in ([s for s in row if s.printed] or row)]
    left_open = Counter(row[0].left_out for row in rows if row[0].holds is None)
    verdict, why = ClaimVerdict.CANNOT_BE_TOLD, None
    doubts = _list_doubts(claim, representatives, left_open) if decide else []
    missing = [m for m in doubts if hangs or m.gap is not ClaimGap.HANGS]
    dimension = claim.across if claim.one_suffices else ""
    tried = {q.dimensions[dimension] for row in rows for s in row for q in s.runs} if dimension else set()
    only_some_values = any(len(set(s.met_at)) < len(tried) for s in representatives)
    if decide and not missing:
        verdict = _count_verdict(claim, len(holding), len(representatives))
        if verdict is ClaimVerdict.REPRODUCED and only_some_values:
            verdict = ClaimVerdict.REPRODUCED_IF
            shared = set.intersection(*(set(s.met_at) for s in representatives))
            why = decide_along(dimension, shared, tried) if shared else None
        # "some" is met, though not by all
        divided = verdict is ClaimVerdict.REPRODUCED and len(holding) < len(representatives)
        if (verdict is ClaimVerdict.REPRODUCED_IF or divided) and explain and why is None:
            why = find_decision((_spread_along if only_some_values else list_dimensions)(claim, settings))
    return ClaimFinding(
        verdict,
        holds=len(holding),
        settings=len(counted),
        rows=len(settings),
        stopped=sum(s.stopped for s in holding),
        decision=why,
        left_out=tuple(ExcludedSettings(how, left_open[how]) for how in Ending if left_open[how]),
        met=(len({v for s in settings for v in s.met_at}), len(tried)) if tried else None,
        missing=tuple(missing),
        like=sum(map(len, counted)) - len(settings),
        lone=lone,
    )


def _set_aside_lone(counted: Sequence[Row]) -> tuple[list[Row], int]:
    """Return the rows with those that meet the claim by one failed run alone set to "not met", and the number of these.

    If no other row meets the claim, all rows are returned unchanged, with 0.
    """
    lone = [bool(row[0].holds and row[0].failed and row[0].met_at) for row in counted]
    if sum(lone) == sum(bool(row[0].holds) for row in counted):
        return list(counted), 0
    out = [
        [replace(s, holds=False, met_at=(), failed=False) for s in row] if alone else row
        for row, alone in zip(counted, lone, strict=True)
    ]
    return out, sum(lone)


def _count_verdict(claim: Claim, holding: int, counted: int) -> ClaimVerdict:
    """Return the verdict if ``holding`` of ``counted`` settings meet the claim: all, some or none of them.

    With the quantifier "some" one setting that meets it suffices; with no setting counted the verdict is unknown.
    """
    if not counted:
        return ClaimVerdict.CANNOT_BE_TOLD
    if holding == counted or (holding and claim.quantifier == "some"):
        return ClaimVerdict.REPRODUCED
    return ClaimVerdict.REPRODUCED_IF if holding else ClaimVerdict.NOT_REPRODUCED


def _list_doubts(claim: Claim, counted: Sequence[Setting], left: Mapping[Ending, int]) -> list[MissingReason]:
    """Return the reason, as a list of at most one, why a count decides nothing.

    Either most runs ended early, or the verdict depends on one failed run. ``counted`` are the settings that count,
    ``left`` the numbers of those left out, by how their runs ended.
    """
    asked = len(counted) + sum(left[how] for how in CUT)
    if counted and len(counted) < FEW * asked:
        return [MissingReason(ClaimGap.REACHED, found=len(counted), wanted=asked)]
    holding, total = sum(s.holds is True for s in counted), len(counted)
    for s in counted:
        rest = total if s.met_at else total - 1  # without one of several values the setting remains, but is not met
        without = _count_verdict(claim, holding - bool(s.holds), rest)
        last = total == 1 and any(left.values())  # only one failed run is left of several
        if s.failed and (last or (rest and without is not _count_verdict(claim, holding, total))):
            return [MissingReason(ClaimGap.HANGS, s.runs[0].spec.case)]
    return []


def list_dimensions(claim: Claim, found: Sequence[Setting]) -> list[tuple[Mapping[str, Value], bool]]:
    """Return each setting as the values of the dimensions that some run sets, and whether the claim holds there.

    Dimensions at their defaults in all runs are left out, and so are options of a solver that all of its own runs leave
    at their defaults: they are no choices. The dimension ``across`` is left out, too.
    """
    runs = [q for s in found for q in s.runs]
    chosen = find_chosen(runs) - {claim.across}
    own = {name: find_chosen(q for q in runs if q.spec.solver == name) for name in {q.spec.solver for q in runs}}
    at = [(s.runs[0].dimensions, chosen - (s.runs[0].options - own[s.solver]), s.holds is True) for s in found]
    return [({k: v for k, v in dimensions.items() if k in names}, holds) for dimensions, names, holds in at]


def _spread_along(claim: Claim, found: Sequence[Setting]) -> list[tuple[Mapping[str, Value], bool]]:
    """Return each setting once for each of its values along ``across``, and whether that value meets the claim."""
    return [
        ({**own, claim.across: value}, value in s.met_at)
        for (own, _), s in zip(list_dimensions(claim, found), found, strict=True)
        for value in list_values(q.dimensions[claim.across] for q in s.runs)
    ]
