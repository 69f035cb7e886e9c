"""``run``: a suite into a run folder, with progress."""

import argparse
import os
from pathlib import Path
from typing import Any

from harness import store
from harness.commands.progress import progress
from harness.commands.terms import UsageError, load_plugins
from harness.runner import Request, last_folder, new_folder, run_suite
from harness.suites import load_suite


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    p = commands.add_parser("run", help="run a suite")
    p.add_argument("suite", help="name of a suite in harness/suites/, or a TOML file")
    add_running(p)
    p.add_argument("--resume", action="store_true", help="go on with --out, or with the newest run of the suite")
    p.add_argument("--limit", metavar="N", help="only the first N cells")
    p.set_defaults(run=run)


def add_running(p: argparse.ArgumentParser) -> None:
    """Arguments of all commands that run cells."""
    p.add_argument("--jobs", metavar="N", help="processes at a time (default: cores; 1 for timings to be trusted)")
    p.add_argument("--out", metavar="DIR", help="run folder (default: results/local/<suite>-<time>)")
    p.add_argument(
        "--plugin", action="append", default=[], metavar="FILE.py", help="file with more problems or solvers"
    )


def run(arguments: argparse.Namespace) -> int:
    """Run; 0 whatever the cells' statuses are (failures are results), 2 for a wrong call."""
    suite = load_suite(arguments.suite, load_plugins(arguments.plugin))
    folder = Path(arguments.out) if arguments.out else None
    if folder is None and arguments.resume:
        folder = last_folder(suite.name)
    limit = whole(arguments.limit, "--limit") if arguments.limit is not None else None
    request = Request(suite, folder or new_folder(suite.name), jobs(arguments.jobs), arguments.resume, limit)
    with progress() as watcher:
        loaded = run_suite(request, watcher)
    watcher.finish(request.folder, loaded)
    return 0


def jobs(given: str | None) -> int:
    """Number of processes."""
    return (
        whole(given, "--jobs")
        if given is not None
        else len(os.sched_getaffinity(0))
        if hasattr(os, "sched_getaffinity")
        else os.cpu_count() or 1
    )


def whole(text: str, what: str) -> int:
    """A whole number > 0 from the command line."""
    if not text.isdecimal() or int(text) < 1:
        raise UsageError(f"{what} must be a whole number > 0 (got {text!r})")
    return int(text)


def existing(folder: str) -> Path:
    """A run folder given by path or by its name in results/local/."""
    for path in (Path(folder), store.LOCAL / folder):
        if (path / "cells").is_dir():
            return path
    raise UsageError(f"{folder} is not a run folder")
