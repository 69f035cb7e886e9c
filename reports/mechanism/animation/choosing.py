"""Which cells are shown: those asked for, or of each solver its best."""

from collections.abc import Sequence
from pathlib import Path

from ....harness.results import store
from ...model.reading import Cell

MOST = 6  # mechanisms that one picture has room for


def cells_of(folder: Path) -> list[Cell]:
    """All cells of a run that kept a series."""
    return [Cell(r) for r in store.load(folder, check_series=False).records if r.series]


def choose(cells: Sequence[Cell], problem: str, asked: Sequence[str]) -> list[Cell]:
    """Cells of one problem as posed, in the order asked for."""
    posed = _posed(cells, problem)
    if not asked:
        return [_best(posed, s) for s in dict.fromkeys(c.record.solver for c in posed)][:MOST]
    if len(asked) > MOST:
        raise ValueError(f"at most {MOST} cells have room in a picture (got {len(asked)})")
    return [_one(posed, text) for text in asked]


def _posed(cells: Sequence[Cell], problem: str) -> list[Cell]:
    found = [c for c in cells if c.posing == problem]
    if found:
        return found
    posings = sorted({c.posing for c in cells if c.record.problem == problem})
    if len(posings) == 1:
        return [c for c in cells if c.posing == posings[0]]
    known = posings or sorted({c.posing for c in cells})
    if not known:
        raise ValueError("no cell of this run kept a motion")
    raise ValueError(f"no motion of {problem!r} in this run; there are {', '.join(known)}")


def _one(cells: Sequence[Cell], text: str) -> Cell:
    if any(c.record.solver == text for c in cells):
        return _best(cells, text)
    found = [c for c in cells if c.record.cell.startswith(text)]
    if len(found) != 1:
        names = ", ".join(sorted({c.record.solver for c in cells}))
        what = "is no cell of this problem" if not found else f"begins the names of {len(found)} cells"
        raise ValueError(f"{text!r} {what}; solvers are {names}, cells are named by their 16 digits")
    return found[0]


def _best(cells: Sequence[Cell], solver: str) -> Cell:
    """A success if there is one, else the one that came furthest; of these the soundest settings, then the finest."""
    own = [c for c in cells if c.record.solver == solver]
    return min(own, key=lambda c: (not c.succeeded, -c.record.t_reached_s, len(c.options), c.fineness, c.record.case))
