"""``report``: the site of a run folder, or what changed between two."""

import argparse
from pathlib import Path
from typing import Any

from rich.console import Console

from ..results.store import StoreError
from .run import existing
from .terms import UsageError


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    p = commands.add_parser("report", help="write the report of a run, or compare two runs")
    p.add_argument("folder", nargs="*", default=["latest"], help="run folder (default: the newest), or two to compare")
    p.add_argument("--out", type=Path, help="folder of the comparison (default: report/ of the second run)")
    p.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Build it and say where it is."""
    if len(arguments.folder) > 2:
        raise UsageError(f"report takes one run folder, or two to compare (got {len(arguments.folder)})")
    folders = [existing(name) for name in arguments.folder]
    if arguments.out is not None and len(folders) < 2:
        raise UsageError("--out is for the comparison of two runs; the report of one is in its folder")
    from ...reports.pages.compare import write_compare  # here: they take a second to load
    from ...reports.site import build

    try:
        if len(folders) == 2:
            index = write_compare(folders[0], folders[1], arguments.out or folders[1] / "report")
        else:
            index = build(folders[0])
    except StoreError as error:
        raise UsageError(str(error)) from None
    except OSError as error:
        raise UsageError(f"cannot write the report: {error}") from None
    Console(highlight=False, soft_wrap=True).print(f"report: {index}", markup=False)
    return 0
