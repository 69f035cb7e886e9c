"""Measure finished runs again by the laws of this code (``remeasure``)."""

import argparse

from ..harness.results import store
from ..harness.run.full_series import name_run
from ..harness.run.remeasure import find_outdated, replace_outdated
from ..harness.run.runner import Request
from .arguments import UsageError, count_jobs, load_plugins
from .progress import announce_suite, run_watched
from .terminal import list_unreadable, make_console, make_error_console, plural, print_json, print_unreadable

NAMED = 20  # most runs listed that stay unchanged


def run(arguments: argparse.Namespace) -> int:
    """Measure again the runs that other code measured, and print how many were, and which were not and why.

    Return 1 if a run could not be measured again or a file is unreadable, else 0. Damaged files that were replaced are
    named as set aside.
    """
    folder, plugins = arguments.results, load_plugins(arguments.plugin)
    loaded = store.load(folder)
    records = store.select_newest(loaded.records)
    if not records:
        raise UsageError(f"{folder} holds no results")
    outdated = find_outdated(records, plugins)

    def solve(request: Request) -> None:
        """Run the suite that ``replace_outdated`` requests, with progress."""
        run_watched(request, quiet=arguments.json, resumable=False, announces=False)

    seconds = sum(r.cpu_process_s for r in outdated if r.cpu_process_s > 0.0)
    took = f", which took {seconds:.2g} s of CPU time" if seconds else ""
    announce_suite(
        f"{plural(len(outdated), 'run')} of {folder} to be solved once more and measured{took}", make_error_console()
    )
    done = replace_outdated(folder, outdated, count_jobs(arguments.jobs), solve, plugins)
    same, unreadable = len(records) - len(outdated), loaded.unreadable
    for line in list_unreadable("set aside", [(path.name, why) for path, why in done.set_aside.items()]):
        make_error_console().print(line, highlight=False, soft_wrap=True)
    if arguments.json:
        left = {r.run_id: why for r, why in done.left}
        print_json({"measured_again": len(done.records), "of_this_code": same, "left": left})
        print_unreadable(unreadable)
        return 1 if left or unreadable else 0
    out = make_console()
    out.print(f"{plural(len(done.records), 'run')} measured again, {same} were of this code", highlight=False)
    for record, why in done.left[:NAMED]:
        out.print(f"not measured again: {name_run(record)}: {why}", highlight=False, soft_wrap=True)
    if len(done.left) > NAMED:
        out.print(f"and {len(done.left) - NAMED} more")
    print_unreadable(unreadable, out)
    return 1 if done.left or unreadable else 0
