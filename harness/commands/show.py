"""``show``: a run folder as a table on the terminal."""

import argparse
import json
import math
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from harness import records, store
from harness.commands.progress import STYLE
from harness.commands.run import existing
from harness.types import Status

SHOWN = {
    "energy_drift_max_J": "|dE| [J]", "phi_max": "|phi| [m]", "phi_dot_max": "|phi'| [m/s]",
    "position_error_max_m": "error [m]", "orientation_error_max_rad": "error [rad]", "cpu_min_s": "CPU [s]",
}  # fmt: skip


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    p = commands.add_parser("show", help="a run folder as a table")
    p.add_argument("folder", nargs="?", default="latest", help="run folder (default: the newest)")
    p.add_argument("--json", action="store_true", help="one JSON record a line, for machines")
    p.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Print it; 1 if files in it could not be read."""
    folder = existing(arguments.folder)
    loaded = store.load(folder)
    plain = Console(highlight=False, markup=False, soft_wrap=True)
    if arguments.json:
        for record in loaded.records:
            plain.print(json.dumps(json.loads(records.to_json(record)), ensure_ascii=False))
    else:
        _table(loaded)
    for item in loaded.unreadable:
        Console(stderr=True, highlight=False, markup=False, soft_wrap=True).print(f"not read: {item.path}: {item.why}")
    return 1 if loaded.unreadable else 0


def _table(loaded: store.Loaded) -> None:
    table = Table(box=None, padding=(0, 2, 0, 0))
    for name in ("case", "status", "steps", *SHOWN.values()):
        table.add_column(Text(name), justify="left" if name in ("case", "status") else "right", overflow="fold")
    for r in loaded.records:
        numbers = [_short(getattr(r, name)) for name in SHOWN]
        table.add_row(Text(r.case), Text(r.status, STYLE.get(Status(r.status), "yellow")), str(r.steps), *numbers)
    out = Console()
    if not out.is_terminal:
        out = Console(width=200)
    out.print(table)
    for r in loaded.records:
        if r.status != Status.SUCCESS:
            why = "; ".join(json.loads(r.wrong_because)) or r.message
            out.print(Text(f"{r.status}: {r.case}: {why}"))


def _short(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.3g}"
