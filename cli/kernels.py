"""``kernels``: compare the timings of ``make bench-kernels`` with a baseline, or make them the baseline."""

import argparse
from pathlib import Path
from typing import Any

from rich.text import Text

from ..harness.files import write_text
from ..harness.gate.kernels import BASELINE, compared, newest, trimmed
from .screen import Column, lines, number, print_json, print_table
from .terms import Parser, above, check_ours, check_writable, subcommand

COLUMNS = (
    Column("kernel", fold=True), Column("before", rank=1), Column("after", rank=2), Column("factor"),
)  # fmt: skip
LIMIT = 1.3  # times slower: ratios of least times repeat to about 10 % on a shared machine
NEWEST = "default: the newest file in results/local/kernels/"


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    words = "compare timings of the kernels with a baseline, or keep them as the baseline"
    p = subcommand(commands, "kernels", run, words)
    actions = p.add_subparsers(metavar="ACTION", required=True, parser_class=Parser)
    words = "compare two timing files; exit code 1 if a kernel is slower or missing"
    c = subcommand(actions, "compare", run, words, "one object per kernel")
    c.add_argument("before", nargs="?", metavar="BEFORE.json", help="default: results/baselines/kernels.json")
    c.add_argument("after", nargs="?", metavar="AFTER.json", help=NEWEST)
    c.add_argument("--limit", default=str(LIMIT), metavar="X", help=f"largest factor allowed (default: {LIMIT})")
    k = subcommand(actions, "keep", keep, "write a timing file, trimmed, as the baseline")
    k.add_argument("file", nargs="?", metavar="FILE.json", help=NEWEST)
    k.add_argument("--out", default=str(BASELINE), metavar="FILE", help="default: results/baselines/kernels.json")


def keep(arguments: argparse.Namespace) -> int:
    """Write the baseline."""
    source = Path(arguments.file) if arguments.file else newest()
    text, out = trimmed(source), Path(arguments.out)
    check_ours(out, "--out FILE")
    check_writable(out)
    write_text(out, text)
    lines().print(f"baseline {out} written from {source}")
    return 0


def run(arguments: argparse.Namespace) -> int:
    """0 if no kernel has become slower by more than the limit, else 1."""
    limit = above(arguments.limit, "--limit", 1.0)
    before = Path(arguments.before) if arguments.before else BASELINE
    after = Path(arguments.after) if arguments.after else newest()
    timings = compared(before, after)
    slower = [t for t in timings if t.is_slower(limit)]
    if arguments.json:
        for t in timings:
            print_json({"kernel": t.kernel, "before": t.before, "after": t.after, "slower": t in slower})
        return 1 if slower else 0
    rows: list[tuple[Text | str, ...]] = [
        (Text(t.kernel, "bold red" if t in slower else ""), *(number(x, 4) for x in (t.before, t.after, t.factor)))
        for t in timings
    ]
    summary = f"{len(slower)} of {len(timings)} kernels slower by more than a factor of {limit:g}, or missing"
    print_table(COLUMNS, rows, f"{before} and {after}, relative to the calibration kernel: {summary}")
    return 1 if slower else 0
