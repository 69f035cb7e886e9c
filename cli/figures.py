"""``figures``: publication figures and tables of a results folder, or the paper's own figures from it."""

import argparse
from typing import Any

from ..harness.suites.suite import load_suite
from .arguments import add_results, subcommand
from .terminal import console


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    p = subcommand(commands, "figures", run, "write vector figures and tables for a publication")
    add_results(p)
    p.add_argument("--paper", action="store_true", help="write figures 1 to 12 of the paper instead, with notes")
    only = "only this problem, or with --paper this figure, e.g. fig05; may be repeated"
    p.add_argument("--only", action="append", default=[], metavar="NAME", help=only)


def run(arguments: argparse.Namespace) -> int:
    """Write them and print where they are."""
    folder = arguments.results
    from ..reports import publication  # here: they take a second to load
    from ..reports.paper import build as paper

    out = console()
    if arguments.paper:
        paper.command(folder, arguments.only, load_suite("paper").specs, out.print)
    else:
        publication.command(folder, arguments.only, out.print)
    out.print(f"figures: {folder / (paper if arguments.paper else publication).FOLDER}")
    return 0
