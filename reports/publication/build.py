"""Publication figures and tables of a run, in ``publication/``: PDF, SVG, LaTeX, CSV, and ``captions.json``."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from ...harness.results import store
from ...harness.results.series import BadSeries
from ..model.motion import Motion, motion_of
from ..model.results import Results, Run, Variant, read_results, slug
from ..plots.palette import looks
from ..plots.printed.lines import Group
from . import tables
from .figures import Printed, figures_of, work_of
from .style import save

FOLDER = "publication"
SUFFIXES = ("pdf", "svg")
MOST = 14  # lines in one figure; more are parted by solver
LEAST = 2  # runs of a problem: with fewer there is nothing to compare
MAP = 2 * MOST  # runs of one label: with more it is a map of settings, for tables and work alone


def command(run_folder: Path, only: Sequence[str], tell: Callable[[str], None]) -> list[Path]:
    """What ``mbsbench figures`` does; ``only`` are names of variants."""
    results = read_results(Path(run_folder), check_series=False)
    variants = [p for p in results.variants if p.title in only or p.problem in only or not only]
    known = {p.title for p in results.variants} | {p.problem for p in results.variants}
    unknown = [name for name in only if name not in known]
    if unknown:
        raise ValueError(f"no problem {unknown[0]!r} in this run; there are {', '.join(sorted(known))}")
    folder = Path(run_folder) / FOLDER
    captions: list[dict[str, object]] = []
    files: list[Path] = []
    for variant in variants:
        files += tables.write(variant, folder, variant.slug)
        for printed in _figures(results, variant):
            made = save(printed.draw, folder, printed.name, SUFFIXES)
            files += made
            said = {"name": printed.name, "caption": printed.caption, "problem": variant.title}
            captions.append({**said, "width_mm": round(printed.width * 25.4, 1), "files": [p.name for p in made]})
        maps = [label or "no label" for label, runs in variant.labels().items() if len(runs) > MAP]
        left = f"; too many for lines over time: {', '.join(maps)}" if maps else ""
        tell(f"{variant.title}: {len(variant.runs)} runs{left}")
    store.write_text(folder / "captions.json", json.dumps(captions, indent=1, ensure_ascii=False))
    return files


def _figures(results: Results, variant: Variant) -> Iterator[Printed]:
    own = looks(results.solvers)
    taken: set[str] = set()
    bare = Group(tuple(Motion(c) for c in variant.runs), own)  # work needs no curves
    if len(variant.runs) >= LEAST and (printed := work_of(variant.slug, variant.title, bare)):
        yield printed
    for label, runs in variant.labels().items():
        if len(runs) > MAP:
            continue
        motions = {c.record.run_id: _motion(results, c) for c in runs}

        def group(part: Sequence[Run], motions: Mapping[str, Motion] = motions) -> Group:
            return Group(tuple(motions[c.record.run_id] for c in part), own)

        for part in parts(runs):
            base = slug(f"{variant.slug}-{label or 'all'}", taken)
            yield from figures_of(base, f"{variant.title}, {label or 'all runs'}", group(part))


def _motion(results: Results, run: Run) -> Motion:
    """Without curves where the series file is damaged."""
    try:
        return motion_of(results, run)
    except BadSeries:
        return Motion(run)


def parts(runs: Sequence[Run]) -> list[list[Run]]:
    """Whole solvers together, as many lines as one figure can bear."""
    out: list[list[Run]] = [[]]
    for solver in dict.fromkeys(c.record.solver for c in runs):
        own = [c for c in runs if c.record.solver == solver]
        if out[-1] and len(out[-1]) + len(own) > MOST:
            out.append([])
        out[-1] += own
    return out
