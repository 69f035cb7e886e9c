"""``check``: the contract of solvers, on one from outside the tree."""

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

from rich.console import Console

from harness import registry
from harness.commands.progress import progress
from harness.commands.run import jobs
from harness.commands.terms import UsageError, load_plugins
from harness.contract import Finding, as_plain, judged, suite_of
from harness.options import nearest
from harness.runner import Request, run_suite


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    p = commands.add_parser("check", help="the contract suite on a solver of yours; explains each failure")
    p.add_argument("plugin", metavar="FILE.py", help="file, or entry point, or a solver of ours")
    p.add_argument("--jobs", metavar="N", help="processes at a time (default: cores)")
    p.add_argument("--json", action="store_true", help="one JSON object a claim and line, for machines")
    p.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """0 if every claim holds, else 1."""
    plugins, names = _solvers(arguments.plugin)
    findings = [f for name in names for f in _findings(name, plugins, jobs(arguments.jobs), quiet=arguments.json)]
    out = Console(highlight=False, markup=False, soft_wrap=True)
    for f in findings:
        if arguments.json:
            out.print(json.dumps(as_plain(f), ensure_ascii=False))
        elif f.holds:
            out.print(f"ok    {f.solver}: {f.claim}")
        else:
            out.print(f"FAIL  {f.solver}: {f.claim}", style="bold red")
            out.print(f"      found:  {f.found}\n      why:    {f.why}\n      remedy: {f.remedy}")
    broken = sum(not f.holds for f in findings)
    if not arguments.json:
        out.print(f"{len(findings) - broken} of {len(findings)} claims hold")
    return 1 if broken else 0


def _solvers(given: str) -> tuple[tuple[str, ...], list[str]]:
    before = set(registry.solvers())
    if given in before:
        return (), [given]
    plugins = load_plugins([given])
    names = sorted(set(registry.solvers()) - before)
    if not names:
        raise UsageError(f"{given} brings no solver{nearest(given, list(before))}")
    return plugins, names


def _findings(solver: str, plugins: tuple[str, ...], size: int, *, quiet: bool) -> list[Finding]:
    with tempfile.TemporaryDirectory() as place, progress(quiet=quiet) as watcher:
        folder = Path(place) / "run"
        loaded = run_suite(Request(suite_of(solver, plugins), folder, size), watcher)
        return judged(solver, folder, loaded.records)
