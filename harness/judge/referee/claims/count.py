"""Derive verdicts with their evidence from the register, the runs of the suite and the records.

A claim has two verdicts: at the settings that the paper prints, and at the others. The result does not depend on the
order of records or on clock time. Settings whose runs settle nothing are left out of the count and named (module
points); settings whose runs have the same series count once.
"""

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

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
from . import register as given
from .conditions import factors
from .evidence import MEASURES
from .findings import (
    RunsOfClaim,
    ask_control,
    find_chosen,
    find_sides,
    list_dimensions,
    merge_equal,
    split_by_solver,
    split_sides,
)
from .maps import PlacedRun, find_varied, list_values, read_dimensions
from .numbers import RunNumbers, SeriesOf, shorten
from .points import Point, points
from .predicates import BEST, FACTOR, RATIOS, Band, take_best
from .register import Register

EITHER_WAY = ("jacobian", "norm")  # the kind of classical code that a run represents depends on these
COUNTS = {c.name for c in COLUMNS if c.type is int}  # columns whose bands no factor moves
SHOWN = (  # dimensions that a row of a map shows
    "tolerance",
    "gain",
    "form",
    "chart",
    "lambda_in_error_test",
    "consistent_start",
    "frame",
    "gauge",
    "sigma0",
)


def judge(
    register: Register, specs: Iterable[RunSpec], records: Iterable[RunRecord], series_of: SeriesOf
) -> tuple[JudgedClaim, ...]:
    """Return the verdicts on all claims, in the order of the register.

    ``specs`` are the runs that claims may be tried on, ``series_of`` returns the series of a record's run.
    """
    places = [read_dimensions(c) for c in specs]
    tried = {c.id: RunsOfClaim.select(c, places) for c in register.claims}
    wanted = ((p.spec.settings_id, t) for c in register.claims for own in tried[c.id] for p in own for t in c.tests)
    numbers = RunNumbers({r.settings_id: r for r in records}, series_of, wanted)
    return tuple(_judge_claim(c, register, tried[c.id], numbers) for c in register.claims)


def find_needs(claim: given.Claim) -> list[MissingReason]:
    """Return why a claim cannot be tested here: solvers, observables or data that it needs and that are missing."""
    out = []
    for need in claim.needs:
        problem, _, name = need.observable.partition(".")
        observables = registry.make_problem(problem, {}).observables if problem else ()
        if need.solver not in registry.solvers() and all(o.name != name for o in observables):
            out.append(MissingReason(ClaimGap.NEED, need.why))
    return out


def _judge_claim(claim: given.Claim, register: Register, tried: RunsOfClaim, numbers: RunNumbers) -> JudgedClaim:
    """Return a claim with its verdicts, evidence and map, or with what is missing to judge it."""
    own, others, _ = tried
    missing = find_needs(claim) or _find_gaps(claim, tried, numbers.records)
    found = [] if missing else points(claim, own, others, numbers)
    counted = [p for p in found if p.holds is not None]
    missing = missing or _find_unmeasured(claim, found, counted)
    rows = merge_equal(claim, found)
    paper, beyond = find_sides(claim, rows, decide=not missing)
    control, beside = (None, {}) if missing or not claim.control else ask_control(claim, rows, tried, numbers)
    if not missing:
        end = max(numbers.records[p.spec.settings_id].t_end_s for p in own)
        paper, beyond = _borderline(claim, (paper, beyond), lambda c: points(c, own, others, numbers), end)
    elif not (paper or beyond):
        paper, beyond = (
            (ClaimFinding(ClaimVerdict.CANNOT_BE_TOLD),) * 2
            if claim.map and claim.map.printed
            else (None, ClaimFinding(ClaimVerdict.CANNOT_BE_TOLD))
        )
    printed, rest = ((), ()) if missing else split_sides(rows)
    by_solver, by_solver_beyond = (split_by_solver(claim, side) for side in (printed or rest, rest if printed else ()))
    twins = {p.places[0].spec.settings_id for row in rows for p in row[1:]}
    shown = _choose_shown(claim, counted)
    values = [v for v in (p.numbers[0] for p in counted) if v == v] or ([math.nan] if counted else [])
    return JudgedClaim(
        claim.id,
        claim.kind,
        claim.section,
        claim.figure,
        claim.quote,
        claim.claim,
        paper,
        beyond,
        tests=tuple(_test(t, shown, k, numbers) for k, t in enumerate(claim.tests)),
        measured_range=(shorten(min(values)), shorten(max(values))) if values else (),
        because=_collect_evidence(register, own, found, claim.across),
        missing=tuple(missing),
        caveats=claim.caveats,
        settings=_settings(counted, own, others),
        against=tuple(dict.fromkeys(p.spec.case for p in others)),
        settings_ids=tuple(p.spec.settings_id for p in (*own, *others)),
        factors=factors(list_dimensions(claim, counted)) if counted else {},
        map=tuple(_row(claim, p, numbers.records, twins, beside.get(id(p))) for p in found),
        by_solver=by_solver,
        control=control,
        summary=claim.summary,
        by_solver_beyond=by_solver_beyond,
    )


def _find_gaps(claim: given.Claim, tried: RunsOfClaim, records: Mapping[str, RunRecord]) -> list[MissingReason]:
    """Return runs or values that the map should have but lacks: an incomplete map decides nothing."""
    out = []
    for m, places in zip((claim.map, claim.against, claim.control), tried, strict=True):
        if m is None:
            continue
        for name, wanted in m.dimensions.items():
            found = len(list_values(p.dimensions.get(name) for p in places))
            if found < wanted:
                out.append(MissingReason(ClaimGap.VALUES, name, m.name, found, wanted))
        absent = [p for p in places if p.spec.settings_id not in records]
        if absent or not places:
            first = absent[0].spec.case if absent else ""
            out.append(MissingReason(ClaimGap.RUNS, first, m.name, len(places) - len(absent), len(places)))
    return out


def _find_unmeasured(claim: given.Claim, found: Sequence[Point], counted: Sequence[Point]) -> list[MissingReason]:
    """Return why the map decides nothing: no setting is decided, or a test has a number for no setting.

    A number that does not exist refutes nothing.
    """
    if not counted:
        return [MissingReason(ClaimGap.SETTLED) if found else MissingReason(ClaimGap.GROUPS, claim.across)]
    absent = [t for k, t in enumerate(claim.tests) if all(math.isnan(p.numbers[k]) for p in counted)]
    return [MissingReason(ClaimGap.NUMBER, t.metric) for t in absent]


def _choose_shown(claim: given.Claim, counted: Sequence[Point]) -> Point | None:
    """Choose the setting whose numbers the table shows: a printed one, if any, that the verdict rests on.

    It is the setting most against the claim; if none meets the claim, or one suffices, the nearest one.
    """
    measurable = [p for p in counted if p.numbers[0] == p.numbers[0]] or list(counted)
    asked = [p for p in measurable if p.printed] or measurable

    def away(p: Point) -> tuple[bool, float]:
        """Return the sort key of a setting, largest for the one most against the claim."""
        return not p.holds, max(t.band.measure_excess(v) for t, v in zip(claim.tests, p.numbers, strict=True))

    def near(p: Point) -> tuple[bool, bool, float]:
        """Return the sort key of a setting, smallest for the one that meets the claim or comes nearest."""
        return not p.holds, any(map(math.isinf, p.numbers)), away(p)[1]

    nearest = claim.quantifier == "some" or not any(p.holds for p in asked)
    return min(asked, key=near, default=None) if nearest else max(asked, key=away, default=None)


def _move(test: given.Test, factor: float, end: float) -> Band:
    """Return the test's band widened by a factor, or narrowed if it is below 1.

    ``end`` [s] is the longest duration of the claim's runs. Bands of counts, and of whether the end was reached, are
    returned unchanged.
    """
    natural = MEASURES[test.metric].natural
    if natural == "firm" or (test.metric == "column" and test.arguments["name"] in COUNTS):
        return test.band  # a count, or whether the end was reached
    is_ratio = natural == "one" or test.combine in RATIOS or test.compare in ("over largest", "over smallest", BEST)
    return test.band.move(factor, is_ratio=is_ratio, end=end if natural == "end" else math.inf)


def _borderline(
    claim: given.Claim,
    sides: Sequence[ClaimFinding | None],
    tried: Callable[[given.Claim], Sequence[Point]],
    end: float,
) -> tuple[ClaimFinding | None, ClaimFinding | None]:
    """Return both findings, with the other verdicts that result if the band of one test moves by a factor.

    ``sides`` are the findings at the paper's settings and beyond; ``tried`` returns the settings of a changed
    claim.
    """
    flips: tuple[list[MovedVerdict], list[MovedVerdict]] = [], []
    for k, test in enumerate(claim.tests):
        for by, factor in (("wider", FACTOR), ("narrower", 1.0 / FACTOR)):
            band = _move(test, factor, end)
            if band == test.band:
                continue
            moved = replace(test, at_least=band.low, at_most=band.high)
            other = replace(claim, tests=(*claim.tests[:k], moved, *claim.tests[k + 1 :]))
            for old, new, out in zip(
                sides, find_sides(other, merge_equal(other, tried(other)), explain=False), flips, strict=True
            ):
                verdicts = {f.verdict for f in (old, new) if f} - {ClaimVerdict.CANNOT_BE_TOLD}
                if new and len(verdicts) == 2:
                    out.append(MovedVerdict(k, by, new.verdict, new.holds, new.settings))  # type: ignore[arg-type]
    paper, beyond = (replace(f, borderline=tuple(m)) if f else None for f, m in zip(sides, flips, strict=True))
    return paper, beyond


def _collect_evidence(
    register: Register, own: Sequence[PlacedRun], found: Sequence[Point], across: str
) -> VerdictEvidence:
    """Return the evidence for a verdict in addition to its counts.

    It holds the values along ``across`` that meet the claim, the solvers that the judged ones represent, and the
    solvers without a judged setting. ``own`` are the runs of the map, ``found`` its settings.
    """
    holding = [p for p in found if p.holds]
    met = Counter(v for p in holding for v in p.met_at)
    judged = list_values(q.spec.solver for p in found if p.holds is not None for q in p.places)
    stand_ins = tuple(register.solvers[s] for s in judged if s in register.solvers)
    unjudged = tuple(list_values(p.spec.solver for p in own if judged and p.spec.solver not in judged))
    return VerdictEvidence(
        across, tuple(SettingsCount(v, met[v], len(holding)) for v in list_values(met)), stand_ins, unjudged
    )


def _settings(
    counted: Sequence[Point], own: Sequence[PlacedRun], others: Sequence[PlacedRun]
) -> dict[str, tuple[Value, ...]]:
    """Return the values of each dimension that some run sets, over the judged settings or, without any, over all.

    The dimensions ``EITHER_WAY`` are listed even if they have one value.
    """
    if counted:
        own, others = ([q for p in counted for q in places(p)] for places in (_places_of, _beside_of))
    if not (places := [*own, *others]):
        return {}
    out = {k: tuple(list_values(p.dimensions[k] for p in places)) for k in ("problem", "solver")}
    chosen = find_chosen(own) - out.keys()
    rest = {k: v for k, v in find_varied([p.dimensions for p in own]).items() if k in chosen}
    either = {k: list_values(p.dimensions[k] for p in own if k in p.dimensions) for k in EITHER_WAY}
    rest = {**rest, **{k: v for k, v in either.items() if v and k not in rest}}
    return out | {k: tuple(format_exactly(x) if isinstance(x, list | tuple) else x for x in v) for k, v in rest.items()}


def _places_of(p: Point) -> tuple[PlacedRun, ...]:
    """Return the runs of a setting."""
    return p.places


def _beside_of(p: Point) -> tuple[PlacedRun, ...]:
    """Return the runs that a setting is compared with."""
    return p.beside


def _test(test: given.Test, shown: Point | None, k: int, numbers: RunNumbers) -> JudgedTest:
    """Return test ``k`` of a claim with its number at the setting that the table shows, NaN without one."""
    number = shown.numbers[k] if shown else math.nan
    low, high = (v if math.isfinite(v) else None for v in (test.at_least, test.at_most))
    return JudgedTest(
        test.metric,
        test.arguments,
        test.combine,
        test.compare,
        test.unit,
        (low, high),
        shorten(number),
        number == math.inf,
        _find_rival(test, shown, numbers),
    )


def _find_rival(test: given.Test, shown: Point | None, numbers: RunNumbers) -> str:
    """Return the case whose number the shown one is compared with.

    It is empty unless the test compares with the smallest or largest number of other runs.
    """
    choose = {"over smallest": min, "over largest": max, "minus largest": max, BEST: max}.get(test.compare)
    if shown is None or choose is None or MEASURES[test.metric].of_pair or not shown.beside:
        return ""
    sizes = {q.spec.case: numbers.evaluate_run(q.spec.settings_id, test) for q in shown.beside}
    known = {case: v for case, v in sizes.items() if not math.isnan(v)}
    if test.compare == BEST:
        best = take_best([q.spec.solver for q in shown.beside], [sizes[q.spec.case] for q in shown.beside])
        known = {case: v for case, v in known.items() if v in best}
    return choose(known, key=lambda case: known[case]) if known else ""


def _row(
    claim: given.Claim, p: Point, records: Mapping[str, RunRecord], twins: Collection[str], control: Point | None
) -> MapRow:
    """Return a setting as a row of the claim's map.

    ``twins`` are the settings_ids whose series equal those of an earlier row; ``control`` is the control's point for
    this setting, if any.
    """
    first = p.places[0]
    at = {k: first.dimensions[k] for k in SHOWN if k in first.dimensions and k != claim.across}
    settings_id = first.spec.settings_id
    return MapRow(
        settings_id,
        first.spec.case,
        len(p.places) - 1,
        at,
        p.holds,
        shorten(p.numbers[0]),
        records[settings_id].status,
        p.printed,
        settings_id in twins,
        *((shorten(control.numbers[0]), control.holds) if control else (math.nan, None)),
        command=write_command(records[settings_id], out="run.npz"),
    )
