"""The paper's figures of a run: ``paper/fig01.pdf`` to ``fig12``, with their notes in ``paper/captions.json``."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

from harness import store
from reports.palette import looks
from reports.paper.catalogue import FIGURES
from reports.paper.drawer import draw
from reports.paper.lines import lines_of
from reports.paper.notes import Caption, caption, claims_of, jsonable
from reports.paper.picking import choose
from reports.paper.spec import PaperFigure
from reports.publication.style import SUFFIXES, save
from reports.reading import Run, read_run

FOLDER = "paper"


def build(
    run_folder: Path,
    specs: Sequence[PaperFigure] = FIGURES,
    suffixes: Sequence[str] = SUFFIXES,
    tell: Callable[[str], None] = lambda words: None,
) -> list[Caption]:
    """Write all figures and the captions; what each is called is told as it is done."""
    run = read_run(Path(run_folder))
    out = []
    for spec in specs:
        out.append(one(run, spec, suffixes))
        missing = sum(not c["found"] for c in out[-1].cells)
        tell(f"{spec.name}: {spec.title}" + (f" ({missing} of {len(spec.picks)} cells missing)" if missing else ""))
    plain = {"run": run.environment.get("run") or run.folder.name, "commit": run.environment.get("commit", ""),
             "figures": [jsonable(asdict(c)) for c in out]}  # fmt: skip
    store.write_text(
        Path(run_folder) / FOLDER / "captions.json", json.dumps(plain, indent=1, ensure_ascii=False, allow_nan=False)
    )
    return out


def one(run: Run, spec: PaperFigure, suffixes: Sequence[str] = SUFFIXES) -> Caption:
    """Draw one figure and write its caption."""
    chosen = choose(spec.picks, run.cells)
    series = {c.cell.record.cell: run.series(c.cell) for c in chosen if c.cell}
    own = looks({*run.solvers, *(p.solver for p in spec.picks)})
    files = save(lambda: draw(spec, chosen, series, own), run.folder / FOLDER, spec.name, suffixes)
    return caption(spec, lines_of(chosen, series, own), claims_of(run.folder), [p.name for p in files])


def command(run_folder: Path, only: Sequence[str], tell: Callable[[str], None]) -> list[Caption]:
    """What ``python -m harness figures --paper`` does; ``only`` are names of figures."""
    unknown = [name for name in only if name not in {s.name for s in FIGURES}]
    if unknown:
        raise ValueError(f"no figure {unknown[0]!r}; there are {', '.join(s.name for s in FIGURES)}")
    chosen = [s for s in FIGURES if s.name in only or not only]
    return build(run_folder, chosen, tell=tell)
