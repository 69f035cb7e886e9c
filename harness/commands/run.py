"""``run``: a suite into a run folder, with progress."""

import argparse
import json
import os
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..execution.pool import LocalPool
from ..execution.runner import Executor, Request, last_folder, new_folder, run_suite
from ..results import store
from ..suites.suite import load_suite
from .progress import progress
from .screen import lines
from .terms import UsageError, load_plugins


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    p = commands.add_parser("run", help="run a suite")
    p.add_argument("suite", help="name of a suite in harness/suites/, or a TOML file")
    add_running(p)
    p.add_argument("--resume", action="store_true", help="go on with --out, or with the newest run of the suite")
    p.add_argument("--limit", metavar="N", help="only the first N runs")
    p.add_argument("--shard", metavar="K/N", help="of every N runs the K-th, for N machines; then merge the folders")
    p.add_argument("--cluster", metavar="ADDRESS", help="run on a Dask cluster: tcp://host:port or a scheduler file")
    p.add_argument("--json", action="store_true", help="one JSON object at the end, for machines")
    p.set_defaults(run=run)


def add_running(p: argparse.ArgumentParser) -> None:
    """Arguments of all commands that run runs."""
    p.add_argument("--jobs", metavar="N", help="processes at a time (default: cores; 1 for timings to be trusted)")
    p.add_argument("--out", metavar="DIR", help="run folder (default: results/local/<suite>-<time>)")
    p.add_argument(
        "--plugin", action="append", default=[], metavar="FILE.py", help="file with more problems or solvers"
    )


def run(arguments: argparse.Namespace) -> int:
    """Run; 0 whatever the runs' statuses are (failures are results), 1 if a limit left runs out."""
    suite = load_suite(arguments.suite, load_plugins(arguments.plugin))
    folder = Path(arguments.out) if arguments.out else None
    if folder is None and arguments.resume:
        folder = last_folder(suite.name)
    limit = whole(arguments.limit, "--limit") if arguments.limit is not None else None
    if arguments.cluster is not None and arguments.jobs is not None:
        raise UsageError("--jobs is for this machine; a cluster has the size it has")
    target, part = folder or new_folder(suite.name), shard(arguments.shard)
    request = Request(suite, target, jobs(arguments.jobs), arguments.resume, limit, part)
    with progress(size=request.jobs, quiet=arguments.json) as watcher:
        loaded = run_suite(request, watcher, executor(arguments.cluster))
    watcher.finish(request.folder, loaded)
    if arguments.json:
        counted = Counter(r.status for r in loaded.records)
        drift = dict(zip(("relative", "case"), watcher.worst, strict=True)) if watcher.worst[1] else None
        plain = {"folder": str(request.folder), "runs": len(loaded.records), "statuses": dict(counted)}
        lines().print(json.dumps({**plain, "not_begun": watcher.left, "worst_drift": drift}, ensure_ascii=False))
    return 1 if watcher.left else 0


def executor(address: str | None) -> Callable[..., Executor]:
    """Local processes, or the cluster at ``address``."""
    if address is None:
        return LocalPool
    from ..execution.cluster import DaskPool

    def dask(size: int, *watching: Any) -> Executor:
        return DaskPool(address, *watching)

    return dask


def shard(given: str | None) -> tuple[int, int]:
    """``"2/5"`` as (2, 5)."""
    if given is None:
        return 1, 1
    k, _, n = given.partition("/")
    if not (k.isdecimal() and n.isdecimal() and 1 <= int(k) <= int(n)):
        raise UsageError(f"--shard must be K/N with K from 1 to N (got {given!r})")
    return int(k), int(n)


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
        if store.is_results(path):
            return path
        store.refuse_older(path)
    raise UsageError(f"{folder} is not a run folder")
