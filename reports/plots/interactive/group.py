"""The runs of a problem as lines: who is drawn, with which dash, and which stands for its solver."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...model.curves import Curve, level
from ...model.motion import Motion
from ...model.results import Run, Variant
from ...model.settings import shared_options
from ...model.words import time
from ..spec import Trace

MOST = 16  # runs drawn under one label: more cannot be told apart
EVER = 24  # on one page, or it would grow without end


@dataclass(frozen=True)
class Line:
    """A run in the plots of its problem."""

    run: Run
    words: str
    dash: int
    main: bool  # the finest settings of its solver under its label
    url: str

    @property
    def end(self) -> str:
        return "failed" if self.run.stopped else "wrong" if self.run.status == "wrong" else ""


def lines_of(variant: Variant, url: Callable[[Run], str]) -> list[Line]:
    """Of every label the finest run of each solver, then wrong and failed ones, then the rest."""
    alike = shared_options(variant.runs)
    rank: dict[str, int] = {}
    chosen: list[Run] = []
    for runs in variant.labels().values():
        for solver in dict.fromkeys(c.record.solver for c in runs):
            own = sorted((c for c in runs if c.record.solver == solver), key=_first)
            rank |= {c.record.run_id: k for k, c in enumerate(own)}
        chosen += sorted(runs, key=lambda c: _urgency(c, rank))[:MOST]
    kept = {c.record.run_id for c in sorted(chosen, key=lambda c: _urgency(c, rank))[:EVER]}
    return [
        _line(c, rank[c.record.run_id], alike[c.record.solver], url(c))
        for runs in variant.labels().values()
        for c in runs
        if c.record.run_id in kept
    ]


def _urgency(run: Run, rank: Mapping[str, int]) -> tuple[bool, bool, int]:
    return rank[run.record.run_id] > 0, run.succeeded, rank[run.record.run_id]


def _first(run: Run) -> tuple[float, int, str]:
    return run.fineness, len(run.options), run.record.case


def _line(run: Run, rank: int, alike: frozenset[str], url: str) -> Line:
    r = run.record
    word = run.status.replace("_", " ")
    how = "" if run.succeeded else f" ★ {word} at {time(r.t_reached_s)} s" if run.stopped else f" ✗ {word}"
    return Line(run, f"{r.solver}, {run.settings(alike)}{how}", rank % 4, rank == 0, url)


def traces(
    lines: Sequence[Line],
    motions: Mapping[str, Motion],
    of: Callable[[Motion], Curve | None],
    limits: tuple | None = None,
) -> list[Trace]:
    """One a run that has the curve; cut to ``limits`` where they are given."""
    out = []
    for line in lines:
        curve = of(motions[line.run.record.run_id])
        if curve is None or not len(curve):
            continue
        if limits is not None:
            low, high = (None if e is None else np.clip(e, *limits) for e in (curve.low, curve.high))
            curve = Curve(curve.t, np.clip(curve.y, *limits), low, high)
        curve = level(curve)
        low, high = curve.low, curve.high
        if low is not None and high is not None and np.array_equal(low, high):
            low = high = None
        r = line.run.record
        out.append(Trace(line.words, curve.t, curve.y, solver=r.solver, dash=line.dash, low=low, high=high,
                         group=r.label, main=line.main, end=line.end, urls=(line.url,)))  # fmt: skip
    return out
