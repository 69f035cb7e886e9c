"""``merge``: the results folders of shards into one."""

import argparse
from pathlib import Path
from typing import Any

from ..harness.results.merging import merge
from .arguments import find_results, subcommand
from .terminal import console, plural, print_json, print_unreadable


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    p = subcommand(commands, "merge", run, "merge results folders into one; the sources are not changed", "one object")
    p.add_argument("out", metavar="OUT", help="results folder to create or to add to")
    p.add_argument("sources", type=find_results, metavar="RESULTS", nargs="+", help="results folders to merge")


def run(arguments: argparse.Namespace) -> int:
    """0 when every record could be read and no run contradicts another, else 1."""
    done = merge(Path(arguments.out), arguments.sources)
    code = 1 if done.unreadable or done.conflicts else 0
    if arguments.json:
        unreadable = [{"path": str(u.path), "why": u.why} for u in done.unreadable]
        plain = {"runs": len(done.records), "added": done.added, "unreadable": unreadable}
        print_json({**plain, "conflicts": done.conflicts, "codes": done.codes})
        return code
    out = console()
    out.print(f"{plural(len(done.records), 'run')} in {arguments.out}, {done.added} of them new")
    print_unreadable(done.unreadable, out)
    for conflict in done.conflicts:
        out.print(f"conflict, the first result is kept: {conflict}")
    if len(done.codes) > 1:
        out.print(f"results of different code: {', '.join(done.codes)}")
    return code
