"""The paper's figures of a run: ``paper/fig01.pdf`` to ``fig12``, with their notes in ``paper/captions.json``."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ...harness.results import store
from ...harness.results.series import BadSeries, Series
from ..model.results import Results, Run, read_results
from ..plots.palette import looks
from ..plots.style import SUFFIXES, save
from .catalogue import FIGURES
from .drawer import draw
from .lines import lines_of
from .notes import Caption, caption, claims_of, jsonable
from .picking import choose
from .spec import PaperFigure

FOLDER = "paper"


def build(
    run_folder: Path,
    specs: Sequence[PaperFigure] = FIGURES,
    suffixes: Sequence[str] = SUFFIXES,
    tell: Callable[[str], None] = lambda words: None,
) -> list[Caption]:
    """Write all figures and the captions; what each is called is told as it is done."""
    results = read_results(Path(run_folder), check_series=False)
    out = []
    for spec in specs:
        out.append(one(results, spec, suffixes))
        missing = sum(not c["found"] for c in out[-1].runs)
        tell(f"{spec.name}: {spec.title}" + (f" ({missing} of {len(spec.picks)} runs missing)" if missing else ""))
    figures = _others(results.folder, out) + [jsonable(asdict(c)) for c in out]
    order = [s.name for s in FIGURES]
    figures.sort(key=lambda f: order.index(f["name"]))
    plain = {"run": results.environment.get("run") or results.folder.name,
             "commit": results.environment.get("commit", ""),
             "figures": figures}  # fmt: skip
    path = Path(run_folder) / FOLDER / "captions.json"
    store.write_text(path, json.dumps(plain, indent=1, ensure_ascii=False, allow_nan=False))
    return out


def one(results: Results, spec: PaperFigure, suffixes: Sequence[str] = SUFFIXES) -> Caption:
    """Draw one figure and write its caption."""
    chosen = choose(spec.picks, results.runs)
    series = {c.run.record.run_id: _series(results, c.run) for c in chosen if c.run}
    own = looks({*results.solvers, *(p.solver for p in spec.picks)})
    files = save(lambda: draw(spec, chosen, series, own), results.folder / FOLDER, spec.name, suffixes)
    return caption(spec, lines_of(chosen, series, own), claims_of(results.folder), [p.name for p in files])


def _series(results: Results, run: Run) -> Series | None:
    """None where the file is damaged: the figure says so."""
    try:
        return results.series(run)
    except BadSeries:
        return None


def _others(folder: Path, made: Sequence[Caption]) -> list[dict[str, Any]]:
    """Captions of figures made before and not now."""
    try:
        found = json.loads((folder / FOLDER / "captions.json").read_text(encoding="utf-8"))["figures"]
        return [f for f in found if f["name"] in {s.name for s in FIGURES} - {c.name for c in made}]
    except (OSError, ValueError, KeyError, TypeError):
        return []


def command(run_folder: Path, only: Sequence[str], tell: Callable[[str], None]) -> list[Caption]:
    """What ``mbsbench figures --paper`` does; ``only`` are names of figures."""
    unknown = [name for name in only if name not in {s.name for s in FIGURES}]
    if unknown:
        raise ValueError(f"no figure {unknown[0]!r}; there are {', '.join(s.name for s in FIGURES)}")
    chosen = [s for s in FIGURES if s.name in only or not only]
    return build(run_folder, chosen, tell=tell)
