"""``kernels``: timings of two runs of ``make bench-kernels`` compared, and one kept as the baseline."""

import argparse
import json
import math
from pathlib import Path
from typing import Any

from rich.text import Text

from ..gate.kernels import BASELINE, compared, newest, trimmed
from ..results.store import write_text
from .screen import Column, fitted, lines, screen
from .terms import Parser, UsageError, check_ours, check_writable

COLUMNS = (
    Column("kernel", right=False, fold=True),
    Column("before", rank=1),
    Column("after", rank=2),
    Column("factor"),
)
LIMIT = 1.3  # times slower: ratios of least times repeat to about 10 % on a shared machine


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    p = commands.add_parser("kernels", help="timings of kernels: compare two files of pytest-benchmark, or keep one")
    actions = p.add_subparsers(metavar="ACTION", required=True, parser_class=Parser)
    c = actions.add_parser("compare", help="ratios to the calibration kernel; 0 none slower, 1 one slower or gone")
    c.add_argument("before", nargs="?", metavar="BEFORE.json", help="default: results/baselines/kernels.json")
    c.add_argument("after", nargs="?", metavar="AFTER.json", help="default: the newest of results/local/kernels/")
    c.add_argument("--limit", default=str(LIMIT), metavar="X", help=f"times slower that fails (default: {LIMIT})")
    c.add_argument("--json", action="store_true", help="one JSON object a kernel and line, for machines")
    c.set_defaults(run=run)
    k = actions.add_parser("keep", help="write timings, trimmed, as the committed baseline")
    k.add_argument("file", nargs="?", metavar="FILE.json", help="default: the newest of results/local/kernels/")
    k.add_argument("--out", default=str(BASELINE), help="default: results/baselines/kernels.json")
    k.set_defaults(run=keep)


def keep(arguments: argparse.Namespace) -> int:
    """Write the baseline."""
    source = Path(arguments.file) if arguments.file else newest()
    text, out = trimmed(source), Path(arguments.out)
    check_ours(out, "--out FILE")
    check_writable(out)
    write_text(out, text)
    lines().print(f"{source} kept as {out}")
    return 0


def run(arguments: argparse.Namespace) -> int:
    """0 if no kernel has become slower by more than the limit, else 1."""
    try:
        limit = float(arguments.limit)
    except ValueError:
        limit = math.nan
    if not 1.0 < limit < math.inf:
        raise UsageError(f"--limit must be a finite number > 1 (got {arguments.limit!r})")
    before = Path(arguments.before) if arguments.before else BASELINE
    after = Path(arguments.after) if arguments.after else newest()
    timings = compared(before, after)
    slower = [t for t in timings if t.is_slower(limit)]
    if arguments.json:
        for t in timings:
            plain = {"kernel": t.kernel, "before": _number(t.before), "after": _number(t.after), "slower": t in slower}
            lines().print(json.dumps(plain))
        return 1 if slower else 0
    rows: list[tuple[Text | str, ...]] = []
    for t in timings:
        numbers = ["-" if math.isnan(x) else f"{x:.4g}" for x in (t.before, t.after, t.factor)]
        rows.append((Text(t.kernel, "bold red" if t in slower else ""), *numbers))
    out = screen()
    out.print(fitted(COLUMNS, rows, out.width))
    words = f"{len(slower)} of {len(timings)} slower by more than {limit:g} or gone"
    out.print(Text(f"{before} and {after}, in units of the calibration kernel: {words}"))
    return 1 if slower else 0


def _number(x: float) -> float | None:
    return None if math.isnan(x) else x
