"""Run a solver on hidden instances and bundle its results (``submit``)."""

import argparse

from ...harness.lab.ladder.bundling import read_entry, require_checker, write_bundle
from ...harness.lab.ladder.closing import TRIAL
from ...harness.lab.ladder.instances import KINDS, STEPS
from ...harness.lab.ladder.ranking import rank_entries
from ...harness.lab.ladder.submission import CPU_LIMIT, REPEATS, read_submission, run_submission
from ...harness.results.words import qualify_status
from ...harness.run.runner import name_new_folder
from ..arguments import check_writable
from ..progress import announce_suite
from ..terminal import make_console, make_error_console, plural, print_json

UNFENCED = (
    "warning: this system cannot keep a submission from files, sockets and other processes, so its entry is marked "
    "not fenced; run what you do not trust elsewhere"
)
TRIED = "trial: without the value of a ladder (--value), which is published once entries are closed"


def run(arguments: argparse.Namespace) -> int:
    """Run the submission and write its bundle, or with --digest print its digest.

    Return 1 if a success is false, nothing is solved or the entry would be removed, else 0.
    """
    submission = read_submission(arguments.submission)
    if arguments.digest:
        print_json({"digest": submission.digest}) if arguments.json else make_console().print(submission.digest)
        return 0
    require_checker()
    trial = arguments.value == TRIAL
    out = check_writable(arguments.out or f"{submission.name}.zip")
    if not submission.fenced:
        make_error_console().print(UNFENCED)
    if trial:
        make_error_console().print(TRIED)
    folder = name_new_folder(f"submit-{submission.name}")
    runs = len(KINDS) * len(STEPS[submission.control])
    announce_suite(
        f"{plural(runs, 'run')}, {REPEATS} times each, then measured: at most {CPU_LIMIT:g} s of CPU each time",
        make_error_console(),
    )
    for r in run_submission(submission, arguments.value, folder):
        if not arguments.json:
            setting = r.dt_s if r.control == "dt" else r.rtol
            beside = f"  ({words})" if (words := qualify_status(r)) else ""
            make_console().print(f"{r.status:12} {r.cpu_median_s:8.3g} s  {r.problem} {setting:g}{beside}")
    write_bundle(folder, out)
    (row,) = rank_entries([(read_entry(out), "")])
    if arguments.json:
        print_json(
            {
                "file": str(out),
                "digest": submission.digest,
                "points": row.points,
                "solved": row.solved,
                "false": row.false,
                "fenced": row.fenced,
                "trial": trial,
            }
        )
    else:
        marks = "; trial" * trial + "; not fenced" * (not row.fenced)
        if row.forged:
            make_console().print(f"{out}: removed: {row.forged[0]}")
        make_console().print(
            f"{out}: {row.points} points, {row.solved} of {row.instances} solved, {row.false} false{marks}"
        )
    return 0 if row.solved and not row.false and not row.forged else 1
