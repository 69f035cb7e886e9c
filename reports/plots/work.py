"""Work against error, and the share of accuracy targets reached over work; for problems, the work page and print."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...harness.results.judgements.runs import WorkProfile
from ...harness.results.work import evaluations, index_1_evaluations, operations
from ..model.accuracy import measure_for
from ..model.focus import choose_focus
from ..model.frontier import SOUND
from ..model.frontier import least as cheapest
from ..model.results import Run, Variant, group_by
from ..model.words import decade, number, seconds
from .palette import looks
from .spec import Axis, Chapter, Plot, Trace, end_of

WORKS = {  # words and unit
    "index1": ("index-1 evaluations", ""), "operations": ("evaluations and factorisations", ""),
    "evaluations": ("evaluations", ""),
    "factorisations": ("factorisations", ""), "steps": ("accepted steps", ""), "cpu": ("CPU time", "s"),
}  # fmt: skip
ERRORS = {"error": ("error", ""), "energy": ("largest energy error", "J"), "phi": ("largest |φ|", "m")}
PAIRS = tuple((error, work) for error in ("error", "energy") for work in ("cpu", "index1", "evaluations"))
NEAR = 100.0  # the reference's stated error is drawn where a point comes that close to it
LADDER = 3  # steps of one method that are worth a line among many methods
ZERO = 20.0  # zeros are drawn so many times below the smallest value above zero, as in assets/plots.js
NOTE = (
    "Lower and further left is better. Lines join the steps or tolerances of the same settings. A run that stopped "
    "early (star) has the error up to there and is not comparable. Zeros have no place on a logarithmic axis: "
    "they are drawn hollow below all other values, to be read as “at most”. "
    "A click opens the run."
)


@dataclass(frozen=True)
class Point:
    """Cost and errors of one run; ``works`` and ``errors`` by the keys of ``WORKS`` and ``ERRORS``."""

    variant: str
    problem: str
    solver: str
    words: str
    page: str
    status: str
    label: str
    works: dict[str, float]
    errors: dict[str, float]
    method: str  # runs of one method at several steps are joined by a line
    default: bool = False  # no option but step or tolerance
    best: bool = False  # no other run of its solver is both cheaper and as accurate
    step: str = ""  # step or tolerance in words
    size: float = 0.0  # of that step or tolerance
    kind: str = "error"
    unit: str = ""
    own: float = math.nan  # stated error of the reference
    cpu: tuple[float, float] = (math.nan, math.nan)  # [s] least and most of the repeats
    repeats: int = 0

    def drawable(self, error: str, work: str) -> bool:
        """It has both numbers."""
        return all(math.isfinite(v) and v >= 0.0 for v in (self.errors[error], self.works[work]))


def list_points(variant: Variant, page: Callable[[Run], str] = lambda run: "") -> list[Point]:
    """A point for each run, from its record: all but which settings are the best."""
    measure = measure_for(variant.runs)
    kind, unit, own = (measure.what, measure.unit, measure.own) if measure else ("error", "", math.nan)
    out = []
    for c in variant.runs:
        r = c.record
        works = {"index1": index_1_evaluations(r), "operations": operations(r), "evaluations": evaluations(r),
                 "factorisations": r.factorisations,
                 "steps": float(r.steps), "cpu": r.cpu_median_s}  # fmt: skip
        errors = {"error": measure.of(c) if measure else math.nan, "energy": r.energy_drift_max_J, "phi": r.phi_max}
        out.append(Point(
            c.variant, r.problem, r.solver, r.case, page(c), c.status, r.label, works, errors, method_of(c),
            default=not c.options, step=c.step_words, size=c.step_or_tolerance, kind=kind, unit=unit, own=own,
            cpu=(r.cpu_min_s, r.cpu_max_s), repeats=r.repeats,
        ))  # fmt: skip
    return out


def method_of(run: Run) -> str:
    """All settings but the step or tolerance."""
    largest = run.record.max_step_s
    return run.method if math.isnan(largest) else f"{run.method}, max step {largest:g} s"


def work_chapter(variant: Variant, url: Callable[[Run], str]) -> Chapter | None:
    """All runs of a problem; None when none has both work and an error."""
    plots = work_plots("work", list_points(variant, url), PAIRS, front=True)
    return Chapter("Work against error", NOTE, tuple(plots.values())) if plots else None


def work_plots(name: str, points: Sequence[Point], pairs: Sequence[tuple[str, str]], *,
               folded: bool = False, front: bool = False) -> dict[str, Plot]:  # fmt: skip
    """By ``<error>-<work>``; pairs that no run has are left out.

    ``folded`` puts short ladders with options together, a trace a solver, and hides what is neither default nor best;
    ``front`` adds the Pareto front.
    """
    out = {}
    for error, work in pairs:
        own = [p for p in points if p.drawable(error, work)]
        if own:
            what, unit = kind_of(points) if error == "error" else ERRORS[error]
            axes = Axis(*WORKS[work], log=True), Axis(what, unit, log=True)
            title = f"{what[0].upper()}{what[1:]} over {WORKS[work][0]}"
            region = _reference_region(own, work) if error == "error" else []
            drawn = [*region, *_families(own, work, error, folded)]
            drawn += _front(own, work) if front and error == "error" else []
            found = race(own, work, error)
            out[f"{error}-{work}"] = Plot(
                f"{name}-{error}-{work}", title, "", *axes, drawn, focus=found.focus,
                finding=f"{own[0].variant}: {found.words(work, unit) or title}",
            )  # fmt: skip
    return out


@dataclass(frozen=True)
class Race:
    """The cost of ``target`` for each solver, as on all pages; the cheapest first, and who does not get there."""

    target: float
    costs: Sequence[tuple[float, str]]
    missed: Sequence[str]

    @property
    def focus(self) -> tuple[str, ...]:
        """The cheapest and the dearest, the cheapest of every family."""
        order = [*(s for _, s in self.costs), *self.missed]
        return choose_focus(order, lambda s: looks([s])[s].family)

    def words(self, work: str, unit: str) -> str:
        """``rkmk_dopri5 needs 12.0 ms for 10⁻⁴ m, ida_index3 96 times as much; 2 of 19 do not get there``."""
        if len(self.costs) < 2 or not self.costs[0][0] > 0.0:
            return ""
        (least, first), (most, last) = self.costs[0], self.costs[-1]
        cost = seconds(least) if work == "cpu" else f"{number(least)} {WORKS[work][0]}"
        said = f"{first} needs {cost} for {decade(self.target)} {unit}, {last} {number(most / least, 2)} times as much"
        total = len(self.costs) + len(self.missed)
        return f"{said}; {len(self.missed)} of {total} do not get there" if self.missed else said


def race(points: Sequence[Point], work: str, error: str) -> Race:
    """At the tightest power of ten that at least half of the solvers get below."""
    solvers = sorted({p.solver for p in points})
    sound = [p for p in points if p.status in SOUND]
    least = sorted(min((p.errors[error] for p in sound if p.solver == s), default=math.inf) for s in solvers)
    middle = least[(len(least) - 1) // 2]
    target = 10.0 ** max(math.ceil(math.log10(middle)), -15) if 0.0 < middle < math.inf else 1e-15
    best: dict[str, float] = {}
    for own in group_by((p for p in sound if p.works[work] > 0.0), lambda p: (p.solver, p.method)).values():
        ladder = [(p.errors[error], p.works[work]) for p in sorted(own, key=lambda p: -p.size)]
        if found := cheapest(ladder, target):
            best[own[0].solver] = min(found[0], best.get(own[0].solver, math.inf))
    return Race(target, sorted((v, s) for s, v in best.items()), [s for s in solvers if s not in best])


def _front(points: Sequence[Point], work: str) -> list[Trace]:
    """Runs that no other one beats in both cost and error."""
    best, out = math.inf, list[Point]()
    sound = [p for p in points if p.status in ("success", "inaccurate")]
    for p in sorted(sound, key=lambda p: (p.works[work], p.errors["error"])):
        if p.errors["error"] < best:
            best = p.errors["error"]
            out.append(p)
    if len(out) < LADDER:
        return []
    return [Trace("Pareto front", _numbers(out, "works", work), _numbers(out, "errors", "error"), dash=2)]


def kind_of(points: Sequence[Point]) -> tuple[str, str]:
    """Which error it is, and its unit; of most points, so that different kinds are not mixed."""
    kinds = [(p.kind, p.unit) for p in points if p.errors["error"] >= 0.0]
    return max(set(kinds), key=lambda k: (kinds.count(k), k), default=ERRORS["error"])


def reference_error(points: Sequence[Point]) -> float:
    """The reference's stated error: points below it cannot be distinguished; NaN if not known."""
    return max((p.own for p in points if p.own > 0.0), default=math.nan)


def _reference_region(points: Sequence[Point], work: str) -> list[Trace]:
    x, y = (_above_zero(v) for v in ([p.works[work] for p in points], [p.errors["error"] for p in points]))
    own = reference_error(points)
    if not own * NEAR > min(y):
        return []
    edge, bottom = np.full(2, own), np.full(2, min(own / ZERO, min(y) / 2.0))
    ends = np.array([min(x) / 2.0, max(x) * 2.0])
    return [Trace("below the reference's stated error", ends, edge, low=bottom, high=edge, dash=2)]


def _families(points: Sequence[Point], work: str, error: str, folded: bool) -> list[Trace]:
    """Runs of one method at several steps, coarsest first; those that stopped early apart from the line."""
    methods = group_by(sorted(points, key=lambda p: (p.method, -p.size)), lambda p: p.method)
    out, loose, seen = [], dict[tuple[str, str], list[Point]](), dict[str, int]()
    ordered = sorted(methods.items(), key=lambda kv: (not kv[1][0].default, -len(kv[1])))  # the main ones are solid
    for method, own in ordered:
        solver, label = own[0].solver, _label(own)
        if folded and not own[0].default and len(own) < LADDER:
            loose.setdefault((solver, label), []).extend(own)
            continue
        dash = seen[solver] = seen.get(solver, -1) + 1
        name = f"{method}, {label}" if label else method
        whole = [p for p in own if end_of(p.status) != "failed"]
        out += [_trace(name, part, work, error, folded, mode, dash)
                for part, mode in ((whole, "lines+markers"), ([p for p in own if p not in whole], "markers"))
                if part]  # fmt: skip
    for (solver, label), own in loose.items():
        name = f"{solver} with options, {label}" if label else f"{solver} with options"
        out.append(_trace(name, own, work, error, folded, "markers", 1))
    return out


def _trace(name: str, own: Sequence[Point], work: str, error: str, folded: bool, mode: str, dash: int) -> Trace:
    ladder = len({p.method for p in own}) == 1
    spread = [p.repeats > 1 and work == "cpu" for p in own]
    left, right = ([p.cpu[k] if s else p.works[work] for p, s in zip(own, spread, strict=True)] for k in (0, 1))
    return Trace(
        name, _numbers(own, "works", work), _numbers(own, "errors", error), solver=own[0].solver, mode=mode, dash=dash,
        left=np.array(left) if any(spread) else None, right=np.array(right) if any(spread) else None,
        group=_label(own), main=not folded or any(p.default or p.best for p in own),
        ends=[end_of(p.status) for p in own], urls=[p.page for p in own],
        words=[point_words(p, whole=not ladder) for p in own],
    )  # fmt: skip


def _label(own: Sequence[Point]) -> str:
    """The label of all; none where a ladder has several."""
    return own[0].label if len({p.label for p in own}) == 1 else ""


def point_words(p: Point, *, whole: bool = True) -> str:
    """A point in words; only its step or tolerance where the line already gives the method."""
    marks = [w for w, on in (("default settings", p.default), ("best", p.best)) if on]
    ending = [] if p.status in ("success", "unknown") else [p.status.replace("_", " ")]
    cpu = [f"CPU {seconds(p.cpu[0])} to {seconds(p.cpu[1])} in {p.repeats} repeats"] if p.repeats > 1 else (
        ["single timing"] if p.repeats else [])  # fmt: skip
    steps = [f"{number(p.works['steps'])} steps"] if p.works["steps"] >= 0.0 else []
    named = p.words.removeprefix(f"{p.variant} ") if whole else p.step or p.words
    return ", ".join([named, *marks, *ending, *cpu, *steps])


def _numbers(own: Sequence[Point], kind: str, key: str) -> np.ndarray:
    return np.array([getattr(p, kind)[key] for p in own])


def _above_zero(values: Sequence[float]) -> list[float]:
    """With zeros where they are drawn."""
    above = [v for v in values if v > 0.0]
    floor = min(above) / ZERO if above else 1e-16
    return [max(v, floor) for v in values]


def profile_plot(best: Sequence[WorkProfile], default: Sequence[WorkProfile], work: str) -> Plot:
    """The share of all targets reached, over work, by the best of all settings and by default options alone.

    More work than a solver's runs took reaches nothing more.
    """
    best, default = ([p for p in found if p.work == work] for found in (best, default))
    right = 2.0 * max((p.target_work[-1] for p in (*best, *default) if p.target_work), default=1.0)
    traces = []
    for found, settings, dash in ((best, "best of its settings", 0), (default, "default settings", 2)):
        for p in found:
            name = f"{p.solver}, {settings}: {len(p.target_work)} of {p.total}"
            traces.append(Trace(name, *steps_of(p, right), solver=p.solver, dash=dash))
    words, unit = describe_work(work)
    best = sorted(best, key=lambda p: (-len(p.target_work), p.solver))
    finding = f"{best[0].solver} reaches {len(best[0].target_work)} of {best[0].total} targets" if best else ""
    focus = choose_focus([p.solver for p in best], lambda s: looks([s])[s].family)
    return Plot(f"profile-{work}", f"Targets reached over {words}", "", Axis(words, unit, log=True, high=right),
                Axis("share of all targets reached", "", low=0.0, high=1.02), tuple(traces), wide=True, focus=focus,
                finding=finding)  # fmt: skip


def describe_work(work: str) -> tuple[str, str]:
    """A kind of work in words, and its unit."""
    for key, (words, unit) in WORKS.items():
        if work in (key, f"{key}_{unit}", words):
            return words, unit
    return work.replace("_", " "), ""


def steps_of(p: WorkProfile, right: float = math.nan) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the step line: up by one target where it is reached, then level to ``right``."""
    x = np.repeat(np.array(p.target_work, dtype=float), 2)
    y = np.arange(1, len(x) + 1) // 2 / max(p.total, 1)
    if len(x) and right > x[-1]:
        x, y = np.append(x, right), np.append(y, y[-1])
    return x, y
