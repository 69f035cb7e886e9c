"""``check``: solver and problem requirements, tested on a plugin or on an entry of the catalogue."""

import argparse
import math
import tempfile
from pathlib import Path
from typing import Any

from rich.text import Text

from ..harness.catalogue import plugins, registry
from ..harness.catalogue.options import nearest
from ..harness.conformance import problem, solver
from ..harness.conformance.requirements import Finding, Measured
from ..harness.execution.runner import Request, run_suite
from .progress import progress
from .screen import Column, lines, print_json, print_table
from .terms import UsageError, add_jobs, jobs, load_plugins, subcommand

COLUMNS = (
    Column("", right=False), Column("requirement", right=False), Column("measured", right=False),
    Column("expected", right=False), Column("found", fold=True),
)  # fmt: skip


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    words = "test the requirements on a solver or problem, with the number measured; exit code 1 if one is not met"
    p = subcommand(commands, "check", run, words, "one object per requirement")
    p.add_argument("plugin", metavar="FILE.py", help="Python file, entry point, or name of a solver or problem")
    add_jobs(p)


def run(arguments: argparse.Namespace) -> int:
    """0 if every requirement is met, else 1."""
    size = jobs(arguments.jobs)
    loaded, names = named(arguments.plugin)
    findings: list[Finding] = []
    for name in names:
        if name in registry.problems():
            findings += problem.findings(name, loaded)
        else:
            findings += _findings(name, loaded, size, quiet=arguments.json)
    if arguments.json:
        for f in findings:
            print_json(f.plain())
    else:
        for name in names:
            _print([f for f in findings if f.entry == name], name)
    return 0 if all(f.measured.holds for f in findings) else 1


def _print(findings: list[Finding], name: str) -> None:
    out = lines()
    out.print(Text(name, "bold"))
    print_table(COLUMNS, [_row(f.requirement.name, f.measured) for f in findings])
    broken = [f for f in findings if not f.measured.holds]
    for f in broken:
        out.print(Text(f"FAIL  {f.requirement.name}", "bold red"))
        out.print(f"      why:    {f.requirement.why}\n      remedy: {f.measured.remedy or f.requirement.remedy}")
    untested = sum(not f.measured.tested for f in findings)
    met = f"{len(findings) - len(broken) - untested} of {len(findings)} requirements met"
    out.print(met + (f", {untested} not tested" if untested else ""))


def _row(name: str, m: Measured) -> list[Text | str]:
    mark = Text("-") if not m.tested else Text("ok") if m.holds else Text("FAIL", "bold red")
    measured = "not tested" if not m.tested else "-" if math.isnan(m.value) else f"{m.value:.4g} {m.unit}"
    return [mark, name, measured, _expected(m) if m.tested else "", m.words]


def _expected(m: Measured) -> str:
    """The limits: a number, a range, or one side."""
    least, most = f"{m.least:.3g}", f"{m.most:.3g}"
    if not math.isfinite(m.least):
        return f"at most {most}" if math.isfinite(m.most) else ""
    if not math.isfinite(m.most):
        return f"at least {least}"
    return least if m.least == m.most else f"{least} to {most}"


def named(given: str) -> tuple[tuple[str, ...], list[str]]:
    """The plugin and the problems and solvers it adds, problems first; or the catalogue's entry of that name."""
    before = {*registry.problems(), *registry.solvers()}
    if given in before:
        return (), [given]
    if not plugins.is_file(given) and given not in (points := plugins.entry_points()):
        known = [*sorted(before), *points, *(p.name for p in Path().glob("*.py"))]
        raise UsageError(f"unknown solver, problem or plugin {given!r}{nearest(given, known)}")
    loaded = load_plugins([given])
    names = [n for n in (*sorted(registry.problems()), *sorted(registry.solvers())) if n not in before]
    if not names:
        raise UsageError(f"{given} adds no problem or solver{nearest(given, sorted(before))}")
    return loaded, names


def _findings(name: str, plugins: tuple[str, ...], size: int, *, quiet: bool) -> list[Finding]:
    with tempfile.TemporaryDirectory() as place, progress(quiet=quiet, size=size, resumable=False) as watcher:
        folder = Path(place) / "run"
        loaded = run_suite(Request(solver.suite_of(name, plugins), folder, size), watcher)
        return solver.judged(name, folder, loaded.records)
