"""Judge the motion in a file that any other code computed, as all runs are judged (``referee``)."""

import argparse
import math
from pathlib import Path

from rich.text import Text

from ...harness.base.files import FileError
from ...harness.base.text import escape_text
from ...harness.catalogue.trial import make_problem
from ...harness.formats.motions.judge import choose_settings, judge_file, list_tables, open_results
from ...harness.mechanics.types import Status
from ...harness.results import store
from ...harness.results.records import RunRecord
from ...harness.results.words import describe_status, list_reasons, qualify_status, select_judged_error
from ..arguments import load_problem
from ..solve import make_json_numbers, summarize_record
from ..terminal import Column, choose_status_style, make_console, number, print_json, print_table

INACCURATE = 3  # exit code
COLUMNS = (
    Column("case", fold=True),
    Column("status", right=False),
    Column("position error [m]"),
    Column("energy drift [J]", rank=1),
    Column("accurate until [s]", rank=2),
)


def run(arguments: argparse.Namespace) -> int:
    """Judge the motion in each file, print the results, and add them to the folder of --into; return an exit code.

    The code is 2 if one of several files cannot be judged, else 1 if a motion breaks a law or is cut short, else 3 if
    one is inaccurate, else 0. A single file that cannot be judged raises FileError.
    """
    name, parameters, _ = load_problem(arguments)
    problem = make_problem(name, parameters)
    given = [Path(f) for f in arguments.files]
    paths = [p for f in given for p in list_tables(f)]
    folder = None if arguments.into is None else open_results(_find_folder(arguments.into))
    asked = choose_settings(given[0], vars(arguments))
    judged: list[RunRecord | FileError] = []
    for path in paths:
        try:
            record = judge_file(problem, path, asked, folder, several=len(paths) > 1)
        except FileError as error:
            if len(paths) == 1:
                raise
            judged.append(error)
            if arguments.json:
                print_json({"file": str(path), "error": str(error)})
            continue
        judged.append(record)
        if arguments.json:
            print_json({**make_json_numbers(record), "file": str(path)})
    if folder is not None:
        store.write_table(folder, store.load(folder, check_series=False).records)
    if not arguments.json:
        _print_files(paths, judged, folder)
    codes = {_choose_exit_code(result) for result in judged}
    return next((code for code in (2, 1, INACCURATE) if code in codes), 0)


def _choose_exit_code(result: RunRecord | FileError) -> int:
    """Return the exit code for one file: 0 success, 3 inaccurate, 1 any other status, 2 not judged."""
    if isinstance(result, FileError):
        return 2
    codes = {Status.SUCCESS: 0, Status.INACCURATE: INACCURATE}
    return codes.get(Status(result.status), 1)


def _find_folder(name: str) -> Path:
    """Return the results folder called ``name`` in results/local/ or, if there is none, the path ``name``."""
    local = store.LOCAL / name
    return local if store.is_results(local) else Path(name)


def _print_files(paths: list[Path], judged: list[RunRecord | FileError], folder: Path | None) -> None:
    """Print the record of a single file in full; of several files print a row each, with reasons and notes below.

    ``judged`` has the record of each path, or the error why it could not be judged; ``folder`` is that of --into.
    """
    below = [] if folder is None else [f"written to         {folder}"]
    if len(judged) == 1 and isinstance(judged[0], RunRecord):
        for line in summarize_record(judged[0]) + below:
            make_console().print(line)
        return
    rows = []
    for path, r in zip(paths, judged, strict=True):
        if isinstance(r, FileError):
            below.insert(0, f"not judged: {r}")
            rows.append((str(path), Text("not judged", "bold red"), "-", "-", "-"))
            continue
        below += [f"{r.case}: {'; '.join(list_reasons(r))}"] if r.status != Status.SUCCESS else []
        below += [f"{r.case}: {escape_text(n)}" for n in r.note_lines]
        until = number(r.accurate_until_s) if not math.isnan(r.accurate_until_s) else "-"
        numbers = (number(select_judged_error(r, "position_error", "m")), number(r.energy_drift_max_J), until)
        below += [f"{r.case}: {describe_status(r)}"] if qualify_status(r) else []
        rows.append((r.case, Text(r.status, choose_status_style(r.status)), *numbers))
    print_table(COLUMNS, rows, *below)
