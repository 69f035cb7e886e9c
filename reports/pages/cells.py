"""A page for each cell: what was asked, how it ended, every number with its meaning, and how to run it again."""

from ...harness.results.reproduce import command
from ..model.columns import COLUMNS
from ..model.reading import Cell, Run
from ..model.words import number, time
from .base import PLOTTING, Page, Site

RANK = 10  # after the problems: their pages' data files hold the curves
RECORDED = {"newton": "newton_iterations"}  # counters that are columns under another name
LEFT_OUT = ("label", "settings", "status", "energy_kind")  # said elsewhere on the page


def write(run: Run, site: Site) -> Page | None:
    """``cells/<cell>.html``; none of them in the navigation."""
    plugins = [str(p) for p in run.environment.get("plugins") or []]
    meanings = site.data("meanings", {c.heading: c.doc for c in COLUMNS})
    posings = {c.record.cell: p for p in run.posings for c in p.cells}
    for cell in run.cells:
        posing = posings[cell.record.cell]
        slug = site.drawn.get(cell.record.cell)
        data = f"plots-problem-{slug}" if slug else ""
        scripts = [*PLOTTING[:1], f"data/{data}.js", *PLOTTING[1:]] if data else []
        site.write(
            Page(f"{cell.record.solver} on {cell.posing}", site.url(cell)), "cell.html",
            scripts=[meanings, *scripts], cell=cell, posing=posing, asked=_asked(cell, run),
            numbers=_numbers(cell), command=command(cell.record, plugins), plots_data=data,
        )  # fmt: skip
    return None


def _asked(cell: Cell, run: Run) -> list[tuple[str, str]]:
    r = cell.record
    limits = [f"{time(r.wall_limit_s)} s wall time"] if r.wall_limit_s == r.wall_limit_s else []
    limits += [f"{r.max_steps:,} steps".replace(",", "\u202f")] if r.max_steps else []
    limits += [f"{time(r.memory_limit_MB)} MB"] if r.memory_limit_MB == r.memory_limit_MB else []
    return [(k, v) for k, v in (
        ("Section", r.section), ("The paper calls such", r.paper_label), ("Simulated time", f"{time(r.t_end_s)} s"),
        ("Limits", ", ".join(limits)), ("Group", r.label), ("Ended", r.finished),
        ("Code", "" if r.code == run.environment.get("code") else r.code),
        ("Commit", "" if r.commit == run.environment.get("commit") else r.commit), ("Series", r.series),
    ) if v]  # fmt: skip


def _numbers(cell: Cell) -> list[tuple[str, str]]:
    """Heading and value; only what exists for this cell, and what the solver counted beside the columns."""
    out = []
    for c in COLUMNS:
        value = c.of(cell)
        if c.key not in LEFT_OUT and value == value and value not in ("", "–"):
            out.append((c.heading, c.text(cell)))
    own = {k: float(v) for k, v in cell.counters.items() if isinstance(v, int | float)}
    known = {k: getattr(cell.record, RECORDED.get(k, k), None) for k in own}
    out += [(f"counted: {k.replace('_', ' ')}", number(v)) for k, v in own.items() if v != known[k]]
    return out
