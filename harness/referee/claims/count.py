"""From the register, the runs of the suite and the records to verdicts with their evidence.

Two verdicts a claim: at the settings that the paper prints, and at the others. Pure: the same records in any order give
the same verdicts. No clock time enters. Settings whose runs settle nothing are left out of the count and named (module
points); those whose runs have the same series count once.
"""

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

from msgspec.structs import replace

from ...catalogue import registry
from ...results.judgements.claims import (
    Because,
    Claim,
    Count,
    Ending,
    Finding,
    Gap,
    LeftOut,
    MapRow,
    Missing,
    Moved,
    Test,
    Value,
    Verdict,
)
from ...results.naming import text_of
from ...results.records import COLUMNS, RunRecord
from ...suites.spec import RunSpec
from . import register as given
from .conditions import decide_along, decision, factors
from .evidence import MEASURES
from .maps import Place, find_varied, place, select, values_of
from .numbers import Numbers, SeriesOf, shorten
from .points import Point, points
from .predicates import FACTOR, NEAREST, RATIOS, Band
from .register import Register

CUT = (Ending.MACHINE, Ending.SLOW, Ending.EARLY)  # a run ended before the moment asked about
FEW = 0.1  # of the settings asked: fewer that got to that moment settle nothing
COUNTS = {c.name for c in COLUMNS if c.type is int}
SHOWN = (
    "tolerance", "gain", "form", "chart", "lambda_in_error_test", "consistent_start", "frame", "gauge", "sigma0",
)  # fmt: skip


def judge(
    register: Register, specs: Iterable[RunSpec], records: Iterable[RunRecord], series_of: SeriesOf
) -> tuple[Claim, ...]:
    """All verdicts, in the order of the register."""
    places = [place(c) for c in specs]
    tried = {c.id: _select_tried(c, places) for c in register.claims}
    wanted = ((p.spec.settings_id, t) for c in register.claims for own in tried[c.id] for p in own for t in c.tests)
    numbers = Numbers({r.settings_id: r for r in records}, series_of, wanted)
    return tuple(_judge_claim(c, register, *tried[c.id], numbers) for c in register.claims)


def find_needs(claim: given.Claim) -> list[Missing]:
    """Needs of the claim that are not at hand."""
    out = []
    for need in claim.needs:
        problem, _, name = need.observable.partition(".")
        observables = registry.make_problem(problem, {}).observables if problem else ()
        if need.solver not in registry.solvers() and all(o.name != name for o in observables):
            out.append(Missing(Gap.NEED, need.why))
    return out


def _select_tried(claim: given.Claim, places: Sequence[Place]) -> tuple[tuple[Place, ...], tuple[Place, ...]]:
    own = select(places, claim.map.over) if claim.map else ()
    return own, select(places, claim.against.over) if claim.against else ()


def _judge_claim(
    claim: given.Claim, register: Register, own: tuple[Place, ...], others: tuple[Place, ...], numbers: Numbers
) -> Claim:
    missing = find_needs(claim) or _find_gaps(claim, own, others, numbers.records)
    found = [] if missing else points(claim, own, others, numbers)
    counted = [p for p in found if p.holds is not None]
    missing = missing or _find_unmeasured(claim, found, counted)
    rows = _merge_equal(claim, found)
    paper, beyond = _findings(claim, rows, decide=not missing)
    if not missing:
        end = max(numbers.records[p.spec.settings_id].t_end_s for p in own)
        paper, beyond = _borderline(claim, (paper, beyond), lambda c: points(c, own, others, numbers), end)
    elif not (paper or beyond):
        paper, beyond = (Finding(Verdict.CANNOT_BE_TOLD),) * 2 if claim.map and claim.map.printed else (
            None, Finding(Verdict.CANNOT_BE_TOLD))  # fmt: skip
    twins = {p.places[0].spec.settings_id for row in rows for p in row[1:]}
    shown = _choose_shown(claim, counted)
    values = [v for v in (p.numbers[0] for p in counted) if v == v] or ([math.nan] if counted else [])
    return Claim(
        claim.id, claim.kind, claim.section, claim.figure, claim.quote, claim.claim,
        paper, beyond,
        tests=tuple(_test(t, shown, k) for k, t in enumerate(claim.tests)),
        measured_range=(shorten(min(values)), shorten(max(values))) if values else (),
        because=_because(register, found, claim.across), missing=tuple(missing), caveats=claim.caveats,
        settings=_settings(own, others), against=tuple(dict.fromkeys(p.spec.case for p in others)),
        settings_ids=tuple(p.spec.settings_id for p in (*own, *others)),
        factors=factors(_dimensions(claim, counted)) if counted else {},
        map=tuple(_row(claim, p, numbers.records, twins) for p in found),
    )  # fmt: skip


def _find_gaps(
    claim: given.Claim, own: Sequence[Place], others: Sequence[Place], records: Mapping[str, RunRecord]
) -> list[Missing]:
    """Runs or values that the map should have: a map with holes decides nothing."""
    out = []
    for m, places in ((claim.map, own), (claim.against, others)):
        if m is None:
            continue
        for name, wanted in m.dimensions.items():
            found = len(values_of(p.dimensions.get(name) for p in places))
            if found < wanted:
                out.append(Missing(Gap.VALUES, name, m.name, found, wanted))
        absent = [p for p in places if p.spec.settings_id not in records]
        if absent or not places:
            first = absent[0].spec.case if absent else ""
            out.append(Missing(Gap.RUNS, first, m.name, len(places) - len(absent), len(places)))
    return out


def _find_unmeasured(claim: given.Claim, found: Sequence[Point], counted: Sequence[Point]) -> list[Missing]:
    """Numbers that no run of the map has: a number that nowhere exists refutes nothing."""
    if not counted:
        return [Missing(Gap.SETTLED) if found else Missing(Gap.GROUPS, claim.across)]
    absent = [t for k, t in enumerate(claim.tests) if all(math.isnan(p.numbers[k]) for p in counted)]
    return [Missing(Gap.NUMBER, t.metric) for t in absent]


def _choose_shown(claim: given.Claim, counted: Sequence[Point]) -> Point | None:
    """The setting whose numbers stand in the table: the first printed one, else the one that speaks most against it."""
    measurable = [p for p in counted if p.numbers[0] == p.numbers[0]] or list(counted)
    printed = next((p for p in measurable if p.printed), None)
    against = max(measurable, key=lambda p: (not p.holds, claim.tests[0].band.beyond(p.numbers[0])), default=None)
    return printed or against


def _merge_equal(claim: given.Claim, found: Sequence[Point]) -> list[list[Point]]:
    """Settings of equal series, or whose numbers are those of one problem, together: the first stands for all."""
    out: dict[object, list[Point]] = {}
    identity = all(MEASURES[t.metric].of_problem for t in claim.tests)
    for k, p in enumerate(found):
        key: object = (p.series, repr(p.numbers), p.holds, p.left_out) if p.series else k
        key = (p.places[0].spec.problem, p.holds, p.left_out) if identity else key
        out.setdefault(key, []).append(p)
    return list(out.values())


def _findings(
    claim: given.Claim, rows: Sequence[Sequence[Point]], decide: bool = True, explain: bool = True
) -> tuple[Finding | None, Finding | None]:
    """At the settings that the paper prints, and at the others; a row of which one is printed is at the paper's."""
    sides = [[row for row in rows if any(p.printed for p in row) is side] for side in (True, False)]
    return tuple(_finding(claim, side, decide, explain) if side else None for side in sides)  # type: ignore[return-value]


def _finding(claim: given.Claim, rows: Sequence[Sequence[Point]], decide: bool, explain: bool) -> Finding:
    counted = [row for row in rows if row[0].holds is not None]
    holding = [row for row in counted if row[0].holds]
    every = [p for row in counted for p in row]
    left = Counter(row[0].left_out for row in rows if row[0].holds is None)
    verdict = _verdict(claim, len(holding), len(counted)) if decide else Verdict.CANNOT_BE_TOLD
    missing = _doubts(claim, [row[0] for row in counted], left) if decide else []
    values = {q.dimensions[claim.across] for row in rows for p in row for q in p.places} if _one_suffices(claim) else ()
    met = {v for p in every for v in p.met_at}
    why = None
    if missing:
        verdict = Verdict.CANNOT_BE_TOLD
    elif verdict is Verdict.REPRODUCED_IF and explain:
        why = decision(_dimensions(claim, every))
    elif verdict is Verdict.REPRODUCED and any(len(set(row[0].met_at)) < len(values) for row in counted):
        verdict, why = Verdict.REPRODUCED_IF, decide_along(claim.across, tuple(met), values_of(values))
    return Finding(
        verdict, len(holding), len(counted), len(every), sum(row[0].stopped for row in holding), why, (),
        tuple(LeftOut(how, left[how]) for how in Ending if left[how]),
        (len(met), len(values)) if values else None, tuple(missing),
    )  # fmt: skip


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
    for p in counted:
        rest = total if p.met_at else total - 1  # one of several values less leaves the setting, but nothing meets it
        without = _verdict(claim, holding - bool(p.holds), rest)
        if p.failed and rest and without is not _verdict(claim, holding, total):
            return [Missing(Gap.HANGS, p.places[0].spec.case)]
    return []


def _move(test: given.Test, factor: float, end: float) -> Band:
    """Its band wider by a factor; ``end`` is that of the longest run."""
    natural = MEASURES[test.metric].natural
    if natural == "firm" or (test.metric == "column" and test.arguments["name"] in COUNTS):
        return test.band  # a count, or an end reached
    is_ratio = natural == "one" or test.combine in RATIOS or test.compare in ("over largest", "over smallest")
    return test.band.move(factor, is_ratio=is_ratio, end=end if natural == "end" else math.inf)


def _borderline(
    claim: given.Claim, sides: Sequence[Finding | None], tried: Callable[[given.Claim], Sequence[Point]], end: float
) -> tuple[Finding | None, Finding | None]:
    """The findings with the verdicts that they flip to when the band of one test moves by a factor."""
    flips: tuple[list[Moved], list[Moved]] = [], []
    for k, test in enumerate(claim.tests):
        for by, factor in (("wider", FACTOR), ("narrower", 1.0 / FACTOR)):
            band = _move(test, factor, end)
            if band == test.band:
                continue
            moved = replace(test, at_least=band.low, at_most=band.high)
            other = replace(claim, tests=(*claim.tests[:k], moved, *claim.tests[k + 1 :]))
            for old, new, out in zip(
                sides, _findings(other, _merge_equal(other, tried(other)), explain=False), flips, strict=True
            ):
                verdicts = {f.verdict for f in (old, new) if f} - {Verdict.CANNOT_BE_TOLD}
                if new and len(verdicts) == 2:
                    out.append(Moved(k, by, new.verdict, new.holds, new.settings))  # type: ignore[arg-type]
    paper, beyond = (replace(f, borderline=tuple(m)) if f else None for f, m in zip(sides, flips, strict=True))
    return paper, beyond


def _dimensions(claim: given.Claim, points: Sequence[Point]) -> list[tuple[Mapping[str, Value], bool]]:
    """Those that some run chose: defaults differ between problems and solvers, and would stand for these."""
    chosen = _find_chosen(q for p in points for q in p.places) - {claim.across}
    return [({k: v for k, v in p.places[0].dimensions.items() if k in chosen}, p.holds is True) for p in points]


def _find_chosen(places: Iterable[Place]) -> set[str]:
    return {"problem", "solver"}.union(*(p.dimensions.keys() - p.usual for p in places))


def _because(register: Register, found: Sequence[Point], across: str) -> Because:
    holding = [p for p in found if p.holds]
    met = Counter(v for p in holding for v in p.met_at)
    solvers = values_of(q.dimensions["solver"] for p in found for q in p.places)
    stand_ins = tuple(register.solvers[s] for s in solvers if s in register.solvers)
    return Because(across, tuple(Count(v, met[v], len(holding)) for v in values_of(met)), stand_ins)


def _settings(own: Sequence[Place], others: Sequence[Place]) -> dict[str, tuple[Value, ...]]:
    if not (places := [*own, *others]):
        return {}
    out = {k: tuple(values_of(p.dimensions[k] for p in places)) for k in ("problem", "solver")}
    chosen = _find_chosen(own) - out.keys()
    rest = {k: v for k, v in find_varied([p.dimensions for p in own]).items() if k in chosen}
    return out | {k: tuple(text_of(x) if isinstance(x, list | tuple) else x for x in v) for k, v in rest.items()}


def _test(test: given.Test, shown: Point | None, k: int) -> Test:
    number = shown.numbers[k] if shown else math.nan
    low, high = (v if math.isfinite(v) else None for v in (test.at_least, test.at_most))
    return Test(test.metric, test.arguments, test.combine, test.compare, test.unit, (low, high),
                shorten(number), number == math.inf)  # fmt: skip


def _row(claim: given.Claim, p: Point, records: Mapping[str, RunRecord], twins: Collection[str]) -> MapRow:
    first = p.places[0]
    at = {k: first.dimensions[k] for k in SHOWN if k in first.dimensions and k != claim.across}
    settings_id = first.spec.settings_id
    return MapRow(settings_id, first.spec.case, len(p.places) - 1, at, p.holds, shorten(p.numbers[0]),
                  records[settings_id].status, p.printed, settings_id in twins)  # fmt: skip
