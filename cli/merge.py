"""Merge results folders, such as those of shards, into one (``merge``)."""

import argparse
from pathlib import Path

from ..harness.results.merging import merge
from .terminal import make_console, plural, print_json, print_unreadable


def run(arguments: argparse.Namespace) -> int:
    """Merge the folders into OUT and print what was added, could not be read or contradicts another result.

    Return 0 if every record could be read and no run contradicts another, else 1.
    """
    done = merge(Path(arguments.out), arguments.sources)
    code = 1 if done.unreadable or done.conflicts else 0
    if arguments.json:
        unreadable = [{"path": str(path), "why": why} for path, why in done.unreadable.items()]
        plain = {"runs": len(done.records), "added": done.added, "unreadable": unreadable}
        print_json({**plain, "conflicts": done.conflicts, "codes": done.codes})
        return code
    out = make_console()
    out.print(f"{plural(len(done.records), 'run')} in {arguments.out}, {done.added} of them new")
    print_unreadable(done.unreadable, out)
    for conflict in done.conflicts:
        out.print(f"conflict, the first result is kept: {conflict}")
    if done.codes:
        out.print(f"results of different code: {', '.join(done.codes)}")
    return code
