"""``history``: what each run gave, run after run."""

import argparse
from pathlib import Path
from typing import Any

from rich.text import Text

from ..catalogue.options import nearest
from ..files import FileError, to_json
from ..results.history import METRICS, Row, history, read_rows, standing, write_rows
from ..results.store import StoreError
from .run import existing
from .screen import Column, errors, fitted, lines, number, screen, sparkline
from .terms import UsageError, check_writable

COLUMNS = (
    Column("case", right=False, fold=True, least=30), Column("runs", rank=4), Column("first", rank=2), Column("last"),
    Column("over time", right=False), Column("CPU ratio", rank=3), Column("last status", right=False, rank=1),
)  # fmt: skip
WIDTH = 16  # characters of a line over time


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    p = commands.add_parser("history", help="drift, error, status and time of each run over runs and commits")
    p.add_argument("source", nargs="*", help="run folders and .jsonl files (default: all there are)")
    p.add_argument("--metric", default="energy_drift_max_J", help=f"one of {', '.join(METRICS)}")
    p.add_argument("--problem", help="only this one")
    p.add_argument("--solver", help="only this one")
    p.add_argument("--write", metavar="FILE.jsonl", help="write the rows, e.g. of a run to keep in results/history/")
    p.add_argument("--json", action="store_true", help="one JSON row a line, for machines")
    p.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Print one line a run; 1 if something could not be read."""
    if arguments.metric not in METRICS:
        raise UsageError(f"unknown metric {arguments.metric!r}{nearest(arguments.metric, list(METRICS))}")
    if arguments.write:
        check_writable(Path(arguments.write))
    rows, bad = _rows(arguments.source)
    rows = [
        r for r in rows if (arguments.problem or r.problem) == r.problem and (arguments.solver or r.solver) == r.solver
    ]
    if arguments.write:
        write_rows(Path(arguments.write), rows)
    if arguments.json:
        for row in rows:
            lines().print(to_json(row))
    else:
        _table(rows, arguments.metric)
    for words in bad:
        errors().print(words)
    return 1 if bad else 0


def _rows(sources: list[str]) -> tuple[list[Row], list[str]]:
    """The rows, and what could not be read where nobody named it."""
    if sources:
        files = [Path(s) for s in sources if s.endswith(".jsonl")]
        return list(history([existing(s) for s in sources if not s.endswith(".jsonl")], files)), []
    folders, files = standing()
    bad = []
    for file in list(files):
        try:
            read_rows(file)
        except FileError as error:
            bad.append(f"not read: {error}")
            files.remove(file)
    try:
        return list(history(folders, files)), bad
    except StoreError as error:  # a folder that went while we looked
        raise UsageError(str(error)) from None


def _table(rows: list[Row], metric: str) -> None:
    out = screen()
    by_run: dict[str, list[Row]] = {}
    for r in rows:
        by_run.setdefault(r.settings_id, []).append(r)
    shown = []
    for line in sorted(by_run.values(), key=lambda line: line[-1].case):
        values = [getattr(r, metric) for r in line]
        last = line[-1]
        style = "green" if last.status == "success" else "yellow"
        spark = sparkline(values[-WIDTH:], WIDTH)
        numbers = (str(len(line)), number(values[0]), number(values[-1]))
        shown.append((last.case, *numbers, spark, number(last.cpu_ratio), Text(last.status, style)))
    if shown:
        out.print(fitted(COLUMNS, shown, out.width))
    runs = sorted({(r.time, r.results, r.commit) for r in rows})
    out.print(Text(f"{metric}: {len(by_run)} runs in {len(runs)} runs"))
    for time, name, commit in runs[-5:]:
        dirty = "+dirty" if commit.endswith("+dirty") else ""
        out.print(Text(f"  {time}  {commit[:10]}{dirty}  {name}"))
