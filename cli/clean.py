"""Remove old results and unused files of caches, except those that a command is writing (``clean``)."""

import argparse

from ..harness.base.cache import list_caches
from ..harness.results import cleaning, store
from .terminal import make_console, plural

UNUSED = 30.0 * cleaning.DAY  # [s] without use after which a file of a cache is removed


def run(arguments: argparse.Namespace) -> int:
    """Remove old results and unused files of caches, or with --dry-run only name them; print their number and size.

    Return 0, also if nothing is old.
    """
    out, dry = make_console(), arguments.dry_run
    verb, count, total = "would remove" if dry else "removed", 0, 0
    for old in cleaning.find_old_folders(store.LOCAL, arguments.keep, arguments.older_than or 0.0):
        gone = not cleaning.is_in_use(old.folder) if dry else cleaning.remove_folder(old.folder)
        if gone:
            count, total = count + 1, total + old.bytes
        words = (
            f"{verb} {old.folder}, {format_megabytes(old.bytes)}" if gone else f"left {old.folder}: it is being written"
        )
        out.print(words, highlight=False, soft_wrap=True)
    age = UNUSED if arguments.older_than is None else arguments.older_than
    caches = [c.folder for c in list_caches()]
    files, size = cleaning.remove_unused(caches, age, dry_run=dry)
    results = plural(count, "results folder")
    out.print(
        f"{verb} {results}, {format_megabytes(total)}, and {plural(files, 'file')} of caches, {format_megabytes(size)}",
        highlight=False,
        soft_wrap=True,
    )
    return 0


def format_megabytes(size: int) -> str:
    """Format a number of bytes in MB."""
    return f"{size / 1e6:.1f} MB"
