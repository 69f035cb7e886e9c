"""``kernels compare``: timings of two runs of ``make bench-kernels``."""

import argparse
import json
import math
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from harness.commands.terms import UsageError
from harness.kernels import compared

LIMIT = 1.3  # times slower: ratios of least times repeat to about 10 % on a shared machine


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    p = commands.add_parser("kernels", help="timings of kernels: compare two files of pytest-benchmark")
    p.add_argument("action", choices=("compare",))
    p.add_argument("before", metavar="BEFORE.json")
    p.add_argument("after", metavar="AFTER.json")
    p.add_argument("--limit", default=str(LIMIT), metavar="X", help=f"times slower that fails (default: {LIMIT})")
    p.add_argument("--json", action="store_true", help="one JSON object a kernel and line, for machines")
    p.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """0 if no kernel has become slower by more than the limit, else 1."""
    try:
        limit = float(arguments.limit)
    except ValueError:
        limit = math.nan
    if not 1.0 < limit < math.inf:
        raise UsageError(f"--limit must be a finite number > 1 (got {arguments.limit!r})")
    timings = compared(Path(arguments.before), Path(arguments.after))
    slower = [t for t in timings if t.is_slower(limit)]
    out = Console(highlight=False, markup=False, soft_wrap=True)
    if arguments.json:
        for t in timings:
            plain = {"kernel": t.kernel, "before": _number(t.before), "after": _number(t.after), "slower": t in slower}
            out.print(json.dumps(plain))
        return 1 if slower else 0
    table = Table(box=None, padding=(0, 2, 0, 0))
    for name in ("kernel", "before", "after", "factor"):
        table.add_column(name, justify="left" if name == "kernel" else "right", overflow="fold")
    for t in timings:
        numbers = ["-" if math.isnan(x) else f"{x:.4g}" for x in (t.before, t.after, t.factor)]
        table.add_row(Text(t.kernel, "bold red" if t in slower else ""), *numbers)
    Console(width=None if Console().is_terminal else 160).print(table)
    out.print(
        f"in units of the calibration kernel; {len(slower)} of {len(timings)} slower by more than {limit:g} or gone"
    )
    return 1 if slower else 0


def _number(x: float) -> float | None:
    return None if math.isnan(x) else x
