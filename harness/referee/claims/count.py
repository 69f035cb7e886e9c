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
    Finding,
    Gap,
    MapRow,
    Missing,
    Moved,
    Test,
    Value,
    Verdict,
)
from ...results.naming import text_of
from ...results.records import COLUMNS, RunRecord
from ...results.reproduce import write_command
from ...suites.spec import RunSpec
from . import register as given
from .conditions import factors
from .evidence import MEASURES
from .findings import (
    Tried,
    ask_control,
    dimensions_of,
    find_chosen,
    find_sides,
    merge_equal,
    split_by_solver,
    split_sides,
)
from .maps import Place, find_varied, place, values_of
from .numbers import Numbers, SeriesOf, shorten
from .points import Point, points
from .predicates import FACTOR, RATIOS, Band
from .register import Register

EITHER_WAY = ("jacobian", "norm")  # what a classical code may be taken for depends on these
COUNTS = {c.name for c in COLUMNS if c.type is int}
SHOWN = (
    "tolerance", "gain", "form", "chart", "lambda_in_error_test", "consistent_start", "frame", "gauge", "sigma0",
)  # fmt: skip


def judge(
    register: Register, specs: Iterable[RunSpec], records: Iterable[RunRecord], series_of: SeriesOf
) -> tuple[Claim, ...]:
    """All verdicts, in the order of the register."""
    places = [place(c) for c in specs]
    tried = {c.id: Tried.of(c, places) for c in register.claims}
    wanted = ((p.spec.settings_id, t) for c in register.claims for own in tried[c.id] for p in own for t in c.tests)
    numbers = Numbers({r.settings_id: r for r in records}, series_of, wanted)
    return tuple(_judge_claim(c, register, tried[c.id], numbers) for c in register.claims)


def find_needs(claim: given.Claim) -> list[Missing]:
    """Needs of the claim that are not at hand."""
    out = []
    for need in claim.needs:
        problem, _, name = need.observable.partition(".")
        observables = registry.make_problem(problem, {}).observables if problem else ()
        if need.solver not in registry.solvers() and all(o.name != name for o in observables):
            out.append(Missing(Gap.NEED, need.why))
    return out


def _judge_claim(claim: given.Claim, register: Register, tried: Tried, numbers: Numbers) -> Claim:
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
        paper, beyond = (Finding(Verdict.CANNOT_BE_TOLD),) * 2 if claim.map and claim.map.printed else (
            None, Finding(Verdict.CANNOT_BE_TOLD))  # fmt: skip
    printed, rest = ((), ()) if missing else split_sides(rows)
    by_solver, by_solver_beyond = (split_by_solver(claim, side) for side in (printed or rest, rest if printed else ()))
    twins = {p.places[0].spec.settings_id for row in rows for p in row[1:]}
    shown = _choose_shown(claim, counted)
    values = [v for v in (p.numbers[0] for p in counted) if v == v] or ([math.nan] if counted else [])
    return Claim(
        claim.id, claim.kind, claim.section, claim.figure, claim.quote, claim.claim,
        paper, beyond,
        tests=tuple(_test(t, shown, k, numbers) for k, t in enumerate(claim.tests)),
        measured_range=(shorten(min(values)), shorten(max(values))) if values else (),
        because=_because(register, own, found, claim.across), missing=tuple(missing), caveats=claim.caveats,
        settings=_settings(counted, own, others), against=tuple(dict.fromkeys(p.spec.case for p in others)),
        settings_ids=tuple(p.spec.settings_id for p in (*own, *others)),
        factors=factors(dimensions_of(claim, counted)) if counted else {},
        map=tuple(_row(claim, p, numbers.records, twins, beside.get(id(p))) for p in found),
        by_solver=by_solver, control=control, summary=claim.summary, by_solver_beyond=by_solver_beyond,
    )  # fmt: skip


def _find_gaps(claim: given.Claim, tried: Tried, records: Mapping[str, RunRecord]) -> list[Missing]:
    """Runs or values that the map should have: a map with holes decides nothing."""
    out = []
    for m, places in zip((claim.map, claim.against, claim.control), tried, strict=True):
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
    """The setting whose numbers stand in the table: of the printed ones, if there are, one that the verdict rests on.

    That is the one that speaks most against the claim; where none meets it, or one suffices, the nearest.
    """
    measurable = [p for p in counted if p.numbers[0] == p.numbers[0]] or list(counted)
    asked = [p for p in measurable if p.printed] or measurable

    def away(p: Point) -> tuple[bool, float]:
        return not p.holds, max(t.band.beyond(v) for t, v in zip(claim.tests, p.numbers, strict=True))

    def near(p: Point) -> tuple[bool, bool, float]:
        return not p.holds, any(map(math.isinf, p.numbers)), away(p)[1]

    nearest = claim.quantifier == "some" or not any(p.holds for p in asked)
    return min(asked, key=near, default=None) if nearest else max(asked, key=away, default=None)


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
                sides, find_sides(other, merge_equal(other, tried(other)), explain=False), flips, strict=True
            ):
                verdicts = {f.verdict for f in (old, new) if f} - {Verdict.CANNOT_BE_TOLD}
                if new and len(verdicts) == 2:
                    out.append(Moved(k, by, new.verdict, new.holds, new.settings))  # type: ignore[arg-type]
    paper, beyond = (replace(f, borderline=tuple(m)) if f else None for f, m in zip(sides, flips, strict=True))
    return paper, beyond


def _because(register: Register, own: Sequence[Place], found: Sequence[Point], across: str) -> Because:
    """What the judged settings rest on; ``found`` are all of the map."""
    holding = [p for p in found if p.holds]
    met = Counter(v for p in holding for v in p.met_at)
    judged = values_of(q.spec.solver for p in found if p.holds is not None for q in p.places)
    stand_ins = tuple(register.solvers[s] for s in judged if s in register.solvers)
    unjudged = tuple(values_of(p.spec.solver for p in own if judged and p.spec.solver not in judged))
    return Because(across, tuple(Count(v, met[v], len(holding)) for v in values_of(met)), stand_ins, unjudged)


def _settings(counted: Sequence[Point], own: Sequence[Place], others: Sequence[Place]) -> dict[str, tuple[Value, ...]]:
    """The values of the settings that are judged, or of all where none is; ``EITHER_WAY`` also where there is one."""
    if counted:
        own, others = ([q for p in counted for q in places(p)] for places in (_places_of, _beside_of))
    if not (places := [*own, *others]):
        return {}
    out = {k: tuple(values_of(p.dimensions[k] for p in places)) for k in ("problem", "solver")}
    chosen = find_chosen(own) - out.keys()
    rest = {k: v for k, v in find_varied([p.dimensions for p in own]).items() if k in chosen}
    either = {k: values_of(p.dimensions[k] for p in own if k in p.dimensions) for k in EITHER_WAY}
    rest = {**rest, **{k: v for k, v in either.items() if v and k not in rest}}
    return out | {k: tuple(text_of(x) if isinstance(x, list | tuple) else x for x in v) for k, v in rest.items()}


def _places_of(p: Point) -> tuple[Place, ...]:
    return p.places


def _beside_of(p: Point) -> tuple[Place, ...]:
    return p.beside


def _test(test: given.Test, shown: Point | None, k: int, numbers: Numbers) -> Test:
    number = shown.numbers[k] if shown else math.nan
    low, high = (v if math.isfinite(v) else None for v in (test.at_least, test.at_most))
    return Test(test.metric, test.arguments, test.combine, test.compare, test.unit, (low, high),
                shorten(number), number == math.inf, _find_rival(test, shown, numbers))  # fmt: skip


def _find_rival(test: given.Test, shown: Point | None, numbers: Numbers) -> str:
    """The run whose number the shown one is compared with; empty where it is not with the smallest or largest."""
    choose = {"over smallest": min, "over largest": max, "minus largest": max}.get(test.compare)
    if shown is None or choose is None or MEASURES[test.metric].of_pair or not shown.beside:
        return ""
    sizes = {q.spec.case: numbers.of(q.spec.settings_id, test) for q in shown.beside}
    known = {case: v for case, v in sizes.items() if not math.isnan(v)}
    return choose(known, key=lambda case: known[case]) if known else ""


def _row(
    claim: given.Claim, p: Point, records: Mapping[str, RunRecord], twins: Collection[str], control: Point | None
) -> MapRow:
    first = p.places[0]
    at = {k: first.dimensions[k] for k in SHOWN if k in first.dimensions and k != claim.across}
    settings_id = first.spec.settings_id
    return MapRow(settings_id, first.spec.case, len(p.places) - 1, at, p.holds, shorten(p.numbers[0]),
                  records[settings_id].status, p.printed, settings_id in twins,
                  *((shorten(control.numbers[0]), control.holds) if control else (math.nan, None)),
                  command=write_command(records[settings_id], out="run.npz"))  # fmt: skip
