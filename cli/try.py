"""``try``: one screen and one page on a solver of one's own."""

import argparse
import os
from pathlib import Path
from typing import Any

from ..harness.catalogue import registry
from ..harness.conformance import assessment
from ..harness.execution.runner import Request, new_folder
from ..harness.results import store
from ..harness.results.findings import Finding, state
from ..harness.suites.spec import RunSpec
from ..harness.suites.suite import Suite
from ..harness.types import EndedBy
from .arguments import (
    UsageError,
    add_jobs,
    add_plugin,
    check_writable,
    count_jobs,
    load_plugins,
    positive_float,
    subcommand,
)
from .check import resolve_entries
from .findings import print_findings
from .progress import run_watched
from .screen import lines

NET = 10.0  # times the CPU time that is left: a stage that takes longer on the wall is ended


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    words = "run a solver on problems, ladders, loops and chains; exit code 1 where it falls short or runs are left out"
    p = subcommand(commands, "try", run, words, "one object a finding")
    p.add_argument("file", metavar="FILE.py", help="Python file, entry point, or name of a solver")
    p.add_argument(
        "--budget",
        type=positive_float,
        default=180.0,
        metavar="S",
        help="CPU time of everything, compilation too [s] (default: 180)",
    )
    p.add_argument("--out", metavar="DIR", help="results folder to write (default: results/local/try-<solver>-<time>)")
    p.add_argument("--html", metavar="FILE", help="also write all lines and charts to one HTML page")
    p.add_argument("--no-report", action="store_true", help="leave out the page")
    add_plugin(p, "file whose problems are run too")
    add_jobs(p)


def run(arguments: argparse.Namespace) -> int:
    """0 if nothing falls short and nothing is left out."""
    budget = arguments.budget
    plugins, names = resolve_entries(arguments.file)
    own = [n for n in names if n in registry.solvers()]
    if len(own) != 1:
        raise UsageError(f"try takes a file with one solver (got {', '.join(own) or 'none'} in {arguments.file})")
    (solver,) = own
    plugins += load_plugins(arguments.plugin)
    size = count_jobs(arguments.jobs)
    if arguments.html:
        check_writable(Path(arguments.html))
    folder = Path(arguments.out) if arguments.out else new_folder(f"try-{solver}")
    specs = assessment.plan_runs(solver, wall=min(20.0, budget / 6.0))
    stages = assessment.plan_stages(solver, specs)
    long = False
    begun, done = _cpu_seconds(), list[RunSpec]()
    while stages and (not done or _cpu_seconds() - begun < budget):
        rest, begun_before = budget - (_cpu_seconds() - begun), bool(done)
        done += stages.pop(0)
        suite = Suite(f"try-{solver}", "", tuple(done), "", plugins, total_limit=NET * rest)
        request = Request(suite, folder, size, resume=begun_before)
        loaded, watcher = run_watched(request, quiet=arguments.json, resumable=False)
        if watcher.left or any(r.ended_by == EndedBy.TOTAL_LIMIT for r in loaded.records):
            break
        if not long and any(s.label == "symmetries" for s in done):
            rest = budget - (_cpu_seconds() - begun)
            more = assessment.plan_long_run(solver, loaded.records, min(budget / 6.0, rest / 3.0))
            long = True
            if more is not None:
                specs.append(more)
                stages.insert(0, [more])
    records = [r for r in store.load(folder).records if r.ended_by != EndedBy.TOTAL_LIMIT]
    orders = assessment.certify_ladders(solver, folder, records)
    have = {r.settings_id for r in records}
    left = [s for s in specs if s.settings_id not in have]
    found = list(assessment.assess(solver, folder, records, orders, left))
    summary = _summarize(solver, found)
    if left:
        share = f"{len(left)} of {len(specs)} runs"
        summary += f"; incomplete: {share} are left out by the budget"
        words = f"{share} ended or left out when {budget:g} s of CPU time were over"
        found.insert(0, state("budget", words, "all runs; a longer --budget"))
    print_findings(found, *([] if arguments.json else [summary]), json=arguments.json)
    if arguments.html:
        from ..reports.tried import Tried, write_page

        write_page(Path(arguments.html), folder, Tried(solver, summary, found, orders))
        if not arguments.json:
            lines().print(f"page: {arguments.html}")
    place = f"results: {folder}"
    if not arguments.no_report:
        from ..reports.site import build

        place = f"report: {build(folder)}"
    if not arguments.json:
        lines().print(place)
    return 1 if left or not all(f.holds for f in found) else 0


def _cpu_seconds() -> float:
    """CPU time of this process and of those that it has waited for [s]."""
    return sum(os.times()[:4])


def _summarize(solver: str, found: list[Finding]) -> str:
    judged = [f for f in found if f.is_tested]
    return f"{solver}: {sum(f.holds for f in judged)} of {len(judged)} as expected"
