"""The paper's figures from results: ``paper/fig01.pdf`` to ``fig12``, with notes in ``paper/captions.json``."""

from collections.abc import Callable, Sequence
from pathlib import Path

from ...harness.places import Place
from ..model.results import Results, read_results
from ..plots.palette import looks
from ..plots.style import SUFFIXES, save
from .captions import FOLDER, Caption, write
from .catalogue import FIGURES
from .drawer import draw
from .lines import Line, lines_of
from .notes import caption
from .picking import Asked, choose
from .spec import PaperFigure


def command(folder: Path, only: Sequence[str], specs: Sequence[Asked], tell: Callable[[str], None] = lambda words: None,
            suffixes: Sequence[str] = SUFFIXES) -> list[Caption]:  # fmt: skip
    """The command ``mbsbench figures --paper``; ``only`` are names of figures, ``specs`` the runs of the suite."""
    names = [s.name for s in FIGURES]
    unknown = [name for name in only if name not in names]
    if unknown:
        raise ValueError(f"no figure {unknown[0]!r}; there are {', '.join(names)}")
    results, out = read_results(Path(folder), check_series=False), []
    for figure in (s for s in FIGURES if s.name in only or not only):
        out.append(one(results, figure, specs, suffixes))
        missing = sum(not c.found for c in out[-1].runs)
        words = f" ({missing} of {len(out[-1].runs)} runs missing)" if missing else ""
        tell(f"{figure.name}: {figure.title}{words}")
    write(results.folder, results.environment, out, names)
    return out


def one(results: Results, figure: PaperFigure, specs: Sequence[Asked], suffixes: Sequence[str] = SUFFIXES) -> Caption:
    """Draw one figure and write its caption."""
    lines = found_lines(results, figure, specs)
    own = looks({*results.solvers, *(k.chosen.asked.solver for k in lines)})
    files = save(lambda: draw(figure, lines, own), Place(results.folder) / FOLDER, figure.name, suffixes)
    return caption(figure, lines, results.folder, [p.name for p in files])


def found_lines(results: Results, figure: PaperFigure, specs: Sequence[Asked]) -> list[Line]:
    """The runs of a figure with their series."""
    chosen = choose(figure.picks, specs, results.runs)
    return lines_of(chosen, {c.run.record.run_id: results.readable_series(c.run) for c in chosen if c.run})
