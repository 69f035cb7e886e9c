"""A page for each run: what was asked, how it ended, every number with its meaning, and how to run it again."""

from ....harness.results.reproduce import write_command
from ...model.results import Results, Run
from ...model.tables import COLUMNS
from ...model.words import number, time
from ..base import PLOTTING, Page, Site

RANK = 10  # after the problems: their pages' data files hold the curves
RECORDED = {"newton": "newton_iterations"}  # counters that are columns under another name
LEFT_OUT = ("label", "settings", "status", "energy_kind")  # said elsewhere on the page


def write(results: Results, site: Site) -> Page | None:
    """``runs/<run>.html``; none of them in the navigation."""
    plugins = [str(p) for p in results.environment.get("plugins") or []]
    meanings = site.data("meanings", {c.heading: c.doc for c in COLUMNS})
    variants = {c.record.run_id: p for p in results.variants for c in p.runs}
    for run in results.runs:
        variant = variants[run.record.run_id]
        slug = site.drawn.get(run.record.run_id)
        data = f"plots-problem-{slug}" if slug else ""
        scripts = [f"data/{data}.js", *PLOTTING] if data else []
        site.write(
            Page(f"{run.record.solver} on {run.variant}", site.url(run)), "run.html",
            scripts=[meanings, *scripts], run=run, variant=variant, asked=_list_settings(run, results),
            numbers=_numbers(run), command=write_command(run.record, plugins), plots_data=data,
        )  # fmt: skip
    return None


def _list_settings(run: Run, results: Results) -> list[tuple[str, str]]:
    r = run.record
    limits = [f"{time(r.cpu_limit_s)} s CPU time"] if r.cpu_limit_s == r.cpu_limit_s else []
    limits += [f"{r.max_steps:,} steps".replace(",", "\u202f")] if r.max_steps else []
    limits += [f"{time(r.memory_limit_MB)} MB"] if r.memory_limit_MB == r.memory_limit_MB else []
    return [(k, v) for k, v in (
        ("Section", r.section), ("The paper calls such", r.paper_label), ("Simulated time", f"{time(r.t_end_s)} s"),
        ("Limits", ", ".join(limits)), ("Group", r.label), ("Ended", r.finished),
        ("Code", r.code),
        ("Commit", "" if r.commit == results.environment.get("commit") else r.commit), ("Series", r.series),
    ) if v]  # fmt: skip


def _numbers(run: Run) -> list[tuple[str, str]]:
    """Heading and value; only what exists for this run, and what the solver counted beside the columns."""
    out = []
    for c in COLUMNS:
        value = c.of(run)
        if c.key not in LEFT_OUT and value == value and value not in ("", "–"):
            out.append((c.heading, c.text(run)))
    own = {k: float(v) for k, v in run.counters.items() if isinstance(v, int | float)}
    known = {k: getattr(run.record, RECORDED.get(k, k), None) for k in own}
    out += [(f"counted: {k.replace('_', ' ')}", number(v)) for k, v in own.items() if v != known[k]]
    return out
