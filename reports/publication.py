"""Write publication figures and tables of results into ``publication/``: a folder per problem, an index, captions."""

import json
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from ..harness.base.confined_paths import ConfinedPath
from .model.accuracy import choose_measure
from .model.floats import format_floats
from .model.heat import HeatMap, make_heat_map
from .model.margin import LEVELS
from .model.results import StoredResults, StoredRun, Variant, group_by_solver, make_slug, read_results
from .model.tables import write_tables
from .plots.convergence import make_convergence_plots
from .plots.fonts import DEFAULT_FONT, Font
from .plots.laws import draw_runs, plot_laws
from .plots.paper import (
    DOUBLE,
    INK,
    MUTED,
    PAPER,
    SINGLE,
    draw_plots,
    find_note_size,
    save_figure,
    scale,
    sheet,
    strip_math,
)
from .plots.spec import LineStyle, Plot, Trace, choose_print_styles
from .plots.work import make_work_plots
from .rendering import render

FOLDER = "publication"
SUFFIXES = ("pdf", "svg")
OVERVIEW = "overview"
HEAT = (
    "Largest error over its limit: energy, constraints and motion of each solver at its finest step or tolerance. "
    "≈ inaccurate, × false success, ★ stopped at that part of the time."
)
MOST = 14  # most lines in one figure; more are split by solver
LEAST = 2  # least number of runs of a problem, to have something to compare
MAP = 3 * MOST  # runs of one label; more are a map of settings, for tables and work only
ALONE = {"energy": ("energy",), "constraints": ("phi", "phi-dot"), "step": ("step",)}  # figures of one journal column
WORK = (
    "Lower and further left is better. Lines join the steps or tolerances of the same settings; a run that stopped "
    "early (star) has the error up to there and is not comparable. Bars: spread of repeated timings. Zeros lie on the "
    "dotted line."
)
CONVERGENCE = (
    "Lines join the steps or tolerances of the same settings; a run that stopped early (star) has the error up to "
    "there and is not comparable. Zeros lie on the dotted line."
)
TRIANGLES = (  # added to the caption if there are triangles
    "Triangles: slopes of the whole orders that at least three runs in a row follow to 0.2; the order stands beside."
)
COUNTED = {  # added to the caption if a panel has this work
    "index-1 evaluations": "Index-1 evaluations: one unit for all solvers, an evaluation of the equations with its "
    "factorisation; one without counts half.",
    "evaluations": "Evaluations: residuals or right sides, as each solver counts its own.",
}
CROSS = "A cross marks a run that claims success and breaks a law."  # added if there is a cross
CLOCK = "CPU time: of the integration alone, on one machine{}."  # added if a panel has it
Printed = tuple[str, str, float, Callable[[], Figure]]  # name of the files, caption, width [in], function that draws
COLOURS = ("#86bde0", "#acd1ea", "#cde3f2", "#e4f0f7", "#f7f6f1", "#ffe2ac", "#f8a66a", "#b3123a")  # as in site.css
ROW, HEAD = 0.25, 0.75  # [in]
SIGNS = {"good": "", "inaccurate": "≈ ", "wrong": "× ", "failed": "★ ", "open": "not finished", "refused": "refused"}


def write_publication(
    folder: Path,
    only: Sequence[str],
    tell: Callable[[str], None],
    names: Mapping[str, str] | None = None,
    font: Font = DEFAULT_FONT,
) -> list[Path]:
    """Write the figures and tables of ``mbsbench figures``, and return their paths.

    ``only`` names variants, or problems if there is no variant of that name; empty for all. ``tell`` is called with a
    line per variant. ``names`` maps solvers to the names they get; ``font`` is that of the letters. Raise ValueError
    for an unknown name.
    """
    results = read_results(Path(folder), check_series=False)
    results, own = _rename_solvers(results, choose_print_styles(results.solvers), names or {})
    titles = {p.title for p in results.variants}
    known = titles | {p.problem for p in results.variants}
    unknown = [name for name in only if name not in known]
    if unknown:
        raise ValueError(f"no problem {unknown[0]!r} in these results; there are {', '.join(sorted(known))}")
    variants = [p for p in results.variants if p.title in only or p.problem in {*only} - titles or not only]
    out, captions, files = ConfinedPath(Path(folder)) / FOLDER, list[dict[str, Any]](), list[Path]()

    def write_figure(printed: Printed, place: ConfinedPath, problem: str = "") -> None:
        """Write a figure into the folder ``place``; add its paths to ``files`` and its caption to ``captions``."""
        name, caption, width, draw = printed
        paths = save_figure(draw, place, name, SUFFIXES, font)
        files.extend(paths)
        captions.append(
            {
                "name": name,
                "caption": caption,
                "problem": problem,
                "width_mm": round(width * 25.4, 1),
                "files": [p.relative_to(out.path).as_posix() for p in paths],
            }
        )

    if picture := make_heat_map(results):
        write_figure((OVERVIEW, HEAT, DOUBLE, partial(draw_heat_map, picture)), out)
    for variant in variants:
        files += write_tables([variant], out / variant.slug)
        for printed in list_figures(results, variant, own):
            write_figure(printed, out / variant.slug, variant.title)
        maps = [label or "no label" for label, runs in variant.labels().items() if len(runs) > MAP]
        left = f"; too many for lines over time: {', '.join(maps)}" if maps else ""
        tell(f"{variant.title}: {len(variant.runs)} runs{left}")
    (out / "captions.json").write(json.dumps(captions, indent=1, ensure_ascii=False))
    tables = {f"{p.slug}/{p.slug}": p.title for p in variants}
    title = f"Figures and tables of {results.folder.name}"
    page = render("publication.html", figures=captions, tables=tables, title=title, charts=(), stamp="")
    (out / "index.html").write(page)
    described = {f"{p.slug}/{p.slug}": describe_table(p) for p in variants}
    (out / "floats.tex").write(format_floats(title, captions, described))
    return [*files, (out / "floats.tex").path]


def _rename_solvers(
    results: StoredResults, own: Mapping[str, LineStyle], names: Mapping[str, str]
) -> tuple[StoredResults, Mapping[str, LineStyle]]:
    """Return the results and the line styles ``own`` with the solvers renamed as ``names`` says.

    Raise ValueError for an unknown solver, and if two solvers would have the same name.
    """
    for name in names:
        if name not in results.solvers:
            raise ValueError(f"--name: no solver {name!r} in these results; there are {', '.join(results.solvers)}")
    called = {solver: names.get(solver, solver) for solver in results.solvers}
    if twice := [name for name, n in Counter(called.values()).items() if n > 1]:
        raise ValueError(f"--name: two solvers are called {twice[0]!r}")
    runs = (replace(run, record=replace(run.record, solver=called[run.record.solver])) for run in results.runs)
    return replace(results, runs=tuple(runs)), {called[solver]: look for solver, look in own.items()}


def describe_table(variant: Variant) -> str:
    """Return the caption of a variant's table."""
    measure = choose_measure(variant.runs)
    until = f"; errors up to {measure.until:.4g} s" if measure and measure.until is not None else ""
    return f"{variant.title}: largest errors and CPU time of each run{until}."


def list_figures(
    results: StoredResults, variant: Variant, own: Mapping[str, LineStyle] | None = None
) -> Iterator[Printed]:
    """Yield a variant's figures: error against work and against step, then the laws over time by label.

    The laws of a label are drawn one by one and together, in several figures if it has more than ``MOST`` runs, and not
    at all if it has more than ``MAP``. ``own`` are line styles by solver.
    """
    own = own or choose_print_styles(results.solvers)
    if len(variant.runs) >= LEAST and (work := make_work_plots(variant)):
        kinds, cpu = {p.x.title for p in work}, results.environment.get("cpu")
        clock = CLOCK.format(f" ({cpu})" if isinstance(cpu, str) and cpu else "") if "CPU time" in kinds else ""
        counted = [words for kind, words in COUNTED.items() if kind in kinds]
        caption = " ".join(
            filter(None, (f"{variant.title}: work against error.", WORK, _explain_cross(work), clock, *counted))
        )
        yield f"{variant.slug}-work", caption, DOUBLE, partial(draw_plots, work, own, height=2.3)
    if ladders := make_convergence_plots(variant):
        slopes = TRIANGLES if any(p.triangles for p in ladders) else ""
        head = f"{variant.title}: error against step."
        caption = " ".join(filter(None, (head, CONVERGENCE, _explain_cross(ladders), slopes)))
        yield f"{variant.slug}-convergence", caption, DOUBLE, partial(draw_plots, ladders, own, height=2.3)
    taken: set[str] = set()
    for label, runs in variant.labels().items():
        if len(runs) > MAP:
            continue
        for part in (divided := split_runs(runs)):
            base = make_slug(f"{variant.slug}-{label or 'all'}", taken)
            drawing = draw_runs(results, part, variant.runs)
            chapter = plot_laws(drawing)
            plots = {p.name: p for p in chapter.plots} if chapter else {}
            empty = np.zeros(0)
            unseen = [
                Trace(k.words, empty, empty, solver=k.run.record.solver, who=k.who, dash=k.dash)
                for k in drawing.lines
                if not drawing.motions[k.run.record.run_id].has_steps
            ]
            draw = partial(draw_plots, looks=own, unseen=unseen)
            title = f"{variant.title}, {label or 'all runs'}"
            if len(divided) > 1:  # name the solvers of each part, in order
                ends = dict.fromkeys((part[0].record.solver, part[-1].record.solver))
                title += f", figure {divided.index(part) + 1} of {len(divided)}: {' to '.join(ends)}"
            for name, panels in ALONE.items():
                shown = [plots[k] for k in panels if k in plots]
                if shown:
                    yield f"{base}-{name}", _caption(title, shown), SINGLE, partial(draw, shown, columns=1)
            if plots:
                shown = list(plots.values())
                yield f"{base}-laws", _caption(title, shown), DOUBLE, partial(draw, shown)


def _explain_cross(plots: Sequence[Plot]) -> str:
    """Return the words that explain the cross of a false success; empty if no plot has one."""
    return CROSS if any("wrong" in (t.end, *t.ends) for p in plots for t in p.traces) else ""


def _caption(title: str, plots: Sequence[Plot]) -> str:
    """Return a caption: the title, then each panel's title and caption, then the meaning of a cross if there is one."""
    words = " ".join(f"{p.title}: {p.caption[0].lower()}{p.caption[1:]}" for p in plots)
    return " ".join(filter(None, (f"{title}. {words}", _explain_cross(plots))))


def split_runs(runs: Sequence[StoredRun]) -> list[list[StoredRun]]:
    """Split runs into groups of at most ``MOST``, the lines of one figure; a solver's runs stay together.

    A group is larger only if one solver alone has more runs.
    """
    out: list[list[StoredRun]] = [[]]
    for own in group_by_solver(runs).values():
        if out[-1] and len(out[-1]) + len(own) > MOST:
            out.append([])
        out[-1] += own
    return out


def draw_heat_map(heat: HeatMap) -> Figure:
    """Draw the heat map, a row per solver and a column per problem; numbers are errors as fractions of their limits."""
    out = sheet(DOUBLE, scale() * (ROW * len(heat.rows) + HEAD))
    ax = out.add_subplot()
    for y, row in enumerate(heat.rows):
        for x, box in enumerate(row.boxes):
            colour = PAPER if box is None else "#ece9e6" if box.level is None else COLOURS[box.level]
            ax.add_patch(Rectangle((x, y), 1.0, 1.0, facecolor=colour, edgecolor=PAPER, linewidth=1.0))
            if box is not None:
                loud = box.level == len(LEVELS)
                words = strip_math(f"{SIGNS[box.mark.kind]}{box.text}")
                ink = PAPER if loud else INK
                ax.text(x + 0.5, y + 0.53, words, ha="center", va="center", fontsize=find_note_size(), color=ink)
    ax.set(xlim=(0, len(heat.problems)), ylim=(len(heat.rows), 0))
    columns, rows = (np.arange(len(of)) + 0.5 for of in (heat.problems, heat.rows))
    heads = ([strip_math(w) for w in (p.problem.replace("_", " "), p.parameters) if w] for p in heat.problems)
    # a line break for every 14 characters
    ax.set_xticks(columns, ["\n".join(w.replace(" ", "\n", (len(w) - 1) // 14) for w in words) for words in heads])
    names = ["\n".join(strip_math(k) for k in (row.solver, row.paper_label) if k) for row in heat.rows]
    ax.set_yticks(rows, names, fontsize=find_note_size())
    ax.tick_params(length=0, top=False, labeltop=True, bottom=False, labelbottom=False)
    ax.spines[:].set_visible(False)
    ax.grid(visible=False)
    edges = [*(f"≤ {edge:g}" for edge in LEVELS), "more"]
    keys = [Patch(facecolor=c, edgecolor=MUTED, linewidth=0.4, label=e) for c, e in zip(COLOURS, edges, strict=True)]
    out.legend(handles=keys, loc="outside lower center", ncols=len(keys), title="error / limit", handlelength=1.0)
    return out
