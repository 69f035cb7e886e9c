"""Plot error against work, and the fraction of accuracy targets reached over work, for pages and for print."""

import math
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...harness.results.judgements.runs import WorkProfile
from ...harness.results.least_cost import find_least_cost
from ...harness.results.records import find_cpu_range
from ...harness.results.work import count_evaluations, count_index_1_evaluations, count_operations
from ..model.accuracy import ErrorMeasure, choose_measure
from ..model.frontier import EQUAL, SOUND
from ..model.results import StoredRun, Variant, group_by
from ..model.words import format_decade, join_words, number, plural, seconds
from .spec import Axis, Chapter, Plot, Trace, choose_end_mark, choose_focus

WORKS = {  # words and unit
    "index1": ("index-1 evaluations", ""),
    "operations": ("evaluations and factorisations", ""),
    "evaluations": ("evaluations", ""),
    "factorisations": ("factorisations", ""),
    "steps": ("accepted steps", ""),
    "cpu": ("CPU time", "s"),
}
ERRORS = {"error": ("error", ""), "energy": ("largest energy error", "J"), "phi": ("largest |φ|", "m")}
PAIRS = tuple((error, work) for error in ("error", "energy") for work in ("cpu", "index1", "evaluations"))
NEAR = 100.0  # the reference's stated error is drawn if a point is within this factor of it
LADDER = 3  # least steps of one method for its own line among many methods
ZERO = 20.0  # zeros are drawn this many times below the smallest positive value, as in assets/plots.js
NOTE = (
    "Lower and further left is better. Lines join the steps or tolerances of the same settings. A run that stopped "
    "early (star) has the error up to there and is not comparable. Zeros have no place on a logarithmic axis: "
    "they are drawn hollow below all other values, to be read as “at most”. "
    "A click opens the run."
)


@dataclass(frozen=True)
class PlottedWork:
    """The costs and errors of one run.

    ``works`` are by the keys of ``WORKS`` and ``step``, ``errors`` by those of ``ERRORS``.
    """

    run: StoredRun
    page: str
    works: Mapping[str, float]
    errors: Mapping[str, float]
    best: bool  # True if no other run of its solver is both cheaper and as accurate

    @property
    def solver(self) -> str:
        return self.run.record.solver

    @property
    def default(self) -> bool:
        """True if the run sets nothing but the step or tolerance."""
        return not self.run.options

    @cached_property
    def method(self) -> str:
        """The settings without the step or tolerance: runs of one method are joined by a line."""
        largest = self.run.record.max_step_s
        return self.run.method if math.isnan(largest) else f"{self.run.method}, max step {largest:g} s"

    def is_drawable(self, error: str, work: str) -> bool:
        """Return whether the run has that error and that work, so that it is a point of their plot."""
        return all(math.isfinite(v) and v >= 0.0 for v in (self.errors[error], self.works[work]))


def list_points(
    variant: Variant, page: Callable[[StoredRun], str] = lambda run: "", best: Container[str] = ()
) -> list[PlottedWork]:
    """Return the costs and errors of each run; ``page`` gives its address.

    ``best`` holds the settings_ids of the runs that no other of their solver beats in both cost and error.
    """
    measure, out = choose_measure(variant.runs), []
    for c in variant.runs:
        r = c.record
        works = {
            "index1": count_index_1_evaluations(r),
            "operations": count_operations(r),
            "evaluations": count_evaluations(r),
            "factorisations": r.factorisations,
            "steps": float(r.steps),
            "cpu": r.cpu_median_s,
            "step": _find_step(c),
        }
        errors = {"error": measure.of(c) if measure else math.nan, "energy": r.energy_drift_max_J, "phi": r.phi_max}
        out.append(PlottedWork(c, page(c), works, errors, r.settings_id in best))
    return out


def _find_step(run: StoredRun) -> float:
    """Return the requested step, or the mean step under error control [s]."""
    r = run.record
    if r.control == "dt":
        return r.dt_s
    return r.t_reached_s / r.steps if r.steps > 0 else math.nan


def make_work_chapter(variant: Variant, url: Callable[[StoredRun], str]) -> Chapter | None:
    """Return the plots of work against error of a problem as a chapter; None if no run has both."""
    plots = make_work_plots(variant, url, front=True)
    return Chapter("Work against error", NOTE, tuple(plots)) if plots else None


def make_work_plots(
    variant: Variant, url: Callable[[StoredRun], str] = lambda run: "", *, front: bool = False
) -> list[Plot]:
    """Plot error against work of all runs, for each pair of ``PAIRS`` that some run has."""
    return list(plot_pairs("work", list_points(variant, url), choose_measure(variant.runs), front=front).values())


def plot_pairs(
    name: str,
    points: Sequence[PlottedWork],
    measure: ErrorMeasure | None,
    pairs: Sequence[tuple[str, str]] = PAIRS,
    *,
    folded: bool = False,
    front: bool = False,
) -> dict[str, Plot]:
    """Return plots of error against work for one variant, one for each of ``pairs`` that some run has.

    They are keyed ``<error>-<work>``. ``folded`` merges short ladders with options into a trace per solver, and hides
    settings that are neither default nor best; ``front`` adds the Pareto front.
    """
    out = {}
    for error, work in pairs:
        own = [p for p in points if p.is_drawable(error, work)]
        if own:
            what, unit = (measure.what, measure.unit) if error == "error" and measure else ERRORS[error]
            axes = Axis(*WORKS[work], log=True), Axis(what, unit, log=True)
            title = f"{what[0].upper()}{what[1:]} over {WORKS[work][0]}"
            region = _shade_reference_error(own, work, measure.own) if error == "error" and measure else []
            drawn = [*region, *join_ladders(own, work, error, folded)]
            drawn += _find_front(own, work) if front and error == "error" else []
            finding, focus = describe_race(own, work, error, unit)
            out[f"{error}-{work}"] = Plot(
                f"{name}-{error}-{work}",
                title,
                "",
                *axes,
                drawn,
                focus=focus,
                finding=f"{own[0].run.variant}: {finding or title}",
            )
    return out


def describe_race(points: Sequence[PlottedWork], work: str, error: str, unit: str) -> tuple[str, tuple[str, ...]]:
    """Return words on which solver is the cheapest in ``work`` for an ``error``, and the solvers to be shown in colour.

    They are compared at the tightest power of ten that half of the solvers reach: ``rkmk_dopri5 needs 12.0 ms for 10⁻⁴
    m, ida_index3 96 times as much; 2 of 19 do not get there``. The words are empty if fewer than two solvers reach it.
    """
    solvers = sorted({p.solver for p in points})
    sound = [p for p in points if p.run.status in SOUND]
    least = sorted(min((p.errors[error] for p in sound if p.solver == s), default=math.inf) for s in solvers)
    middle = least[(len(least) - 1) // 2]
    target = 10.0 ** max(math.ceil(math.log10(middle)), -15) if 0.0 < middle < math.inf else 1e-15
    best: dict[str, float] = {}
    for own in group_by((p for p in sound if p.works[work] > 0.0), lambda p: (p.solver, p.method)).values():
        ladder = [(p.errors[error], p.works[work]) for p in sorted(own, key=lambda p: -p.run.step_or_tolerance)]
        if found := find_least_cost(ladder, target):
            best[own[0].solver] = min(found[0], best.get(own[0].solver, math.inf))
    costs = sorted((v, s) for s, v in best.items())
    focus = choose_focus([*(s for _, s in costs), *(s for s in solvers if s not in best)])
    if len(costs) < 2 or not costs[0][0] > 0.0:
        return "", focus
    lowest, (most, last) = costs[0][0], costs[-1]
    firsts = [s for v, s in costs if v <= lowest * (EQUAL if work == "cpu" else 1.0)]  # counts are exact
    cost, ratio = seconds(lowest) if work == "cpu" else f"{number(lowest)} {WORKS[work][0]}", number(most / lowest, 2)
    need = f"{join_words(firsts)} {'needs' if len(firsts) == 1 else 'need'} {cost} for {format_decade(target)} {unit}"
    said = need if last in firsts else f"{need}, {last} {ratio} times as much"
    missed = len(solvers) - len(best)
    return f"{said}; {missed} of {len(solvers)} do not get there" if missed else said, focus


def _find_front(points: Sequence[PlottedWork], work: str) -> list[Trace]:
    """Return as one trace the Pareto front: the runs that none beats in both cost and error.

    A front of fewer than ``LADDER`` runs gives no trace.
    """
    best, out = math.inf, list[PlottedWork]()
    sound = [p for p in points if p.run.status in SOUND]
    for p in sorted(sound, key=lambda p: (p.works[work], p.errors["error"])):
        if p.errors["error"] < best:
            best = p.errors["error"]
            out.append(p)
    if len(out) < LADDER:
        return []
    return [Trace("Pareto front", _numbers(out, "works", work), _numbers(out, "errors", "error"), dash=2)]


def _shade_reference_error(points: Sequence[PlottedWork], work: str, own: float) -> list[Trace]:
    """Return a trace that shades errors below ``own``, the reference's stated error, if a point comes near it; or none.

    A point is near if its error is below ``NEAR`` times that.
    """
    found = (_numbers(points, kind, key) for kind, key in (("works", work), ("errors", "error")))
    # zeros are moved to where they are drawn
    x, y = (np.maximum(a, min(a[a > 0.0], default=1e-16 * ZERO) / ZERO) for a in found)
    if not own * NEAR > min(y):
        return []
    edge, bottom = np.full(2, own), np.full(2, min(own / ZERO, min(y) / 2.0))
    ends = np.array([min(x) / 2.0, max(x) * 2.0])
    return [Trace("below the reference's stated error", ends, edge, low=bottom, high=edge, dash=2)]


def join_ladders(points: Sequence[PlottedWork], work: str, error: str, folded: bool = False) -> list[Trace]:
    """Return a trace for each method, its steps joined coarsest first; runs that stopped early are left off the line.

    ``folded`` puts short ladders with options of one solver and label into one trace without a line.
    """
    methods = group_by(sorted(points, key=lambda p: (p.method, -p.run.step_or_tolerance)), lambda p: p.method)
    out, loose, seen = [], dict[tuple[str, str], list[PlottedWork]](), dict[str, int]()
    # the main ones come first and are solid
    ordered = sorted(methods.items(), key=lambda kv: (not kv[1][0].default, -len(kv[1])))
    for method, own in ordered:
        solver, label = own[0].solver, _find_common_label(own)
        if folded and not own[0].default and len(own) < LADDER:
            loose.setdefault((solver, label), []).extend(own)
            continue
        dash = seen[solver] = seen.get(solver, -1) + 1
        name = f"{method}, {label}" if label else method
        whole = [p for p in own if choose_end_mark(p.run.status) != "failed"]
        out += [
            _make_trace(name, part, work, error, folded, mode, dash)
            for part, mode in ((whole, "lines+markers"), ([p for p in own if p not in whole], "markers"))
            if part
        ]
    for (solver, label), own in loose.items():
        name = f"{solver} with options, {label}" if label else f"{solver} with options"
        out.append(_make_trace(name, own, work, error, folded, "markers", 1))
    return out


def _make_trace(
    name: str, own: Sequence[PlottedWork], work: str, error: str, folded: bool, mode: str, dash: int
) -> Trace:
    """Return the points ``own`` as one trace, with the spread of CPU times as bars if there are repeats.

    ``dash`` and ``mode`` are the trace's. If ``folded``, it is hidden at first unless a setting is default or best.
    """
    is_ladder = len({p.method for p in own}) == 1
    has_bars = work == "cpu" and any(p.run.record.repeats > 1 for p in own)
    records = [p.run.record for p in own]
    spread = [find_cpu_range(r) if r.repeats > 1 else (r.cpu_median_s,) * 2 for r in records]
    left, right = np.array(spread).T
    return Trace(
        name,
        _numbers(own, "works", work),
        _numbers(own, "errors", error),
        solver=own[0].solver,
        mode=mode,
        dash=dash,
        left=left if has_bars else None,
        right=right if has_bars else None,
        group=_find_common_label(own),
        main=not folded or any(p.default or p.best for p in own),
        ends=[choose_end_mark(p.run.status) for p in own],
        urls=[p.page for p in own],
        words=[_describe_point(p, whole=not is_ladder) for p in own],
    )


def _find_common_label(own: Sequence[PlottedWork]) -> str:
    """Return the label of all points; empty if they have several."""
    labels = {p.run.record.label for p in own}
    return labels.pop() if len(labels) == 1 else ""


def _describe_point(p: PlottedWork, *, whole: bool) -> str:
    """Describe a point: its step or tolerance, or its ``whole`` case, then how it ended, its CPU times and steps.

    Default and best settings are named as such.
    """
    c, r = p.run, p.run.record
    marks = [w for w, on in (("default settings", p.default), ("best", p.best)) if on]
    ending = [] if c.status in ("success", "unknown") else [c.status.replace("_", " ")]
    low, high = map(seconds, find_cpu_range(r))
    cpu = (
        [f"CPU {low} to {high}, the middle half of {r.repeats} repeats"]
        if r.repeats > 1
        else (["single timing"] if r.repeats else [])
    )
    steps = [f"{number(float(r.steps))} steps"] if r.steps >= 0 else []
    return ", ".join([r.case.removeprefix(f"{c.variant} ") if whole else c.step_words, *marks, *ending, *cpu, *steps])


def _numbers(own: Sequence[PlottedWork], kind: str, key: str) -> np.ndarray:
    """Return one number of each point: ``kind`` is "works" or "errors", ``key`` the work or error."""
    return np.array([getattr(p, kind)[key] for p in own])


def plot_profile(best: Sequence[WorkProfile], default: Sequence[WorkProfile], work: str) -> Plot:
    """Plot the fraction of all targets reached over work, with the best of all settings and with default options.

    The lines end level, since more work than a solver's runs took reaches no more targets.
    """
    best, default = ([p for p in found if p.work == work] for found in (best, default))
    right = 2.0 * max((p.target_work[-1] for p in (*best, *default) if p.target_work), default=1.0)
    traces = []
    for found, settings, dash in ((best, "best of its settings", 0), (default, "default settings", 2)):
        for p in found:
            name = f"{p.solver}, {settings}: {len(p.target_work)} of {p.total}"
            traces.append(Trace(name, *make_step_line(p, right), solver=p.solver, dash=dash))
    words, unit = WORKS[work]
    best = sorted(best, key=lambda p: (-len(p.target_work), p.solver))
    firsts = [p.solver for p in best if len(p.target_work) == len(best[0].target_work)]
    finding = ""
    if best:
        reach = f"{join_words(firsts)} {'reaches' if len(firsts) == 1 else 'reach'}"
        finding = f"{reach} {len(best[0].target_work)} of {plural(best[0].total, 'target')} with the best settings"
    focus = choose_focus([p.solver for p in best])
    return Plot(
        f"profile-{work}",
        f"Targets reached over {words}",
        "",
        Axis(words, unit, log=True, high=right),
        Axis("share of all targets reached", "", low=0.0, high=1.02),
        tuple(traces),
        wide=True,
        focus=focus,
        finding=finding,
    )


def make_step_line(p: WorkProfile, right: float = math.nan) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of the step line: up by one target where it is reached, then level to ``right``."""
    x = np.repeat(np.array(p.target_work, dtype=float), 2)
    y = np.arange(1, len(x) + 1) // 2 / max(p.total, 1)
    if len(x) and right > x[-1]:
        x, y = np.append(x, right), np.append(y, y[-1])
    return x, y
