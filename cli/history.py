"""Show each run over results folders and commits, those whose status changed first (``history``)."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from rich.text import Text

from ..harness.base.files import FileError
from ..harness.base.hints import suggest_name
from ..harness.results.history import find_histories, merge_rows, read_folder, read_rows, write_rows
from ..harness.results.rows import METRICS, Row
from .arguments import UsageError, find_results
from .terminal import Column, draw_sparkline, make_error_console, number, plural, print_json, print_table

COLUMNS = (
    Column("case", fold=True, least=30),
    Column("results", rank=4),
    Column("first", rank=2),
    Column("last"),
    Column("history", right=False),
    Column("CPU ratio", rank=3),
    Column("last status", right=False, rank=1),
)
WIDTH = 16  # characters of a sparkline


def run(arguments: argparse.Namespace) -> int:
    """Print one line per run of the chosen problem and solver, and write the rows with --write.

    Return 1 if a file could not be read, else 0.
    """
    if arguments.metric not in METRICS:
        raise UsageError(f"unknown metric {arguments.metric!r}{suggest_name(arguments.metric, list(METRICS))}")
    rows, unreadable = _load_rows(arguments.source)
    problem, solver = arguments.problem, arguments.solver
    rows = [r for r in rows if problem in (None, "", r.problem) and solver in (None, "", r.solver)]
    if arguments.write:
        write_rows(arguments.write, rows)
    if arguments.json:
        for row in rows:
            print_json(row)
    else:
        _print_rows(rows, arguments.metric)
    for line in unreadable:
        make_error_console().print(line)
    return 1 if unreadable else 0


def _load_rows(sources: list[str]) -> tuple[Sequence[Row], list[str]]:
    """Return one row per run and results folder, and a line on each file that could not be read.

    ``sources`` are results folders and .jsonl files; if there are none, all histories are read. A file that is named
    in ``sources`` and cannot be read raises FileError.
    """
    if sources:
        files = [Path(s) for s in sources if s.endswith(".jsonl")]
        folders = [find_results(s) for s in sources if not s.endswith(".jsonl")]
    else:
        folders, files = find_histories()
    rows, unreadable = [], []
    for file in files:
        try:
            rows.append(read_rows(file))
        except FileError as error:
            if sources:
                raise
            unreadable.append(f"unreadable: {error}")
    return merge_rows([*map(read_folder, folders)], rows), unreadable


def _print_rows(rows: Sequence[Row], metric: str) -> None:
    """Print one line per run: first and last value of the metric, a sparkline, CPU ratio and last status.

    Runs whose status changed come first, then all by case; the last five results folders are named below.
    """
    by_run: dict[str, list[Row]] = {}
    for r in rows:
        by_run.setdefault(r.settings_id, []).append(r)
    shown = []
    for line in sorted(by_run.values(), key=lambda line: (len({r.status for r in line}) == 1, line[-1].case)):
        values = [getattr(r, metric) for r in line]
        last = line[-1]
        style = "green" if last.status == "success" else "yellow"
        numbers = (str(len(line)), number(values[0]), number(values[-1]))
        spark = draw_sparkline(values[-WIDTH:], WIDTH)
        shown.append((last.case, *numbers, spark, number(last.cpu_ratio), Text(last.status, style)))
    folders = sorted({(r.time, r.results, r.commit) for r in rows})
    below = [f"{metric}: {plural(len(by_run), 'run')} in {plural(len(folders), 'results folder')}"]
    for time, name, commit in folders[-5:]:
        digits, dirty, _ = commit.partition("+dirty")
        below.append(f"  {time}  {digits[:10]}{dirty}  {name}")
    print_table(COLUMNS, shown, *below)
