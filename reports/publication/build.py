"""Publication figures and tables of a run, in ``publication/``: PDF, SVG, LaTeX, CSV, and ``captions.json``."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from ...harness.results import store
from ...harness.results.series import BadSeries
from ..model.motion import Motion, motion_of
from ..model.reading import Cell, Posing, Run, read_run, slug
from ..plots.palette import looks
from ..plots.printed.lines import Group
from . import tables
from .figures import Printed, figures_of, work_of
from .style import save

FOLDER = "publication"
SUFFIXES = ("pdf", "svg")
MOST = 14  # lines in one figure; more are parted by solver
LEAST = 2  # cells of a problem: with fewer there is nothing to compare
MAP = 2 * MOST  # cells of one label: with more it is a map of settings, for tables and work alone


def command(run_folder: Path, only: Sequence[str], tell: Callable[[str], None]) -> list[Path]:
    """What ``mbsbench figures`` does; ``only`` are names of problems as posed."""
    run = read_run(Path(run_folder), check_series=False)
    posings = [p for p in run.posings if p.title in only or p.problem in only or not only]
    known = {p.title for p in run.posings} | {p.problem for p in run.posings}
    unknown = [name for name in only if name not in known]
    if unknown:
        raise ValueError(f"no problem {unknown[0]!r} in this run; there are {', '.join(sorted(known))}")
    folder = Path(run_folder) / FOLDER
    captions: list[dict[str, object]] = []
    files: list[Path] = []
    for posing in posings:
        files += tables.write(posing, folder, posing.slug)
        for printed in _figures(run, posing):
            made = save(printed.draw, folder, printed.name, SUFFIXES)
            files += made
            said = {"name": printed.name, "caption": printed.caption, "problem": posing.title}
            captions.append({**said, "width_mm": round(printed.width * 25.4, 1), "files": [p.name for p in made]})
        maps = [label or "no label" for label, cells in posing.labels().items() if len(cells) > MAP]
        left = f"; too many for lines over time: {', '.join(maps)}" if maps else ""
        tell(f"{posing.title}: {len(posing.cells)} cells{left}")
    store.write_text(folder / "captions.json", json.dumps(captions, indent=1, ensure_ascii=False))
    return files


def _figures(run: Run, posing: Posing) -> Iterator[Printed]:
    own = looks(run.solvers)
    taken: set[str] = set()
    bare = Group(tuple(Motion(c) for c in posing.cells), own)  # work needs no curves
    if len(posing.cells) >= LEAST and (printed := work_of(posing.slug, posing.title, bare)):
        yield printed
    for label, cells in posing.labels().items():
        if len(cells) > MAP:
            continue
        motions = {c.record.cell: _motion(run, c) for c in cells}

        def group(part: Sequence[Cell], motions: Mapping[str, Motion] = motions) -> Group:
            return Group(tuple(motions[c.record.cell] for c in part), own)

        for part in parts(cells):
            base = slug(f"{posing.slug}-{label or 'all'}", taken)
            yield from figures_of(base, f"{posing.title}, {label or 'all cells'}", group(part))


def _motion(run: Run, cell: Cell) -> Motion:
    """Without curves where the series file is damaged."""
    try:
        return motion_of(run, cell)
    except BadSeries:
        return Motion(cell)


def parts(cells: Sequence[Cell]) -> list[list[Cell]]:
    """Whole solvers together, as many lines as one figure can bear."""
    out: list[list[Cell]] = [[]]
    for solver in dict.fromkeys(c.record.solver for c in cells):
        own = [c for c in cells if c.record.solver == solver]
        if out[-1] and len(out[-1]) + len(own) > MOST:
            out.append([])
        out[-1] += own
    return out
