"""Select which runs of a problem are drawn as lines, with which dash, and which represents its solver."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..model.curves import Curve, drop_repeated, find_log_range, find_range
from ..model.results import StoredRun, Variant, group_by_solver
from ..model.words import time
from .spec import Trace, choose_end_mark

MOST = 16  # most runs drawn under one label: more cannot be distinguished
WIDE = 0.006  # fraction of the axis: two pixels of a panel
EVER = 24  # most lines on one page, which bounds its size


@dataclass(frozen=True)
class Line:
    """A run in the plots of its problem."""

    run: StoredRun
    words: str  # its name in legends: solver, settings, and how it ended
    dash: int  # 0 for its solver's finest settings, then 1, 2, ...
    main: bool  # True for the finest settings of its solver under its label
    url: str = ""
    who: str = ""  # the solver with its name in the paper


def choose_lines(variant: Variant, url: Callable[[StoredRun], str], most: int = EVER) -> list[Line]:
    """Return at most ``most`` lines, and ``MOST`` a label: solvers' finest runs, then failures, then finer settings.

    They are returned in the order of labels and runs. ``url`` gives the address of a run's page.
    """
    chosen: list[Line] = []
    for runs in variant.labels().values():
        chosen += sorted(make_lines(runs, find_shared_options(variant.runs), url), key=_make_urgency_key)[:MOST]
    kept = {line.run.record.run_id: line for line in sorted(chosen, key=_make_urgency_key)[:most]}
    ordered = (c.record.run_id for runs in variant.labels().values() for c in runs)
    return [kept[name] for name in ordered if name in kept]


def make_lines(
    runs: Sequence[StoredRun], alike: Mapping[str, frozenset[str]], url: Callable[[StoredRun], str] = lambda run: ""
) -> list[Line]:
    """Return a line for each run, with dashes counted by solver from its finest run on.

    Names of lines leave out the options in ``alike``, those that all runs of a solver share.
    """
    found: dict[str, Line] = {}
    for solver, own in group_by_solver(runs).items():
        for k, c in enumerate(sorted(own, key=lambda c: c.finest_first)):
            named = f"{solver} [{label}]" if (label := c.record.paper_label) else solver
            words = f"{named}, {c.settings(alike[solver])}{describe_end(c)}"
            found[c.record.run_id] = Line(c, words, k, k == 0, url(c), named)
    return [found[c.record.run_id] for c in runs]


def find_shared_options(runs: Iterable[StoredRun]) -> dict[str, frozenset[str]]:
    """Return by solver the options (and ``max_step``) that are equal in all its runs."""
    out: dict[str, frozenset[str]] = {}
    for name, own in group_by_solver(runs).items():
        alike = {k for k in own[0].options if all(c.options.get(k) == own[0].options[k] for c in own)}
        if all(c.record.max_step_s == own[0].record.max_step_s for c in own):
            alike.add("max_step")
        out[name] = frozenset(alike)
    return out


def make_traces(
    drawn: Iterable[tuple[Line, Curve]], limits: tuple[float, float], floor: float | None = None
) -> list[Trace]:
    """Return a trace per line, cut to ``limits``; lines that coincide are distinguished.

    With a ``floor`` the axis is logarithmic, and values below it are rounding. Each trace states the range of the axis
    that it needs, so that a hidden trace takes no room.
    """
    out = []
    for line, curve in drawn:
        ends = find_log_range(curve, floor) if floor is not None else find_range(curve, limits)
        low, high = (None if e is None else np.clip(e, *limits) for e in (curve.low, curve.high))
        curve = drop_repeated(Curve(curve.t, np.clip(curve.y, *limits), low, high))
        low, high = curve.low, curve.high
        if low is not None and high is not None and np.array_equal(low, high):
            low = high = None
        r = line.run.record
        out.append(
            Trace(
                line.words,
                curve.t,
                curve.y,
                solver=r.solver,
                who=line.who,
                dash=line.dash,
                low=low,
                high=high,
                group=r.label,
                main=line.main,
                end=choose_end_mark(r.status),
                urls=(line.url,),
                reach=tuple(float(f"{v:.3g}") for v in ends or ()),
            )
        )
    return distinguish_lines(out, floor)


def distinguish_lines(found: Sequence[Trace], floor: float | None = None) -> list[Trace]:
    """Return the traces; a main line that coincides with an earlier one gets a dash and a note in its name."""
    out: list[Trace] = []
    for t in found:
        below = [o for o in out if o.main and o.group == t.group and coincide(o, t, floor)] if t.main else []
        name = f"{t.name}, coincides with {below[0].solver}" if below else t.name
        out.append(replace(t, name=name, dash=len(below) % 3) if below else t)
    return out


def coincide(a: Trace, b: Trace, floor: float | None) -> bool:
    """Return whether two traces differ by less than a line's width, where both have points, and end together.

    With a ``floor`` the axis is logarithmic and lower values count as the floor.
    """
    ya, yb = (t.y if floor is None else np.log10(np.maximum(t.y, floor)) for t in (a, b))
    both = b.x[(b.x >= a.x[0]) & (b.x <= a.x[-1])]
    if len(both) < len(b.x) / 2 or abs(a.x[-1] - b.x[-1]) > WIDE * a.x[-1]:
        return False
    distance = np.abs(np.interp(both, a.x, ya) - np.interp(both, b.x, yb))
    return bool(np.max(distance) <= WIDE * max(np.ptp(ya), np.ptp(yb)))


def _make_urgency_key(line: Line) -> tuple[bool, bool, int]:
    """Return the sort key of lines to draw: solvers' finest runs first, then failures, then finer settings."""
    return not line.main, line.run.is_success, line.dash


def describe_end(run: StoredRun) -> str:
    """Describe how a run ended, for the name of its line; empty for a success."""
    word, r = run.status.replace("_", " "), run.record
    if run.is_success:
        return ""
    if run.status == "refused" or not (r.steps and r.t_reached_s > 0.0):
        return f" ★ no step: {word}"
    return f" ★ {word} at {time(r.t_reached_s)} s" if run.has_stopped else f" ✗ {word}"
