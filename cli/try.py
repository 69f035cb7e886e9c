"""Try a solver: print the findings on one screen, and write pages with them (``try``)."""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ..harness.catalogue import registry
from ..harness.catalogue.suites.spec import RunSpec
from ..harness.catalogue.suites.suite import Suite
from ..harness.judge.conformance import assessment
from ..harness.mechanics.types import EndCause
from ..harness.results import store
from ..harness.results.findings import state_finding
from ..harness.results.records import RunRecord
from ..harness.run.remaining_time import format_duration
from ..harness.run.runner import Request, name_new_folder
from .arguments import UsageError, count_jobs, load_plugins
from .check import resolve_entries
from .findings import print_findings
from .progress import announce_suite, run_watched
from .terminal import make_console, make_error_console

NET = 10.0  # wall time at which a stage is ended, in units of the CPU time left


def run(arguments: argparse.Namespace) -> int:
    """Run a file's one solver in stages within --budget, print the findings and write the pages.

    Return 0 if no finding falls short and the budget left out no run, else 1.
    """
    plugins, names = resolve_entries(arguments.file)
    own = [n for n in names if n in registry.solvers()]
    if len(own) != 1:
        raise UsageError(f"try takes a file with one solver (got {', '.join(own) or 'none'} in {arguments.file})")
    (solver,) = own
    plugins += load_plugins(arguments.plugin)
    jobs = count_jobs(arguments.jobs)
    folder = Path(arguments.out) if arguments.out else name_new_folder(f"try-{solver}")

    if not arguments.json:
        most = format_duration(arguments.budget / jobs)
        plan = f"runs within {arguments.budget:g} s of CPU time (--budget), {jobs} at a time: at most about {most}"
        announce_suite(f"{solver}: {plan}, and what has to be compiled", make_error_console())

    def run_stage(specs: Sequence[RunSpec], rest: float, resume: bool) -> Sequence[RunRecord] | None:
        """Run one stage; end it after ``NET`` times the CPU time left in the budget, ``rest`` [s].

        Return the records so far, or None if runs were left out or stopped by that limit.
        """
        suite = Suite(f"try-{solver}", "", tuple(specs), "", plugins, total_limit=NET * rest)
        request = Request(suite, folder, jobs, resume=resume)
        words = (
            f"the budget of {arguments.budget:g} s (--budget), of which {max(rest, 0.0):.2g} s were left for these runs"
        )
        loaded, watcher = run_watched(request, quiet=arguments.json, resumable=False, announces=False, budget=words)
        cut = watcher.left or any(r.ended_by == EndCause.TOTAL_LIMIT for r in loaded.records)
        return None if cut else loaded.records

    specs = assessment.run_stages(solver, arguments.budget, run_stage)
    records = [r for r in store.load(folder).records if r.ended_by != EndCause.TOTAL_LIMIT]
    orders = assessment.certify_ladders(solver, folder, records)
    have = {r.settings_id for r in records}
    left = [s for s in specs if s.settings_id not in have]
    found = list(assessment.assess_solver(solver, folder, records, orders, left))
    tested = [f for f in found if f.is_tested]
    summary = f"{solver}: {sum(f.holds for f in tested)} of {len(tested)} as expected"
    if left:
        share = f"{len(left)} of {len(specs)} runs"
        summary += f"; incomplete: {share} are left out by the budget"
        words = f"{share} ended or left out when {arguments.budget:g} s of CPU time were over"
        found.insert(0, state_finding("budget", words, "all runs; a longer --budget"))
    print_findings(found, *([] if arguments.json else [summary]), json=arguments.json)
    for line in _write_pages(arguments, folder, solver, summary, found, orders):
        if not arguments.json:
            make_console().print(line)
    return 1 if left or not all(f.holds for f in found) else 0


def _write_pages(arguments: argparse.Namespace, folder: Path, *tried: Any) -> Iterator[str]:
    """Write the requested pages and yield lines with their paths; ``tried`` are solver, summary, findings, orders."""
    if arguments.html:
        from ..reports.trial import write_page

        write_page(arguments.html, folder, *tried)
        yield f"page: {arguments.html}"
    if arguments.no_report:
        yield f"results: {folder}"
    else:
        from ..reports.site import build_report

        yield f"report: {build_report(folder)}"
