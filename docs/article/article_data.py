"""Define the names that the article may use, with values from published results: claims, runs, tables and figures."""

import json
import math
import re
import tomllib
from collections import Counter
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, TypeVar

from matplotlib.figure import Figure

from mbsbench.harness.judge.distance import find_significant_tests
from mbsbench.harness.results.environment import ROOT
from mbsbench.harness.results.judgements.claims import ClaimFinding, ClaimVerdict, Condition, JudgedClaim
from mbsbench.harness.results.judgements.files import (
    CLAIMS,
    DRIFTS,
    PUBLISHED,
    SYMMETRIES,
    WORK,
    WRONG,
    File,
    read_judgement,
)
from mbsbench.harness.results.judgements.runs import Drift, WorkPoint
from mbsbench.harness.results.least_cost import find_least_cost
from mbsbench.reports.model.catalogue import is_engine
from mbsbench.reports.model.claim_words import FACTOR, format_measured, format_separation, quantify
from mbsbench.reports.model.words import number, plural
from mbsbench.reports.plots.paper import DOUBLE, INK, SINGLE, sheet
from mbsbench.reports.plots.spec import choose_styles

# our own claims on other methods, which are not in the paper
OURS = re.compile(r"beyond-|.*-control|.*-ida$|.*-lower-index-")
COLOURS = {
    "reproduced": "#3D62C7",
    "reproduced if": "#E0B040",
    "not reproduced": "#BB3939",
    "cannot be told": "#B9BFC6",
}
RACE = (
    "gc_weak_form",
    "gc_augmented_lagrangian",
    "rattle",
    "generalized_alpha",
    "energy_momentum",
    "ida_index1",
    "ida_index3",
    "ndf_index1",
    "rk45_strong_form",
    "rkmk_dop853",
)
WORDS = {
    "gc_weak_form": "ODE-GC, weak form",
    "gc_augmented_lagrangian": "ODE-GC, augmented",
    "rattle": "RATTLE",
    "generalized_alpha": "generalized alpha",
    "energy_momentum": "energy-momentum",
    "ida_index1": "IDA, index 1",
    "ida_index3": "IDA, index 3",
    "ndf_index1": "NDF, index 1",
    "rk45_strong_form": "ODE-45 (RK45)",
    "rkmk_dop853": "DOP853 on the group",
    "dop853_joint": "DOP853 in joint coordinates",
    "heavy_top": "the top",
    "direction translation": "translations for $c_R$",
    "direction a": "$c_R$ along $a$",
    "gauge symmetric": "symmetric",
    "gauge zero": "zero gauge",
    "newton simplified": "simplified Newton",
    "6-gc-planar": "pendulum: planar",
    "11-gc-coincident": "top: angle",
    "11-gc-rate": "top: precession rate",
    "9-gc-recovers": "chain: energy recovers",
    "9-gc-conserves": "chain: energy conserved",
    "general-stabilised": "pendulum: constraints do not grow",
}
MOTIONS = ("torque_free_body[t_end=300]", "spherical_pendulum", "heavy_top", "chain[t_end=2]", "four_bar_grid")
T = TypeVar("T")
Table = tuple[list[str], list[list[str]]]  # heads and rows


class Fault(ValueError):
    """Signal a name without a source, or a sentence that the results contradict; the message is one line."""


@cache
def read(file: File[T]) -> T:
    """Return a published judgement."""
    return read_judgement(file, PUBLISHED)


def in_words(text: str) -> str:
    """Replace solvers and choices by their names in the field, and small numbers by their form in text."""
    for name, words in WORDS.items():
        text = re.sub(rf"\b{re.escape(name)}\b", words, text)
    return re.sub(r"\b\d+e-\d+", lambda m: number(float(m[0])), text)


def one(found: Sequence[Any], what: str) -> Any:
    """Return the only one of ``found``."""
    if len(found) != 1:
        raise Fault(f"{what}: published results hold {len(found)} of it, expected one")
    return found[0]


@cache
def claims() -> dict[str, JudgedClaim]:
    """Return the published claims on results by their names; checks of the set-up are omitted."""
    return {c.id: c for c in read(CLAIMS) if c.kind == "result"}


def claim(name: str) -> JudgedClaim:
    """Return one claim; ``paper`` and ``beyond`` are its findings."""
    return one([c for c in claims().values() if c.id == name], f"the claim {name!r}")  # type: ignore[no-any-return]


def count(verdict: str, side: str = "paper") -> int:
    """Count claims of the paper with that verdict at its settings, or beyond them."""
    return sum(
        f.verdict == ClaimVerdict(verdict)
        for c in claims().values()
        if not OURS.match(c.id) and (f := getattr(c, side))
    )


def judged(side: str = "paper") -> int:
    """Count claims of the paper with a verdict at its settings, or beyond them."""
    return sum(count(v, side) for v in ClaimVerdict)


def judged_twice() -> int:
    """Count claims of the paper with a verdict at its settings and another beyond them."""
    return sum(bool(c.paper and c.beyond) for c in claims().values() if not OURS.match(c.id))


def found(name: str, side: str = "paper") -> str:
    """Return text such as ``holds in 3 of the 6 printed settings``, true for each verdict."""
    f: ClaimFinding | None = getattr(claim(name), side)
    where = "printed" if side == "paper" else "further" if claim(name).paper else "tried"
    if f is None:
        raise Fault(f"the claim {name!r} has no {where} settings")
    if f.verdict is ClaimVerdict.CANNOT_BE_TOLD:
        return f"cannot be judged from the {where} settings"
    if f.settings == 1:
        return f"{'holds' if f.holds else 'does not hold'} in the one {where} setting"
    every = "both" if f.settings == 2 else f"all {f.settings}"
    share = {0: f"none of the {f.settings}", f.settings: every}.get(f.holds, f"{f.holds} of the {f.settings}")
    met = f", at {f.met[0]} of {plural(f.met[1], claim(name).because.across)}" if f.met and f.holds else ""
    d = f.decision
    only = f", always and only with {in_words(format_separation(d))}" if d and d.by and not d.unless else ""
    return f"holds in {share} {where} settings{met}{only}"


def beside(name: str) -> str:
    """Return the result of a claim's control, as `` (so do others beside it: for 3 of 41 tried)``; empty without."""
    c = claim(name).control
    if c is None or not c.finding.settings:
        return ""
    alone = f"; not comparable beside {plural(c.alone, 'setting')} where it holds" if c.alone else ""
    return in_words(f" ({' and '.join(c.solvers)} beside it: {quantify(c.finding)}{alone})")


def where(name: str, side: str = "paper", **at: str) -> Condition:
    """Return the group of settings with these choices in which the claim always or never holds."""
    f: ClaimFinding | None = getattr(claim(name), side)
    groups = f.decision.conditions if f and f.decision else ()
    return one([g for g in groups if g.at == at], f"the claim {name!r} with {at}")  # type: ignore[no-any-return]


def share(name: str, side: str = "paper", **at: str) -> str:
    """Return text such as ``3 of 3``: settings of that group, or of all, in which the claim holds."""
    group = where(name, side, **at) if at else getattr(claim(name), side)
    if group is None or not group.settings:
        raise Fault(f"the claim {name!r} has no settings to count")
    return f"{group.holds} of {group.settings}"


def fails(name: str, side: str = "paper") -> str:
    """Return text such as ``79 of 87``: settings in which the claim does not hold."""
    f: ClaimFinding | None = getattr(claim(name), side)
    if f is None or not f.settings:
        raise Fault(f"the claim {name!r} has no settings to count")
    return f"{f.settings - f.holds} of {f.settings}"


def met(name: str) -> str:
    """Return text such as ``59 of 81``: values, one of which suffices, that show what is claimed."""
    f = claim(name).paper
    if f is None or not f.met:
        raise Fault(f"the claim {name!r} has no values to count")
    return f"{f.met[0]} of {f.met[1]}"


def judged_none(*names: str) -> bool:
    """Return whether no printed setting supports any of the claims."""
    return all((f := claim(n).paper) and f.verdict is ClaimVerdict.NOT_REPRODUCED for n in names)


def borderline() -> int:
    """Count claims of the paper with a verdict that another band would reverse."""
    return sum(any(f.borderline for f in c.findings) for c in claims().values() if not OURS.match(c.id))


def runs() -> int:
    """Count runs whose cost and error are published."""
    return len({p.settings_id for p in read(WORK).points})


def solvers() -> int:
    """Count solvers with published runs."""
    return len({p.solver for p in read(WORK).points})


def false_successes(*codes: str) -> int:
    """Count runs that claim success and break a law, of these solvers or of all."""
    return len({w.settings_id for w in read(WRONG) if not codes or w.solver in codes})


@cache
def contest() -> dict[str, Any]:
    """Return engines and our codes, each as shipped and with the best of as many settings."""
    return _load("engines/contests.json")


@cache
def chaos() -> dict[str, dict[str, Any]]:
    """Return runs of the whole chain with the nearest true motions found, and ensembles."""
    return _load("chaos.json")


def _load(name: str) -> Any:
    return json.loads((ROOT / "results" / "published" / name).read_text(encoding="utf-8"))


def engines() -> int:
    """Count engines in the contest, each method of one counted once."""
    return len({who.split()[0] for one in contest()["contests"] for who in one["pairs"] if _is_of_others(who)})


def _is_of_others(who: str) -> bool:
    return is_engine(who.split()[0])


def _is_within(run: dict[str, Any] | None) -> bool:
    return run is not None and run["error"] is not None and run["error"] <= contest()["target"]


def within(which: str) -> str:
    """Return text such as ``25 of 57``: engines' runs within the target, ``shipped`` or ``best``; not refused ones."""
    found = [pair[which] for one in contest()["contests"] for who, pair in one["pairs"].items() if _is_of_others(who)]
    made = [run for run in found if run is not None and run["status"] != "refused"]
    return f"{sum(map(_is_within, made))} of {len(made)}"


def _race() -> list[tuple[str, str, float, str, float]]:
    """Return by problem the cheapest of ours and of the engines, with CPU times [s]; those led by an engine first."""
    out = []
    for one in contest()["contests"]:
        met = sorted((pair["best"]["cpu_s"], who) for who, pair in one["pairs"].items() if _is_within(pair["best"]))
        cost, ours = next(((c, who) for c, who in met if not _is_of_others(who)), (math.inf, ""))
        least, engine = next(((c, who) for c, who in met if _is_of_others(who)), (math.inf, ""))
        out.append((one["problem"], ours, cost, engine, least))
    return sorted(out, key=lambda row: row[4] / row[2])


def engines_lead() -> str:
    """Return text such as ``1 of 5``: problems on which an engine is the cheapest."""
    return f"{sum(row[4] < row[2] for row in _race())} of {len(_race())}"


def engine_table() -> Table:
    """Return the cheapest of ours and of the engines within the required error."""
    rows = [
        [problem.replace("_", " "), WORDS.get(ours, ours), number(1e3 * cost), f"`{engine}`", number(least / cost)]
        for problem, ours, cost, engine, least in _race()
        if ours and engine
    ]
    return ["", "ours", "CPU [ms]", "engine", "its CPU / ours"], rows


def _shadows() -> list[dict[str, Any]]:
    """Return runs of the chain with a true motion nearby over the whole time."""
    return [r for r in chaos()["runs"].values() if (r["shadow"].get("until_s") or 0.0) > 0.999 * chain_span()]


def chain_span() -> float:
    """Return the time of the chain's runs [s]."""
    return float(max(r["t_reached_s"] for r in chaos()["runs"].values() if r["t_reached_s"]))


def shadowed() -> str:
    """Return text such as ``24 of 29``: codes whose motion has a true one nearby over the whole time."""
    return f"{len(_shadows())} of {len(chaos()['runs'])}"


def late_errors() -> str:
    """Return text such as ``0.36 to 0.72``: their errors at the end [m]."""
    return _span([r["error_m"][f"{chain_span():g}"] for r in _shadows()])


def shadow_distances() -> str:
    """Return their rms distances from those true motions [m]."""
    return _span([r["shadow"]["rms_m"] for r in _shadows()])


def _span(values: Sequence[float]) -> str:
    return f"{number(min(values), 2)} to {number(max(values), 2)}"


def shadow(solver: str) -> float:
    """Return the rms distance [m] of one of them."""
    found = one([r for r in _shadows() if r["solver"] == solver], f"a shadow of {solver!r} over the whole time")
    return float(found["shadow"]["rms_m"])


def ensembles_that_differ() -> str:
    """Return text such as ``3 of 9``: the ensembles that differ from the true one by ``find_significant_tests``."""
    found = [
        [score["p"] for score in of.values() if isinstance(score, dict) and score["p"] is not None]
        for of in chaos()["ensembles"].values()
    ]
    found = [p for p in found if p]  # ensembles that ended early cannot be compared
    return f"{sum(bool(find_significant_tests([(x, '') for x in p])) for p in found)} of {len(found)}"


def growth(problem: str) -> float:
    """Return the factor by which a changed start has grown after a second."""
    values = {s.growth for s in read(SYMMETRIES) if s.variant == f"{problem}[t_end=1]" and math.isfinite(s.growth)}
    return one(sorted(values), f"the growth on {problem!r}")  # type: ignore[no-any-return]


def point(case: str) -> WorkPoint:
    """Return the published cost and error of one run."""
    same = {p.settings_id: p for p in read(WORK).points if p.case == case}
    return one(list(same.values()), f"the run {case!r}")  # type: ignore[no-any-return]


def drift(case: str) -> Drift:
    """Return the published drift of one long run."""
    return one([d for d in read(DRIFTS) if d.case == case], f"the drift of {case!r}")  # type: ignore[no-any-return]


def cost(solver: str, variant: str, part: int) -> tuple[float, bool]:
    """Return the least index-1 evaluations for the target ``part``, and whether they are a bound.

    The target is by half powers of ten below a tenth of the reach.
    """
    work = read(WORK)
    problem = variant.partition("[")[0]
    known = {t.variant: t.errors[part] for t in work.targets if t.variant.partition("[")[0] == problem}
    if not known:
        raise Fault(f"published results hold no target on {problem!r}")
    target = known.get(variant, list(known.values())[-1])
    sound = [
        p
        for p in work.points
        if p.variant == variant
        and p.solver == solver
        and p.index1 == p.index1
        and p.status in ("success", "inaccurate")
        and p.label in ("work", "recommended")
    ]
    ladders: dict[str, dict[str, WorkPoint]] = {}
    for p in sound:
        ladders.setdefault(re.sub(r" (dt|rtol)=\S+", "", p.case), {})[p.settings_id] = p
    reached = [
        r
        for own in ladders.values()
        if (r := find_least_cost(sorted(((p.error, p.index1) for p in own.values()), reverse=True), target))
    ]
    return min((r[:2] for r in reached), default=(math.inf, False))


def cheapest(variant: str, part: int = 4) -> str:
    """Return the solver of the race with the least work for that target."""
    return WORDS[min(RACE, key=lambda s: cost(s, variant, part))]


def paper() -> dict[str, Any]:
    """Return the cited paper, from CITATION.cff."""
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8").partition("references:")[2]
    return {k: v.strip('" ') for k, v in re.findall(r"(title|journal|year): (.*)", text)}


def objections() -> int:
    """Count objections that runs answer."""
    return len(tomllib.loads((ROOT / "results" / "objections.toml").read_text(encoding="utf-8"))["objections"])


def sections() -> list[str]:
    """Return sections of the paper with claims, in its order."""
    return sorted({c.section for c in claims().values() if not OURS.match(c.id)})


def by_section(section: str, side: str) -> Counter[str]:
    """Return counts of verdicts."""
    return Counter(
        str(f.verdict)
        for c in claims().values()
        if c.section == section and not OURS.match(c.id) and (f := getattr(c, side))
    )


def verdict_table() -> Table:
    """Return verdicts by section, at the paper's settings | beyond them."""

    def cells(count: Callable[[str, str], int]) -> list[str]:
        return [" / ".join(str(count(v, s)) for s in ("paper", "beyond")) for v in COLOURS]

    rows = [[f"Sect. {s}", *cells(lambda v, side, s=s: by_section(s, side)[v])] for s in sections()]  # type: ignore[misc]
    return ["", *(v.capitalize() for v in COLOURS)], [*rows, ["all", *cells(count)]]


def cost_table() -> Table:
    """Return the work for a thousandth of the reach."""
    rows = []
    for s in RACE:
        cells = []
        for v in MOTIONS:
            work, bound = cost(s, v, 4)
            run = any(
                p.variant == v and p.solver == s and p.label in ("work", "recommended") for p in read(WORK).points
            )
            missed = "not reached" if run else "refused"
            cells.append(missed if work == math.inf else f"{'≤ ' * bound}{number(work)}")
        rows.append([WORDS[s], *cells])
    return ["", *(v.partition("[")[0].replace("_", " ") for v in MOTIONS)], rows


def forms_table() -> Table:
    """Return claims on ODE-GC as printed, and in groups of settings that decide."""
    names = ("6-gc-planar", "11-gc-coincident", "11-gc-rate", "9-gc-recovers", "9-gc-conserves", "general-stabilised")
    rows = []
    for c in map(claim, names):
        sides = [f.decision.conditions if f and f.decision else () for f in (c.paper, c.beyond)]
        printed = [g for g in sides[0] if g.at == {"direction": "translation"}]
        sound = sorted(
            (g for g in sides[1] if g.at.get("sigma0") == "zero" and g.holds),
            key=lambda g: g.at.get("gauge") != "symmetric",
        )
        cells = [f"{c.paper.holds} of {c.paper.settings}" if c.paper else "–"]
        for groups in (printed, sound):
            words = [
                f"{g.holds} of {g.settings}"
                + "".join(
                    f", {in_words(f'{k} {v}')}"
                    for k, v in g.at.items()
                    if groups is sound and k not in ("sigma0", "solver")
                )
                for g in groups[:1]
            ]
            cells += words or ["–"]
        rows.append([WORDS[c.id], *cells])
    return ["claim", "as printed", "translations for $c_R$", "each step begun at zero"], rows


def draw_frontier() -> Figure:
    """Draw error over work on top and chain, the lower front of each solver's runs."""
    figure = sheet(0.9 * DOUBLE, 2.6)
    for axes, variant in zip(figure.subplots(1, 2), ("heavy_top", "chain[t_end=2]"), strict=True):
        for solver, look in choose_styles(RACE).items():
            own = {
                (p.index1, p.error)
                for p in read(WORK).points
                if p.solver == solver and p.variant == variant and p.best and p.status == "success" and p.error > 0.0
            }
            x, y = zip(*sorted(own), strict=True) if own else ((), ())
            axes.loglog(x, y, marker=look.marker, color=look.colour, label=WORDS[solver])
        axes.set(
            title=variant.partition("[")[0].replace("_", " "),
            xlabel="index-1 evaluations",
            ylabel="largest position error [m]",
        )
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def draw_growth() -> Figure:
    """Draw the growth of a changed start over a second."""
    values = {m.partition("[")[0]: growth(m.partition("[")[0]) for m in MOTIONS}
    figure = sheet(SINGLE * 1.2, 1.5)
    axes = figure.subplots()
    ranked = sorted(values.items(), key=lambda pair: pair[1])
    axes.barh([n.replace("_", " ") for n, _ in ranked], [v for _, v in ranked], color=COLOURS["reproduced"], height=0.6)
    for k, (_, v) in enumerate(ranked):
        axes.text(v * 1.08, k, number(v, 2), va="center", fontsize=7, color=INK)
    axes.set(xscale="log", xlabel="growth over one second", xlim=(None, 4.0 * ranked[-1][1]))
    axes.grid(axis="y", visible=False)
    return figure


TABLES: dict[str, Callable[[], Table]] = {
    "verdicts": verdict_table,
    "cost": cost_table,
    "forms": forms_table,
    "engines": engine_table,
}
FIGURES: dict[str, Callable[[], Figure]] = {"frontier": draw_frontier, "growth": draw_growth}
NAMES: dict[str, Any] = {
    f.__name__: f
    for f in (
        claim,
        count,
        judged,
        judged_twice,
        judged_none,
        found,
        beside,
        where,
        share,
        fails,
        met,
        borderline,
        objections,
        runs,
        solvers,
        false_successes,
        point,
        drift,
        cheapest,
        growth,
        paper,
        plural,
        format_measured,
        contest,
        engines,
        within,
        engines_lead,
        chain_span,
        shadowed,
        late_errors,
        shadow_distances,
        shadow,
        ensembles_that_differ,
    )
} | {"factor": f"{FACTOR:g}"}
