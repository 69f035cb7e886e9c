"""``merge``: the run folders of shards into one."""

import argparse
from pathlib import Path
from typing import Any

from rich.console import Console

from harness.commands.run import existing
from harness.merging import merge


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    p = commands.add_parser("merge", help="run folders of shards into one; the sources stay as they are")
    p.add_argument("out", metavar="OUT", help="run folder, new or to be added to")
    p.add_argument("sources", metavar="IN", nargs="+", help="run folders")
    p.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """0 when every record was good and no cell contradicts another, else 1."""
    done = merge(Path(arguments.out), [existing(f) for f in arguments.sources])
    out = Console(highlight=False, markup=False, soft_wrap=True)
    out.print(f"{len(done.records)} cells in {arguments.out}, {done.added} of them new")
    for item in done.unreadable:
        out.print(f"not read: {item.path}: {item.why}")
    for words in done.conflicts:
        out.print(f"contradiction, the first is kept: {words}")
    if len(done.codes) > 1:
        out.print(f"results of different code: {', '.join(done.codes)}")
    return 1 if done.unreadable or done.conflicts else 0
