"""``figures``: publication figures and tables of a run, or the paper's own figures from it."""

import argparse
from typing import Any

from rich.console import Console

from ..suites.suite import load_suite
from .run import existing


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    p = commands.add_parser("figures", help="vector figures and tables of a run, for papers")
    p.add_argument("folder", nargs="?", default="latest", help="run folder (default: the newest)")
    p.add_argument("--paper", action="store_true", help="figures 1 to 12 of the paper, with notes, from this run")
    p.add_argument("--only", action="append", default=[], metavar="NAME", help="this figure alone, e.g. fig05")
    p.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Write them and say where they are."""
    folder = existing(arguments.folder)
    from ...reports import publication  # here: they take a second to load
    from ...reports.paper import build as paper

    out = Console(highlight=False, markup=False, soft_wrap=True)
    if arguments.paper:
        paper.command(folder, arguments.only, load_suite("paper").specs, out.print)
    else:
        publication.command(folder, arguments.only, out.print)
    out.print(f"figures: {folder / (paper if arguments.paper else publication).FOLDER}")
    return 0
