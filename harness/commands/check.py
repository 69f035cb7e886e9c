"""``check``: solver and problem requirements, tested on a plugin or on an entry of the catalogue."""

import argparse
import tempfile
from pathlib import Path
from typing import Any

from rich.text import Text

from ..catalogue import registry
from ..catalogue.options import nearest
from ..conformance import problem as problem_contract
from ..conformance.claims import Finding
from ..conformance.solver import judged, suite_of
from ..execution.runner import Request, run_suite
from .progress import progress
from .screen import lines, print_json
from .terms import UsageError, add_jobs, jobs, load_plugins, subcommand


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    words = "test the requirements on a solver or problem and explain each failure; exit code 1 if one fails"
    p = subcommand(commands, "check", run, words, "one object per requirement")
    p.add_argument("plugin", metavar="FILE.py", help="Python file, entry point, or name of a solver or problem")
    add_jobs(p)


def run(arguments: argparse.Namespace) -> int:
    """0 if every requirement is met, else 1."""
    size = jobs(arguments.jobs)
    plugins, names = _named(arguments.plugin)
    findings: list[Finding] = []
    for name in names:
        if name in registry.problems():
            findings += problem_contract.findings(name, plugins)
        else:
            findings += _findings(name, plugins, size, quiet=arguments.json)
    out = lines()
    for f in findings:
        if arguments.json:
            print_json(vars(f))
        elif f.holds:
            out.print(f"ok    {f.solver}: {f.claim}" + (f" ({f.found})" if f.found else ""))
        else:
            out.print(Text(f"FAIL  {f.solver}: {f.claim}", "bold red"))
            out.print(f"      found:  {f.found}\n      why:    {f.why}\n      remedy: {f.remedy}")
    broken = sum(not f.holds for f in findings)
    if not arguments.json:
        out.print(f"{len(findings) - broken} of {len(findings)} requirements met")
    return 1 if broken else 0


def _named(given: str) -> tuple[tuple[str, ...], list[str]]:
    """The plugin and the problems and solvers it adds, problems first; or the catalogue's entry of that name."""
    before = {*registry.problems(), *registry.solvers()}
    if given in before:
        return (), [given]
    plugins = load_plugins([given])
    names = [n for n in (*sorted(registry.problems()), *sorted(registry.solvers())) if n not in before]
    if not names:
        raise UsageError(f"{given} adds no problem or solver{nearest(given, sorted(before))}")
    return plugins, names


def _findings(solver: str, plugins: tuple[str, ...], size: int, *, quiet: bool) -> list[Finding]:
    with tempfile.TemporaryDirectory() as place, progress(quiet=quiet, size=size) as watcher:
        folder = Path(place) / "run"
        loaded = run_suite(Request(suite_of(solver, plugins), folder, size), watcher)
        return judged(solver, folder, loaded.records)
