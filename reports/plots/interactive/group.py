"""The cells of a problem as lines: who is drawn, with which dash, and which stands for its solver."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...model.curves import Curve, level
from ...model.motion import Motion
from ...model.reading import Cell, Posing
from ...model.settings import shared_options
from ...model.words import time
from ..spec import Trace

MOST = 16  # cells drawn under one label: more cannot be told apart
EVER = 24  # on one page, or it would grow without end


@dataclass(frozen=True)
class Line:
    """A cell in the plots of its problem."""

    cell: Cell
    words: str
    dash: int
    main: bool  # the finest settings of its solver under its label
    url: str

    @property
    def end(self) -> str:
        return "failed" if self.cell.stopped else "wrong" if self.cell.status == "wrong" else ""


def lines_of(posing: Posing, url: Callable[[Cell], str]) -> list[Line]:
    """Of every label the finest cell of each solver, then wrong and failed ones, then the rest."""
    alike = shared_options(posing.cells)
    rank: dict[str, int] = {}
    chosen: list[Cell] = []
    for cells in posing.labels().values():
        for solver in dict.fromkeys(c.record.solver for c in cells):
            own = sorted((c for c in cells if c.record.solver == solver), key=_first)
            rank |= {c.record.cell: k for k, c in enumerate(own)}
        chosen += sorted(cells, key=lambda c: _urgency(c, rank))[:MOST]
    kept = {c.record.cell for c in sorted(chosen, key=lambda c: _urgency(c, rank))[:EVER]}
    return [
        _line(c, rank[c.record.cell], alike[c.record.solver], url(c))
        for cells in posing.labels().values()
        for c in cells
        if c.record.cell in kept
    ]


def _urgency(cell: Cell, rank: Mapping[str, int]) -> tuple[bool, bool, int]:
    return rank[cell.record.cell] > 0, cell.succeeded, rank[cell.record.cell]


def _first(cell: Cell) -> tuple[float, int, str]:
    return cell.fineness, len(cell.options), cell.record.case


def _line(cell: Cell, rank: int, alike: frozenset[str], url: str) -> Line:
    r = cell.record
    word = cell.status.replace("_", " ")
    how = "" if cell.succeeded else f" ★ {word} at {time(r.t_reached_s)} s" if cell.stopped else f" ✗ {word}"
    return Line(cell, f"{r.solver}, {cell.settings(alike)}{how}", rank % 4, rank == 0, url)


def traces(
    lines: Sequence[Line],
    motions: Mapping[str, Motion],
    of: Callable[[Motion], Curve | None],
    limits: tuple | None = None,
) -> list[Trace]:
    """One a cell that has the curve; cut to ``limits`` where they are given."""
    out = []
    for line in lines:
        curve = of(motions[line.cell.record.cell])
        if curve is None or not len(curve):
            continue
        if limits is not None:
            low, high = (None if e is None else np.clip(e, *limits) for e in (curve.low, curve.high))
            curve = Curve(curve.t, np.clip(curve.y, *limits), low, high)
        curve = level(curve)
        low, high = curve.low, curve.high
        if low is not None and high is not None and np.array_equal(low, high):
            low = high = None
        r = line.cell.record
        out.append(Trace(line.words, curve.t, curve.y, solver=r.solver, dash=line.dash, low=low, high=high,
                         group=r.label, main=line.main, end=line.end, urls=(line.url,)))  # fmt: skip
    return out
