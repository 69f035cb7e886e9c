"""The runs of a problem as lines: which are drawn, with which dash, and which stands for its solver."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..model.curves import Curve, level, reach, span
from ..model.results import Run, Variant, by_solver
from ..model.words import time
from .spec import Trace, end_of

MOST = 16  # runs drawn under one label: more cannot be distinguished
WIDE = 0.006  # of what is shown: two pixels of a panel
EVER = 24  # on one page, or it would grow without end


@dataclass(frozen=True)
class Line:
    """A run in the plots of its problem."""

    run: Run
    words: str
    dash: int
    main: bool  # the finest settings of its solver under its label
    url: str = ""
    who: str = ""  # the solver with the paper's name of it


def lines_of(variant: Variant, url: Callable[[Run], str], ever: int = EVER) -> list[Line]:
    """Lines of every label: each solver's finest run, then wrong and failed runs, then others; ``ever`` at most."""
    chosen: list[Line] = []
    for runs in variant.labels().values():
        chosen += sorted(all_lines(runs, shared_options(variant.runs), url), key=_urgency)[:MOST]
    kept = {line.run.record.run_id: line for line in sorted(chosen, key=_urgency)[:ever]}
    ordered = (c.record.run_id for runs in variant.labels().values() for c in runs)
    return [kept[name] for name in ordered if name in kept]


def all_lines(runs: Sequence[Run], alike: Mapping[str, frozenset[str]],
              url: Callable[[Run], str] = lambda run: "") -> list[Line]:  # fmt: skip
    """Lines of ``runs``, all under one label; options in ``alike`` are left out of their words."""
    found: dict[str, Line] = {}
    for solver, own in by_solver(runs).items():
        for k, c in enumerate(sorted(own, key=lambda c: c.finest_first)):
            named = f"{solver} [{label}]" if (label := c.record.paper_label) else solver
            words = f"{named}, {c.settings(alike[solver])}{describe_end(c)}"
            found[c.record.run_id] = Line(c, words, k, k == 0, url(c), named)
    return [found[c.record.run_id] for c in runs]


def shared_options(runs: Iterable[Run]) -> dict[str, frozenset[str]]:
    """By solver, the options (and ``max_step``) that all its runs have alike."""
    out: dict[str, frozenset[str]] = {}
    for name, own in by_solver(runs).items():
        alike = {k for k in own[0].options if all(c.options.get(k) == own[0].options[k] for c in own)}
        if all(c.record.max_step_s == own[0].record.max_step_s for c in own):
            alike.add("max_step")
        out[name] = frozenset(alike)
    return out


def traces(drawn: Iterable[tuple[Line, Curve]], limits: tuple[float, float], floor: float | None = None) -> list[Trace]:
    """One a run, cut to ``limits``; on a logarithmic axis what is below ``floor`` is rounding.

    Each says what stretch of the axis it needs: those that are hidden take none.
    """
    out = []
    for line, curve in drawn:
        ends = reach(curve, floor) if floor is not None else span(curve, limits)
        low, high = (None if e is None else np.clip(e, *limits) for e in (curve.low, curve.high))
        curve = level(Curve(curve.t, np.clip(curve.y, *limits), low, high))
        low, high = curve.low, curve.high
        if low is not None and high is not None and np.array_equal(low, high):
            low = high = None
        r = line.run.record
        out.append(Trace(
            line.words, curve.t, curve.y, solver=r.solver, who=line.who, dash=line.dash, low=low, high=high,
            group=r.label, main=line.main, end=end_of(r.status), urls=(line.url,),
            reach=tuple(float(f"{v:.3g}") for v in ends or ()),
        ))  # fmt: skip
    return told_apart(out, floor)


def told_apart(found: Sequence[Trace], floor: float | None = None) -> list[Trace]:
    """With a dash and a word for the main line of a solver that lies on another one: below it would not be seen."""
    out: list[Trace] = []
    for t in found:
        below = [o for o in out if o.main and o.group == t.group and coincide(o, t, floor)] if t.main else []
        name = f"{t.name}, coincides with {below[0].solver}" if below else t.name
        out.append(replace(t, name=name, dash=len(below) % 3) if below else t)
    return out


def coincide(a: Trace, b: Trace, floor: float | None) -> bool:
    """Nowhere further apart than a line is wide, and as long; with a ``floor`` the axis is logarithmic."""
    ya, yb = (t.y if floor is None else np.log10(np.maximum(t.y, floor)) for t in (a, b))
    both = b.x[(b.x >= a.x[0]) & (b.x <= a.x[-1])]
    if len(both) < len(b.x) / 2 or abs(a.x[-1] - b.x[-1]) > WIDE * a.x[-1]:
        return False
    apart = np.abs(np.interp(both, a.x, ya) - np.interp(both, b.x, yb))
    return bool(np.max(apart) <= WIDE * max(np.ptp(ya), np.ptp(yb)))


def _urgency(line: Line) -> tuple[bool, bool, int]:
    return not line.main, line.run.is_success, line.dash


def describe_end(run: Run) -> str:
    """For the name of its line; empty for a success."""
    word, r = run.status.replace("_", " "), run.record
    if run.is_success:
        return ""
    if run.status == "refused" or not (r.steps and r.t_reached_s > 0.0):
        return f" ★ no step: {word}"
    return f" ★ {word} at {time(r.t_reached_s)} s" if run.has_stopped else f" ✗ {word}"
