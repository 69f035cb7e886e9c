"""``check``: the contracts of solvers and problems, on those of a file from outside the tree."""

import argparse
import json
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
from .run import jobs
from .screen import lines
from .terms import UsageError, load_plugins


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    p = commands.add_parser("check", help="the contract suite on a solver or problem of yours; explains each failure")
    p.add_argument("plugin", metavar="FILE.py", help="file, or entry point, or a solver or problem of ours")
    p.add_argument("--jobs", metavar="N", help="processes at a time (default: cores)")
    p.add_argument("--json", action="store_true", help="one JSON object a claim and line, for machines")
    p.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """0 if every claim holds, else 1."""
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
            out.print(json.dumps(vars(f), ensure_ascii=False))
        elif f.holds:
            out.print(f"ok    {f.solver}: {f.claim}" + (f" ({f.found})" if f.found else ""))
        else:
            out.print(Text(f"FAIL  {f.solver}: {f.claim}", "bold red"))
            out.print(f"      found:  {f.found}\n      why:    {f.why}\n      remedy: {f.remedy}")
    broken = sum(not f.holds for f in findings)
    if not arguments.json:
        out.print(f"{len(findings) - broken} of {len(findings)} claims hold")
    return 1 if broken else 0


def _named(given: str) -> tuple[tuple[str, ...], list[str]]:
    """The plugin, and the problems and solvers it brings, problems first; or one of ours by name."""
    before = {*registry.problems(), *registry.solvers()}
    if given in before:
        return (), [given]
    plugins = load_plugins([given])
    names = [n for n in (*sorted(registry.problems()), *sorted(registry.solvers())) if n not in before]
    if not names:
        raise UsageError(f"{given} brings nothing that was not there{nearest(given, sorted(before))}")
    return plugins, names


def _findings(solver: str, plugins: tuple[str, ...], size: int, *, quiet: bool) -> list[Finding]:
    with tempfile.TemporaryDirectory() as place, progress(quiet=quiet, size=size) as watcher:
        folder = Path(place) / "run"
        loaded = run_suite(Request(suite_of(solver, plugins), folder, size), watcher)
        return judged(solver, folder, loaded.records)
