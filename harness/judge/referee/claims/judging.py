"""Derive verdicts with their evidence from the register, the runs of the suite and the records.

A claim has two verdicts: at the settings that the paper prints, and at the others. The result does not depend on the
order of records or on clock time. Settings whose runs settle nothing are left out of the count and named (module
settings); settings whose runs have the same series count once.
"""

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Sequence

from msgspec.structs import replace

from ....base.naming import format_exactly
from ....catalogue import registry
from ....catalogue.suites.spec import RunSpec
from ....results.judgements.claims import (
    ClaimFinding,
    ClaimGap,
    ClaimVerdict,
    JudgedClaim,
    JudgedTest,
    MapRow,
    MissingReason,
    MovedVerdict,
    SettingsCount,
    Value,
    VerdictEvidence,
)
from ....results.records import COLUMNS, RunRecord
from ....results.reproduce import write_command
from .bands import BEST, FACTOR, OVER, RATIOS, Band, take_best
from .conditions import count_factors
from .frame import SeriesOf, TriedRun, find_chosen, find_varied, list_values, measure_runs, read_dimensions, select_runs
from .register import Claim, Register, Test
from .settings import Setting, find_settings
from .verdicts import (
    Sides,
    ask_control,
    find_sides,
    list_dimensions,
    merge_equal,
    split_by_solver,
    split_sides,
)

EITHER_WAY = ("jacobian", "norm")  # the kind of classical code that a run represents depends on these
COUNTS = {c.name for c in COLUMNS if c.type is int}  # columns whose bands no factor moves
# dimensions that a row of a map shows
SHOWN = ("tolerance", "gain", "form", "chart", "lambda_in_error_test", "consistent_start", "frame", "gauge", "sigma0")
RIVALS: dict[str, Callable[..., str]] = {"over smallest": min, "over largest": max, "minus largest": max, BEST: max}


def judge_claims(
    register: Register, specs: Iterable[RunSpec], records: Iterable[RunRecord], series_of: SeriesOf
) -> tuple[JudgedClaim, ...]:
    """Return the verdicts on all claims of a register, in its order.

    ``specs`` are the runs that claims may be tried on, ``records`` those of the runs that were made, ``series_of``
    returns the series of a record's run.
    """
    frame = [read_dimensions(c) for c in specs]
    maps = {m.name: m for c in register.claims for m in c.maps if m}
    selected = {name: select_runs(frame, m.over) for name, m in maps.items()}
    tried = [(c, [selected[m.name] if m else () for m in c.maps]) for c in register.claims]
    measured = measure_runs(((p, c.tests) for c, sides in tried for side in sides for p in side), records, series_of)
    runs = [(c, [[measured[p.settings_id] for p in side] for side in sides]) for c, sides in tried]
    return tuple(_judge_claim(c, register, *sides) for c, sides in runs)


def find_needs(claim: Claim) -> list[MissingReason]:
    """Return what a claim needs and the catalogue lacks: solvers, observables, or data that only the authors have."""
    out = []
    for need in claim.needs:
        problem, _, name = need.observable.partition(".")
        observables = registry.make_problem(problem, {}).observables if problem else ()
        if need.solver not in registry.solvers() and all(o.name != name for o in observables):
            out.append(MissingReason(ClaimGap.NEED, need.why))
    return out


def _judge_claim(
    claim: Claim, register: Register, own: Sequence[TriedRun], others: Sequence[TriedRun], controls: Sequence[TriedRun]
) -> JudgedClaim:
    """Return a claim with its verdicts, evidence and map, or with what is missing to judge it.

    ``own`` are its runs, ``others`` those that they are compared with, ``controls`` the runs of its control.
    """
    missing = find_needs(claim) or _find_gaps(claim, (own, others, controls))
    found = [] if missing else find_settings(claim, own, others)
    counted = [s for s in found if s.holds is not None]
    missing = missing or _find_unmeasured(claim, found, counted)
    rows = merge_equal(claim, found)
    sides = find_sides(claim, rows, decide=not missing)
    control, beside = (None, {}) if missing or not claim.control else ask_control(claim, rows, others, controls)
    if not missing:
        sides = _move_bands(claim, sides, own, others)
    elif not any(sides):
        unknown = ClaimFinding(ClaimVerdict.CANNOT_BE_TOLD)
        sides = (unknown if claim.map and claim.map.printed else None), unknown
    printed, rest = ((), ()) if missing else split_sides(rows)
    by_solver, by_solver_beyond = (split_by_solver(claim, side) for side in (printed or rest, rest if printed else ()))
    twins = {s.runs[0].settings_id for row in rows for s in row[1:]}
    shown = _choose_shown(claim, counted)
    values = [v for v in (s.numbers[0] for s in counted) if v == v] or ([math.nan] if counted else [])
    return JudgedClaim(
        claim.id,
        claim.kind,
        claim.section,
        claim.figure,
        claim.quote,
        claim.claim,
        *sides,
        tests=tuple(_describe_test(t, shown, k) for k, t in enumerate(claim.tests)),
        measured_range=(shorten(min(values)), shorten(max(values))) if values else (),
        because=_collect_evidence(register, own, found, claim.across),
        missing=tuple(missing),
        caveats=claim.caveats,
        settings=_list_settings(counted, own, others),
        against=tuple(dict.fromkeys(p.spec.case for p in others)),
        settings_ids=tuple(p.settings_id for p in (*own, *others)),
        factors=count_factors(list_dimensions(claim, counted)) if counted else {},
        map=tuple(_describe_setting(claim, s, twins, beside.get(s)) for s in found),
        by_solver=by_solver,
        control=control,
        summary=claim.summary,
        by_solver_beyond=by_solver_beyond,
    )


def _find_gaps(claim: Claim, tried: Sequence[Sequence[TriedRun]]) -> list[MissingReason]:
    """Return the runs and values of dimensions that the claim's maps should have but lack: then nothing is decided.

    ``tried`` has the runs of each map.
    """
    out = []
    for m, runs in zip(claim.maps, tried, strict=True):
        if m is None:
            continue
        for name, wanted in m.dimensions.items():
            found = len(list_values(p.dimensions.get(name) for p in runs))
            if found < wanted:
                out.append(MissingReason(ClaimGap.VALUES, name, m.name, found, wanted))
        absent = [p for p in runs if not p.record.settings_id]
        if absent or not runs:
            first = absent[0].spec.case if absent else ""
            out.append(MissingReason(ClaimGap.RUNS, first, m.name, len(runs) - len(absent), len(runs)))
    return out


def _find_unmeasured(claim: Claim, found: Sequence[Setting], counted: Sequence[Setting]) -> list[MissingReason]:
    """Return why a complete map decides nothing, if so: no setting counts, or a test has no number in any.

    ``found`` are all settings, ``counted`` those that are not left open.
    """
    if not counted:
        return [MissingReason(ClaimGap.SETTLED) if found else MissingReason(ClaimGap.GROUPS, claim.across)]
    absent = [t for k, t in enumerate(claim.tests) if all(math.isnan(s.numbers[k]) for s in counted)]
    return [MissingReason(ClaimGap.NUMBER, t.metric) for t in absent]


def _choose_shown(claim: Claim, counted: Sequence[Setting]) -> Setting | None:
    """Return the setting whose numbers the table shows, a printed one if there is any; None without settings.

    It is the one farthest outside the bands; if none meets the claim, or one suffices, the one nearest to meeting it.
    """
    measurable = [s for s in counted if s.numbers[0] == s.numbers[0]] or list(counted)
    asked = [s for s in measurable if s.printed] or measurable
    away = {s: max(t.band.measure_excess(v) for t, v in zip(claim.tests, s.numbers, strict=True)) for s in asked}
    if claim.quantifier == "some" or not any(s.holds for s in asked):
        return min(asked, key=lambda s: (not s.holds, any(map(math.isinf, s.numbers)), away[s]), default=None)
    return max(asked, key=lambda s: (not s.holds, away[s]))


def _move_band(test: Test, factor: float, end: float) -> Band:
    """Return the test's band widened by a factor, or narrowed if it is below 1.

    ``end`` [s] is the longest duration of the claim's runs. Bands of counts, and of whether the end was reached, are
    returned unchanged.
    """
    natural = test.measure.natural
    if natural == "firm" or (test.metric == "column" and test.arguments["name"] in COUNTS):
        return test.band
    is_ratio = natural == "one" or test.combine in RATIOS or test.compare in OVER
    return test.band.move(factor, is_ratio=is_ratio, end=end if natural == "end" else math.inf)


def _move_bands(claim: Claim, sides: Sides, own: Sequence[TriedRun], others: Sequence[TriedRun]) -> Sides:
    """Return both findings, each with the other verdicts that result if the band of one test is moved by ``FACTOR``.

    ``own`` and ``others`` are the runs of the claim and those that they are compared with.
    """
    flips: tuple[list[MovedVerdict], list[MovedVerdict]] = [], []
    end = max(p.record.t_end_s for p in own)
    for k, test in enumerate(claim.tests):
        for by, factor in (("wider", FACTOR), ("narrower", 1.0 / FACTOR)):
            band = _move_band(test, factor, end)
            if band == test.band:
                continue
            moved = replace(test, at_least=band.low, at_most=band.high)
            other = replace(claim, tests=(*claim.tests[:k], moved, *claim.tests[k + 1 :]))
            found = find_sides(other, merge_equal(other, find_settings(other, own, others)), explain=False)
            for old, new, out in zip(sides, found, flips, strict=True):
                verdicts = {f.verdict for f in (old, new) if f} - {ClaimVerdict.CANNOT_BE_TOLD}
                if new and len(verdicts) == 2:
                    out.append(MovedVerdict(k, by, new.verdict, new.holds, new.settings))  # type: ignore[arg-type]
    paper, beyond = (replace(f, borderline=tuple(m)) if f else None for f, m in zip(sides, flips, strict=True))
    return paper, beyond


def _collect_evidence(
    register: Register, own: Sequence[TriedRun], found: Sequence[Setting], across: str
) -> VerdictEvidence:
    """Return the evidence for a verdict in addition to its counts.

    It holds the values along ``across`` that meet the claim, the solvers that the judged ones represent, and the
    solvers without a setting that counts. ``own`` are the runs of the map, ``found`` its settings.
    """
    holding = [s for s in found if s.holds]
    met = Counter(v for s in holding for v in s.met_at)
    judged = list_values(q.spec.solver for s in found if s.holds is not None for q in s.runs)
    stand_ins = tuple(register.solvers[name] for name in judged if name in register.solvers)
    unjudged = tuple(list_values(p.spec.solver for p in own if judged and p.spec.solver not in judged))
    along = tuple(SettingsCount(v, met[v], len(holding)) for v in list_values(met))
    return VerdictEvidence(across, along, stand_ins, unjudged)


def _list_settings(
    counted: Sequence[Setting], own: Sequence[TriedRun], others: Sequence[TriedRun]
) -> dict[str, tuple[Value, ...]]:
    """Return the values of each dimension that varies and is set by some run, with problem and solver.

    They are those of the runs in the settings ``counted`` or, without any, of all runs: the claim's ``own`` ones and
    the ``others`` that they are compared with. The dimensions ``EITHER_WAY`` are listed even if they have one value.
    """
    if counted:
        own, others = [q for s in counted for q in s.runs], [q for s in counted for q in s.beside]
    if not (runs := [*own, *others]):
        return {}
    out = {k: tuple(list_values(p.dimensions[k] for p in runs)) for k in ("problem", "solver")}
    chosen = find_chosen(own) - out.keys()
    rest = {k: v for k, v in find_varied([p.dimensions for p in own]).items() if k in chosen}
    either = {k: list_values(p.dimensions[k] for p in own if k in p.dimensions) for k in EITHER_WAY}
    rest |= {k: v for k, v in either.items() if v and k not in rest}
    return out | {k: tuple(format_exactly(x) if isinstance(x, list | tuple) else x for x in v) for k, v in rest.items()}


def _describe_test(test: Test, shown: Setting | None, k: int) -> JudgedTest:
    """Return test ``k`` of a claim with its number at the setting that the table shows, NaN without one."""
    number = shown.numbers[k] if shown else math.nan
    low, high = (v if math.isfinite(v) else None for v in (test.at_least, test.at_most))
    how, rival = (test.arguments, test.combine, test.compare, test.unit), _find_rival(test, shown) if shown else ""
    return JudgedTest(test.metric, *how, (low, high), shorten(number), number == math.inf, rival)


def _find_rival(test: Test, shown: Setting) -> str:
    """Return the case of the other run whose number that of the setting ``shown`` is compared with.

    It is empty unless the test compares with the smallest or largest number of other runs.
    """
    choose = RIVALS.get(test.compare)
    if choose is None or test.measure.of_pair:
        return ""
    sizes = {q.spec.case: q.find_number(test) for q in shown.beside}
    known = {case: v for case, v in sizes.items() if not math.isnan(v)}
    if test.compare == BEST:
        best = take_best([q.spec.solver for q in shown.beside], [sizes[q.spec.case] for q in shown.beside])
        known = {case: v for case, v in known.items() if v in best}
    return choose(known, key=lambda case: known[case]) if known else ""


def _describe_setting(claim: Claim, s: Setting, twins: Collection[str], control: Setting | None) -> MapRow:
    """Return a setting as a row of the claim's map, with the command that makes its first run again.

    ``twins`` are the settings_ids whose series equal those of an earlier row; ``control`` is the control's setting, if
    any.
    """
    first = s.runs[0]
    at = {k: first.dimensions[k] for k in SHOWN if k in first.dimensions and k != claim.across}
    return MapRow(
        first.settings_id,
        first.spec.case,
        more=len(s.runs) - 1,
        at=at,
        holds=s.holds,
        measured=shorten(s.numbers[0]),
        status=first.record.status,
        printed=s.printed,
        twin=first.settings_id in twins,
        control=shorten(control.numbers[0]) if control else math.nan,
        control_holds=control.holds if control else None,
        command=write_command(first.record, out="run.npz"),
    )


def shorten(value: float) -> float:
    """Round to six significant digits, so that machines that differ in the last bits agree; NaN if not finite."""
    return float(f"{value:.6g}") if math.isfinite(value) else math.nan
