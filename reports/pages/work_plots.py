"""Work-precision as interactive plots, a plot for each pair of work and error, and the profile over all targets."""

import math
from collections.abc import Sequence

import numpy as np

from ..plots.spec import Axis, Plot, Trace
from .work_points import ERRORS, WORKS, Field, Profile, Work, ended

NEAR = 100.0  # the reference's own error is drawn where a point comes that close to it
BESIDE = ("operations", "evaluations", "cpu")  # works that energy and joints are drawn over
LADDER = 3  # steps of one method that are worth a line
ZERO = 20.0  # zeros are drawn so many times below the smallest value above zero, as in assets/plots.js


def plots_of(f: Field) -> dict[str, Plot]:
    """By ``<error>-<work>``; pairs that no run has are left out."""
    out = {}
    for error, error_words, error_unit in ERRORS:
        title, unit = (f.kind.split(" [")[0], f.kind.partition(" [")[2].rstrip("]")) if error == "error" else (
            error_words, error_unit)  # fmt: skip
        for work, work_words, work_unit in WORKS:
            points = [p for p in f.points if _good(p.works[work]) and _good(p.errors[error])]
            if error != "error" and work not in BESIDE:
                continue  # laws over the other works tell no more
            if error != "error":
                points = [p for p in points if p.default or p.best]
            if points:
                axes = Axis(work_words, work_unit, log=True), Axis(title, unit, log=True)
                traces = _traces(points, work, error, f.own if error == "error" else math.nan)
                name = f"{f.slug}-{error}-{work}"
                out[f"{error}-{work}"] = Plot(name, f"{title} over {work_words}", "", *axes, traces)
    return out


def profile_plot(found: Sequence[Profile], work: str) -> Plot:
    """The share of all targets reached, over work; more work than a solver's runs took reaches nothing more."""
    own = [p for p in found if p.work == work]
    traces = []
    right = max((p.at[-1] for p in own if p.at), default=1.0)
    for p in own:
        x, y = steps_of(p, 2.0 * right)
        name = f"{p.solver}, {'best of its settings' if p.tuned else 'default settings'}: {len(p.at)} of {p.total}"
        traces.append(Trace(name, x, y, solver=p.solver, dash=0 if p.tuned else 2))
    words, unit = named(work)
    return Plot(f"profile-{work}", f"Targets reached over {words}", "", Axis(words, unit, log=True, high=2.0 * right),
                Axis("share of all targets reached", "", low=0.0, high=1.0), tuple(traces), wide=True)  # fmt: skip


def named(work: str) -> tuple[str, str]:
    """A kind of work in words, and its unit."""
    for key, words, unit in WORKS:
        if work in (key, f"{key}_{unit}", words):
            return words, unit
    return work.replace("_", " "), ""


def steps_of(p: Profile, right: float = math.nan) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the step line: up by one target where it is reached, then level to ``right``."""
    count = np.arange(1, len(p.at) + 1) / max(p.total, 1)
    x = np.repeat(np.array(p.at, dtype=float), 2)
    y = np.empty(2 * len(p.at))
    y[0::2], y[1::2] = count - 1.0 / max(p.total, 1), count
    if len(x) and right > x[-1]:
        x, y = np.append(x, right), np.append(y, y[-1])
    return x, y


def _traces(points: Sequence[Work], work: str, error: str, own: float) -> tuple[Trace, ...]:
    left, low = (_zero([p.works[work] for p in points]), _zero([p.errors[error] for p in points]))
    spots = {id(p): (max(p.works[work], left), max(p.errors[error], low)) for p in points}
    out = []
    if own * NEAR > min(y for _, y in spots.values()):
        ends = np.array([min(x for x, _ in spots.values()) / 2.0, max(x for x, _ in spots.values()) * 2.0])
        edge = np.full(2, own)
        bottom = np.full(2, min(own / ZERO, min(y for _, y in spots.values()) / 2.0))
        out.append(Trace("below the reference's own error", ends, edge, low=bottom, high=edge, dash=2))
    for name, family in _families(points):
        x, y = np.array([p.works[work] for p in family]), np.array([p.errors[error] for p in family])
        first, ladder = family[0], len({p.method for p in family}) == 1
        out.append(Trace(
            name, x, y, solver=first.solver, mode="lines+markers" if ladder else "markers",
            dash=0 if first.default else 1, main=first.default or any(p.best for p in family),
            ends=[ended(p.status) for p in family], urls=[p.page for p in family],
            words=[said(p, whole=not ladder) for p in family],
        ))  # fmt: skip
    best = [p for p in points if p.best]
    if best:
        x, y = np.array([p.works[work] for p in best]), np.array([p.errors[error] for p in best])
        words = [f"no other run of {p.solver} is both cheaper and as accurate: {said(p)}" for p in best]
        urls = [p.page for p in best]
        out.append(Trace("best-tuned", x, y, mode="markers", hollow=True, words=words, urls=urls))
    return tuple(out)


def said(p: Work, *, whole: bool = True) -> str:
    """A point in words; only its step or tolerance where the line already says the method."""
    marks = [w for w, on in (("default settings", p.default), ("best", p.best)) if on]
    ending = [] if p.status in ("success", "unknown") else [p.status.replace("_", " ")]
    return ", ".join([p.words.removeprefix(f"{p.variant} ") if whole else p.step or p.words, *marks, *ending])


def _families(points: Sequence[Work]) -> list[tuple[str, list[Work]]]:
    """Runs of one method at several steps, coarsest first; of each solver, all others with options together."""
    methods: dict[tuple[str, str], list[Work]] = {}
    for p in sorted(points, key=lambda p: (p.method, p.label, -p.fineness)):
        methods.setdefault((p.method, p.label), []).append(p)
    found, loose = [], dict[str, list[Work]]()
    for (method, label), own in methods.items():
        if own[0].default or len(own) >= LADDER:
            found.append((f"{method}, {label}" if label else method, own))
        else:
            loose.setdefault(own[0].solver, []).extend(own)
    return found + [(f"{solver} with options", own) for solver, own in loose.items()]


def _good(value: float) -> bool:
    return math.isfinite(value) and value >= 0.0


def _zero(values: Sequence[float]) -> float:
    above = [v for v in values if v > 0.0]
    return min(above) / ZERO if above else 1e-16
