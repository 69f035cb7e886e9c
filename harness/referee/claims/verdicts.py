"""From the register, the runs of the suite and the records to a verdict with its evidence. Nothing is typed.

Pure: the same records in any order give the same verdicts. No time of a clock enters. Settings whose runs settle
nothing are left out of the count and named (module points).
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from ...catalogue import registry
from ...results.records import RunRecord
from ...suites.spec import RunSpec
from .conditions import decision, factors, said
from .maps import Place, place, select, values_of, varied
from .measured import Numbers, SeriesOf, in_words, shortened
from .points import Point, points
from .register import Claim, Register, Test

SUPPORTED, REFUTED, CONDITIONAL, UNTESTABLE = "SUPPORTED", "REFUTED", "CONDITIONAL", "UNTESTABLE"
SHOWN = ("tolerance", "gain", "form", "chart", "lambda_in_error_test", "consistent_start", "frame")


def judge(
    register: Register, specs: Iterable[RunSpec], records: Iterable[RunRecord], series_of: SeriesOf
) -> list[dict[str, Any]]:
    """All verdicts, in the order of the register."""
    places = [place(c) for c in specs]
    numbers = Numbers(by_settings(records), series_of)
    tried = {c.id: _tried(c, places) for c in register.claims}
    numbers.gather(
        (p.spec.settings_id, t) for c in register.claims for p in (*tried[c.id][0], *tried[c.id][1]) for t in c.tests
    )
    return [_judged(c, register, *tried[c.id], numbers) for c in register.claims]


def by_settings(records: Iterable[RunRecord]) -> dict[str, RunRecord]:
    """Records by what shapes the motion; of two codes' results the newer counts."""
    return {r.settings_id: r for r in sorted(records, key=lambda r: (r.finished, r.run_id))}


def untestable(claim: Claim) -> list[str]:
    """What the claim needs and nobody here has."""
    out = []
    for need in claim.needs:
        if "solver" in need and need["solver"] in registry.solvers():
            continue
        if "observable" in need:
            problem, _, name = need["observable"].partition(".")
            if any(o.name == name for o in registry.make_problem(problem, {}).observables):
                continue
        out.append(need["why"])
    return out


def _tried(claim: Claim, places: Sequence[Place]) -> tuple[tuple[Place, ...], tuple[Place, ...]]:
    own = select(places, claim.map.over) if claim.map else ()
    return own, select(places, claim.against.over) if claim.against else ()


def _judged(
    claim: Claim, register: Register, own: tuple[Place, ...], others: tuple[Place, ...], numbers: Numbers
) -> dict[str, Any]:
    missing = untestable(claim) or _gaps(claim, own, others, numbers.records)
    found = [] if missing else points(claim, own, others, numbers)
    counted = [p for p in found if p.holds is not None]
    if not missing:
        missing = _unmeasured(claim, found, counted)
    verdict = UNTESTABLE if missing else _verdict(claim, counted)
    shown = _shown(claim, counted)
    first = claim.tests[0] if claim.tests else None
    values = [p.numbers[0] for p in counted]
    return {
        "id": claim.id,
        "kind": claim.kind,
        "section": claim.section,
        "figure": ", ".join(map(str, claim.figures)),
        "quote": claim.quote,
        "claim": claim.claim,
        "verdict": verdict,
        "measured": shortened(shown.numbers[0]) if shown else None,
        "measured_words": in_words(shown.numbers[0], first.unit) if shown and first else "nothing",
        "measured_range": [shortened(min(values, key=_low)), shortened(max(values, key=_high))] if values else [],
        "unit": first.unit if first else "",
        "band": [shortened(first.band.low), shortened(first.band.high)] if first else [],
        "tests": [_test_words(t, shown, k) for k, t in enumerate(claim.tests)],
        "because": "; ".join(missing) if missing else _because(claim, register, found, counted),
        "settings": _settings(own, others),
        "runs": [p.spec.settings_id for p in (*own, *others)],
        "factors": factors([_dimensions(claim, p) for p in counted]) if counted else {},
        "map": [_row(claim, p, numbers.records) for p in found],
        "missing": "; ".join(missing),
        "caveats": list(claim.caveats),
    }


def _gaps(claim: Claim, own: Sequence[Place], others: Sequence[Place], records: Mapping[str, RunRecord]) -> list[str]:
    """Runs or values that the map should have: a map with holes decides nothing."""
    out = []
    for m, places in ((claim.map, own), (claim.against, others)):
        if m is None:
            continue
        for name, wanted in m.dimensions.items():
            found = len(values_of(p.dimensions.get(name) for p in places))
            if found < wanted:
                out.append(f"the suite has {found} of {wanted} values of {name} for the map {m.name}")
        absent = [p for p in places if p.spec.settings_id not in records]
        if absent:
            out.append(f"runs missing: {len(absent)} of {len(places)} of the map {m.name}, first {absent[0].spec.case}")
        elif not places:
            out.append(f"runs missing: the suite has none for the map {m.name}")
    return out


def _unmeasured(claim: Claim, found: Sequence[Point], counted: Sequence[Point]) -> list[str]:
    """What no run of the map has: a number that nowhere exists refutes nothing."""
    if not found:
        return [f"no two runs of the map differ in {claim.across} alone"]
    if not counted:
        return ["no setting of the map settles it", *_left_out(found)]
    return [
        f"no run of the map has the number {t.metric!r} (test {k + 1})"
        for k, t in enumerate(claim.tests)
        if all(p.numbers[k] != p.numbers[k] for p in counted)
    ]


def _shown(claim: Claim, counted: Sequence[Point]) -> Point | None:
    """The setting whose numbers stand in the table: the first printed one, else the one that speaks most against it."""
    measurable = [p for p in counted if p.numbers[0] == p.numbers[0]] or list(counted)
    printed = next((p for p in measurable if p.printed), None)
    against = max(measurable, key=lambda p: (not p.holds, claim.tests[0].band.beyond(p.numbers[0])), default=None)
    return printed or against


def _verdict(claim: Claim, counted: Sequence[Point]) -> str:
    held = sum(p.holds is True for p in counted)
    if held == len(counted) or (held and claim.quantifier == "some"):
        return SUPPORTED
    return CONDITIONAL if held else REFUTED


def _dimensions(claim: Claim, p: Point) -> tuple[Mapping[str, Any], bool]:
    return {k: v for k, v in p.places[0].dimensions.items() if k != claim.across}, p.holds is True


def _because(claim: Claim, register: Register, found: Sequence[Point], counted: Sequence[Point]) -> str:
    held, printed = [p for p in counted if p.holds], [p for p in counted if p.printed]
    solvers = values_of(q.dimensions["solver"] for p in found for q in p.places)
    out = [register.solvers[s] for s in solvers if s in register.solvers]
    out.append(f"holds in {len(held)} of {len(counted)} settings")
    if claim.across:
        out[-1] += f", each looked at across {claim.across}"
    stopped = sum(p.stopped for p in held)
    if stopped:
        out.append(f"in {stopped} of these {len(held)} because a run did not get to its end")
    if printed:
        out.append(f"with what the paper prints in {sum(p.holds is True for p in printed)} of {len(printed)}")
    met = Counter(v for p in held for v in p.met_at)
    if met:
        each = ", ".join(f"{said(claim.across, v)} in {met[v]}" for v in values_of(met))
        out.append(f"one {claim.across} that meets it suffices: {each}")
    if 0 < len(held) < len(counted):
        out.append(decision([_dimensions(claim, p) for p in counted]))
    return ". ".join(s[0].upper() + s[1:] for s in (*out, *_left_out(found), *claim.caveats)) + "."


def _left_out(found: Sequence[Point]) -> list[str]:
    """How many settings do not count, for each reason."""
    reasons = Counter(p.left_out for p in found if p.holds is None)
    return [f"{n} {'setting is' if n == 1 else 'settings are'} left out: {why}" for why, n in sorted(reasons.items())]


def _settings(own: Sequence[Place], others: Sequence[Place]) -> dict[str, str]:
    places = [*own, *others]
    if not places:
        return {}
    out = {k: ", ".join(values_of(p.dimensions[k] for p in places)) for k in ("problem", "solver")}
    for name, values in varied(own).items():
        if name not in out:
            out[name] = ", ".join(said(name, v).removeprefix(f"{name.replace('_', ' ')} ") for v in values)
    if others:
        out["against"] = ", ".join(dict.fromkeys(p.spec.case for p in others[:4])) + (" ..." if others[4:] else "")
    return out


def _test_words(test: Test, shown: Point | None, k: int) -> dict[str, Any]:
    how = " ".join(filter(None, (test.compare and f"({test.compare} of others)", test.combine and f"({test.combine})")))
    at = ", ".join(f"{a} {v}" for a, v in test.arguments.items() if a != "partial")
    return {
        "metric": " ".join(filter(None, (test.metric, at and f"[{at}]", how))),
        "band": test.band.words(test.unit),
        "unit": test.unit,
        "measured": shortened(shown.numbers[k]) if shown else None,
        "measured_words": in_words(shown.numbers[k], test.unit) if shown else "nothing",
    }


def _row(claim: Claim, p: Point, records: Mapping[str, RunRecord]) -> dict[str, Any]:
    first, record = p.places[0], records[p.places[0].spec.settings_id]
    at = {k: first.dimensions[k] for k in SHOWN if k in first.dimensions and k != claim.across}
    if "gauge" in first.dimensions:
        at["form"] = f"gauge {first.dimensions['gauge']}, sigma0 {first.dimensions['sigma0']}"
    more = f" and {len(p.places) - 1} more across {claim.across}" if len(p.places) > 1 else ""
    return {
        "run": first.spec.settings_id,
        "case": first.spec.case + more,
        **at,
        "holds": p.holds,
        "measured": shortened(p.numbers[0]),
        "status": record.status,
        "printed": p.printed,
    }


def _low(value: float) -> float:
    return float("inf") if value != value else value


def _high(value: float) -> float:
    return float("-inf") if value != value else value
