"""``report``: the pages of a run folder."""

import argparse
import importlib
from typing import Any

from rich.console import Console

from harness.commands.run import existing
from harness.commands.terms import UsageError


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    p = commands.add_parser("report", help="write the report of a run")
    p.add_argument("folder", nargs="?", default="latest", help="run folder (default: the newest)")
    p.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Build it and say where it is."""
    folder = existing(arguments.folder)
    try:
        site = importlib.import_module("reports.site")  # by name: the harness does not know its readers
    except ModuleNotFoundError as error:
        raise UsageError(f"no report can be built: {error}") from None
    index = site.build(folder)
    Console(highlight=False, soft_wrap=True).print(f"report: {index}")
    return 0
