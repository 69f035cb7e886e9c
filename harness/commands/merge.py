"""``merge``: the run folders of shards into one."""

import argparse
import json
from pathlib import Path
from typing import Any

from ..results.merging import merge
from .run import existing
from .screen import lines


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    p = commands.add_parser("merge", help="run folders of shards into one; the sources stay as they are")
    p.add_argument("out", metavar="OUT", help="run folder, new or to be added to")
    p.add_argument("sources", metavar="IN", nargs="+", help="run folders")
    p.add_argument("--json", action="store_true", help="one JSON object, for machines")
    p.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """0 when every record was good and no run contradicts another, else 1."""
    done = merge(Path(arguments.out), [existing(f) for f in arguments.sources])
    out = lines()
    if arguments.json:
        unreadable = [{"path": str(u.path), "why": u.why} for u in done.unreadable]
        plain = {"runs": len(done.records), "added": done.added, "unreadable": unreadable}
        out.print(json.dumps({**plain, "conflicts": done.conflicts, "codes": done.codes}, ensure_ascii=False))
        return 1 if done.unreadable or done.conflicts else 0
    out.print(f"{len(done.records)} runs in {arguments.out}, {done.added} of them new")
    for item in done.unreadable:
        out.print(f"not read: {item.path}: {item.why}")
    for words in done.conflicts:
        out.print(f"contradiction, the first is kept: {words}")
    if len(done.codes) > 1:
        out.print(f"results of different code: {', '.join(done.codes)}")
    return 1 if done.unreadable or done.conflicts else 0
