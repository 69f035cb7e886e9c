"""``report``: the web pages of a results folder, or the comparison of two."""

import argparse

from ..harness.places import Place
from ..harness.results import store
from .arguments import UsageError, find_results
from .terminal import console


def run(arguments: argparse.Namespace) -> int:
    """Write it and print where it is."""
    if len(arguments.results) > 2:
        raise UsageError(f"report takes one results folder, or two to compare (got {len(arguments.results)})")
    folders = [find_results(name) for name in arguments.results]
    if arguments.out is not None and len(folders) < 2:
        raise UsageError("--out needs two results folders to compare; the report of one is written into it")
    from ..reports.pages.compare import write_compare  # here: they take a second to load
    from ..reports.site import build

    with store.in_use(folders[-1]):
        if len(folders) == 1:
            index = build(folders[0])
        elif arguments.out is None:
            index = write_compare(folders[0], folders[1], Place(folders[1]) / "report")
        else:
            arguments.out.mkdir(parents=True, exist_ok=True)
            index = write_compare(folders[0], folders[1], Place(arguments.out))
    console().print(f"report: {index}")
    return 0
