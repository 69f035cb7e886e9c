"""Work-precision as interactive plots, a plot for each pair of work and error, and the profile over all targets."""

import math
from collections.abc import Sequence

import numpy as np

from reports.pages.work_points import ERRORS, WORKS, Field, Profile, Work, ended
from reports.plots import Axis, Plot, Trace

NEAR = 100.0  # the reference's own error is drawn where a point comes that close to it
ZERO = 20.0  # zeros are put so many times below the smallest value above zero


def plots_of(f: Field) -> dict[str, Plot]:
    """By ``<error>-<work>``; pairs that no run has are left out."""
    out = {}
    for error, error_words, error_unit in ERRORS:
        title, unit = (f.kind.split(" [")[0], f.kind.partition(" [")[2].rstrip("]")) if error == "error" else (
            error_words, error_unit)  # fmt: skip
        for work, work_words, work_unit in WORKS:
            points = [p for p in f.points if _good(p.works[work]) and _good(p.errors[error])]
            if points:
                axes = Axis(work_words, work_unit, log=True), Axis(title, unit, log=True)
                traces = _traces(points, work, error, f.own if error == "error" else math.nan)
                name = f"{f.slug}-{error}-{work}"
                out[f"{error}-{work}"] = Plot(name, f"{title} over {work_words}", "", *axes, traces)
    return out


def profile_plot(found: Sequence[Profile], work: str) -> Plot:
    """The share of all targets reached, over work; the line ends where the solver's last run does."""
    own = [p for p in found if p.work == work]
    traces = []
    for p in own:
        x, y = steps_of(p)
        name = f"{p.solver}, {'best of its settings' if p.tuned else 'default settings'}: {len(p.at)} of {p.total}"
        traces.append(Trace(name, x, y, solver=p.solver, dash=0 if p.tuned else 2))
    right = max((p.at[-1] for p in own if p.at), default=1.0)
    words, unit = named(work)
    return Plot(f"profile-{work}", f"Targets reached over {words}", "", Axis(words, unit, log=True, high=2.0 * right),
                Axis("share of all targets reached", "", low=0.0, high=1.0), tuple(traces), wide=True)  # fmt: skip


def named(work: str) -> tuple[str, str]:
    """A kind of work in words, and its unit."""
    for key, words, unit in WORKS:
        if work in (key, f"{key}_{unit}", words):
            return words, unit
    return work.replace("_", " "), ""


def steps_of(p: Profile) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the step line: up by one target where it is reached."""
    count = np.arange(1, len(p.at) + 1) / max(p.total, 1)
    x = np.repeat(np.array(p.at, dtype=float), 2)
    y = np.empty(2 * len(p.at))
    y[0::2], y[1::2] = count - 1.0 / max(p.total, 1), count
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
    for method in sorted({p.method for p in points}):
        family = sorted((p for p in points if p.method == method), key=lambda p: (p.label, -p.fineness))
        for label in dict.fromkeys(p.label for p in family):
            group = [p for p in family if p.label == label]
            x, y = (np.array([spots[id(p)][k] for p in group]) for k in (0, 1))
            out.append(Trace(
                f"{method}, {label}" if label else method, x, y, solver=group[0].solver, mode="lines+markers",
                dash=0 if group[0].default else 1, main=group[0].default or any(p.best for p in group),
                ends=[ended(p.status) for p in group], urls=[p.page for p in group], words=[said(p) for p in group],
            ))  # fmt: skip
    best = [p for p in points if p.best]
    if best:
        x, y = (np.array([spots[id(p)][k] for p in best]) for k in (0, 1))
        words = [f"on its solver's envelope: {said(p)}" for p in best]
        urls = [p.page for p in best]
        out.append(Trace("best-tuned", x, y, mode="markers", hollow=True, words=words, urls=urls))
    return tuple(out)


def said(p: Work) -> str:
    """A point in words."""
    marks = [
        w
        for w, on in (
            ("default settings", p.default),
            ("no other run of its solver is cheaper and as accurate", p.best),
        )
        if on
    ]
    return ", ".join([p.words, *marks, *([p.status.replace("_", " ")] if p.status != "success" else [])])


def _good(value: float) -> bool:
    return math.isfinite(value) and value >= 0.0


def _zero(values: Sequence[float]) -> float:
    above = [v for v in values if v > 0.0]
    return min(above) / ZERO if above else 1e-16
