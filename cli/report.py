"""Write the web pages of a results folder, judged meanwhile if asked, or the comparison of two (``report``)."""

import argparse
import multiprocessing
import os
import traceback
from collections.abc import Callable
from pathlib import Path

from ..harness.base.confined_paths import ConfinedPath
from ..harness.results import store
from ..harness.run.costs import describe_command
from .arguments import UsageError, find_results
from .progress import announce_suite
from .terminal import make_console, make_error_console, plural

FAILED = 70  # exit code of a judge that ends by an exception, as sysexits.h has it


class NotJudgedError(Exception):
    """Signal that the results could not be judged, with the exit code of ``judge``."""

    def __init__(self, code: int) -> None:
        super().__init__(f"judge ended with code {code}")
        self.code = code


def run(arguments: argparse.Namespace) -> int:
    """Write the report of one results folder, with --judge judged meanwhile, or the comparison of two; print its path.

    Return 0, or if the results could not be judged the exit code of ``judge``.
    """
    if len(arguments.results) > 2:
        raise UsageError(f"report takes one results folder, or two to compare (got {len(arguments.results)})")
    folders = [find_results(name) for name in arguments.results]
    if arguments.out is not None and len(folders) < 2:
        raise UsageError("--out needs two results folders to compare; the report of one is written into it")
    if arguments.judge and len(folders) > 1:
        raise UsageError("--judge needs one results folder: judge those of a comparison before")
    from ..reports.model.results import read_results  # here: they take a second to load
    from ..reports.pages.compare import write_compare
    from ..reports.site import write_site

    to_come = ""
    with store.hold_folder(folders[-1]):
        if len(folders) == 1:
            results = read_results(folders[0])
            size = len(results.runs)
            takes = describe_command("judged_report" if arguments.judge else "report", size)
            announce_suite(f"pages of {plural(size, 'run')}: {takes}", make_error_console())
            if arguments.judge:
                from .judge import refuse_other_code  # here: a report alone does not judge

                refuse_other_code(folders[0], [run.record for run in results.runs])  # before pages are removed
            await_judgement = _start_judging(folders[0]) if arguments.judge else lambda: None
            try:
                index = write_site(results, ConfinedPath(folders[0]) / "report", await_judgement)
            except NotJudgedError as error:  # the reason has been printed
                return error.code
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


def _start_judging(folder: Path) -> Callable[[], None]:
    """Start ``judge --partial`` in a forked process; return a function that waits until the process has ended.

    The function raises NotJudgedError unless the results were judged, whatever the verdicts.
    """
    judging = multiprocessing.get_context("fork").Process(target=_judge_quietly, args=(folder,), daemon=True)
    judging.start()

    def wait() -> None:
        """Wait until the results are judged; raise NotJudgedError for an exit code other than 0 and 1."""
        judging.join()
        if (code := judging.exitcode) not in (0, 1):
            raise NotJudgedError(2 if code is None or code < 0 else code)

    return wait


def _judge_quietly(folder: Path) -> None:
    """Run ``judge --partial`` without its standard output, and exit with its code, or ``FAILED`` for an exception."""
    from .__main__ import main

    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    try:
        code = main(["judge", "--partial", str(folder)])
    except Exception:
        traceback.print_exc()
        code = FAILED  # 1 would say that verdicts differ
    raise SystemExit(code)
