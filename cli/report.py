"""Write the web pages of a results folder, or the comparison of two (``report``)."""

import argparse

from ..harness.base.confined_paths import ConfinedPath
from ..harness.results import store
from ..harness.run.costs import describe_command
from .arguments import UsageError, find_results
from .progress import announce_suite
from .terminal import make_console, make_error_console, plural


def run(arguments: argparse.Namespace) -> int:
    """Write the report of one results folder, or the comparison of two; print its path and return 0."""
    if len(arguments.results) > 2:
        raise UsageError(f"report takes one results folder, or two to compare (got {len(arguments.results)})")
    folders = [find_results(name) for name in arguments.results]
    if arguments.out is not None and len(folders) < 2:
        raise UsageError("--out needs two results folders to compare; the report of one is written into it")
    from ..reports.model.results import read_results  # here: they take a second to load
    from ..reports.pages.compare import write_compare
    from ..reports.site import write_site

    to_come = ""
    with store.hold_folder(folders[-1]):
        if len(folders) == 1:
            results = read_results(folders[0])
            size = len(results.runs)
            announce_suite(f"pages of {plural(size, 'run')}: {describe_command('report', size)}", make_error_console())
            index = write_site(results, ConfinedPath(folders[0]) / "report")
            if results.to_come:
                to_come = (
                    f"{results.to_come} of {results.suite_runs} runs of the suite are still to come; "
                    "the open page says when a report with more has replaced it"
                )
        elif arguments.out is None:
            index = write_compare(folders[0], folders[1], ConfinedPath(folders[1]) / "report")
        else:
            arguments.out.mkdir(parents=True, exist_ok=True)
            index = write_compare(folders[0], folders[1], ConfinedPath(arguments.out))
    make_console().print(f"report: {index}")
    if to_come:
        make_console().print(to_come)
    return 0
