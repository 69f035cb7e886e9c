"""Run a suite into a results folder, with progress (``run``)."""

import argparse
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from ..harness.catalogue.suites.suite import load_suite
from ..harness.results import store
from ..harness.results.records import RunRecord
from ..harness.run.costs import predict_pages, predict_times
from ..harness.run.remaining_time import format_duration
from ..harness.run.runner import Request, begin_local_pool, choose_pool, find_last_folder, list_waiting, name_new_folder
from ..harness.run.started_runs import WHY as FOREIGN
from .arguments import UsageError, count_jobs, load_plugins
from .keeping import make_series_choice
from .progress import run_watched, warn_of_deviating_bits
from .terminal import list_unreadable, make_console, make_error_console, number, plural, print_json

LISTED = 8  # most solvers listed with keys that they do not take


def run(arguments: argparse.Namespace) -> int:
    """Run the suite, or with --dry-run list its runs; return 0 whatever their statuses.

    Return 1 if a limit left out runs, if other code wrote records, or if runs could not be timed in turns.
    """
    if arguments.dry_run or arguments.cluster is not None:
        return _run_suite(arguments, partial(Request, pool=choose_pool(arguments.cluster)))
    with begin_local_pool() as pool:
        return _run_suite(arguments, partial(Request, pool=pool))


def _run_suite(arguments: argparse.Namespace, make_request: Callable[..., Request]) -> int:
    """Run the suite, or with --dry-run list its runs, and return the exit code of ``run``.

    ``make_request`` makes the request to the runner, with the pool of processes or the cluster already chosen.
    """
    suite = load_suite(arguments.suite, load_plugins(arguments.plugin))
    folder = Path(arguments.out) if arguments.out else None
    if folder is None and arguments.resume:
        folder = find_last_folder(suite.name)
    if arguments.cluster is not None and arguments.jobs is not None:
        raise UsageError("--jobs is for this machine; with --cluster the number of workers is that of the cluster")
    if arguments.in_turns and arguments.cluster is not None:
        raise UsageError("--in-turns times runs on this machine, so it cannot be combined with --cluster")
    if arguments.native and arguments.cluster is not None:
        raise UsageError("--native is for this machine; with --cluster set MBSBENCH_NATIVE=1 where its workers start")
    if arguments.only is not None and arguments.only not in suite.parts:
        known = ", ".join(suite.parts) or "none"
        raise UsageError(f"--only must be a suite that {suite.name} includes: {known} (got {arguments.only!r})")
    target, part = folder or name_new_folder(suite.name), parse_shard(arguments.shard)
    request = make_request(
        suite,
        target,
        count_jobs(arguments.jobs),
        arguments.resume,
        arguments.only,
        arguments.limit,
        part,
        arguments.lossless,
        is_newest=arguments.out is None,
        choose_rows=None if arguments.lossless else make_series_choice(suite),
    )
    if arguments.dry_run:
        return _print_plan(request, as_json=arguments.json)
    if arguments.cluster is None:
        warn_of_deviating_bits()
    if arguments.only is not None and not arguments.json:
        make_error_console().print(_describe_suite(request, is_local=arguments.cluster is None))
    is_local = arguments.cluster is None
    afterwards = _describe_pages(request) if is_local else ""
    loaded, watcher = run_watched(request, quiet=arguments.json, is_local=is_local, afterwards=afterwards)
    watcher.finish(request.folder, loaded)
    late = [
        (path.name, why)
        for path, why in loaded.unreadable.items()
        if why == FOREIGN and watcher.set_aside.get(path) != why
    ]
    for line in list_unreadable("set aside", late):
        make_error_console().print(line)
    failures = (
        _time_in_turns(request.folder, loaded.records, arguments.in_turns, suite.plugins) if arguments.in_turns else []
    )
    if arguments.json:
        counted = Counter(r.status for r in loaded.records)
        drift = dict(zip(("relative", "case"), watcher.worst[:2], strict=True)) if watcher.worst[1] else None
        plain = {"folder": str(request.folder), "runs": len(loaded.records), "statuses": dict(counted)}
        not_combined = list(suite.not_combined)
        print_json({**plain, "not_begun": watcher.left, "worst_drift": drift, "not_combined": not_combined})
    elif suite.not_combined:
        make_console().print(describe_not_combined(suite.not_combined))
    return 1 if watcher.left or failures or late else 0


def _print_plan(request: Request, *, as_json: bool) -> int:
    """Print the runs that the request would make and the expected time of each on this machine; return 0."""
    waiting = list_waiting(request)
    expected = predict_times(waiting, request.jobs, request.suite.name)
    if as_json:
        runs = [{"case": s.case, "seconds": expected.runs[s.settings_id]} for s in waiting]
        whole = {"seconds": expected.seconds, "once_s": expected.once, "jobs": expected.jobs}
        print_json({"suite": request.suite.name, **whole, "runs": runs, "not_combined": request.suite.not_combined})
        return 0
    out = make_console()
    for s in waiting:
        out.print(f"{number(expected.runs[s.settings_id], 2):>8} s  {s.case}")
    out.print(f"{plural(len(waiting), 'run')}{expected.words_after_count}")
    if request.suite.not_combined:
        out.print(describe_not_combined(request.suite.not_combined))
    return 0


def _describe_pages(request: Request) -> str:
    """Describe how long judging and the report will take once the requested runs are made."""
    suite = request.suite
    count = len(suite.specs) if request.only is None else len(suite.parts[request.only])
    return f"; to judge and report takes about {format_duration(predict_pages(count))} more"


def _describe_suite(request: Request, *, is_local: bool) -> str:
    """Describe the number of runs of the suite and their time on this machine, before a part of it is run.

    The time includes judging and a report after this part and after the rest, as ``make bench`` does.
    """
    suite, waiting = request.suite, list_waiting(replace(request, only=None))
    expected = predict_times(waiting, request.jobs, suite.name)
    part = len(suite.parts[request.only]) if request.only else 0
    whole = replace(expected, pages=predict_pages(part) + predict_pages(len(suite.specs)))
    time_needed = whole.words_after_count if is_local else ""
    return f"{request.suite.name}: {plural(len(waiting), 'run')}{time_needed}; now those of {request.only}"


def _time_in_turns(folder: Path, records: Sequence[RunRecord], turns: int, plugins: tuple[str, ...]) -> list[str]:
    """Measure the CPU times again, with runs taking turns, and store them; print and return the runs not timed."""
    from ..harness.run.in_turns import time_in_turns

    make_error_console().print(f"timing in turns, {turns} times each")
    with store.hold_folder(folder):
        _, failures = time_in_turns(folder, records, turns, plugins)
        store.write_table(folder, store.load(folder, check_series=False).records)
    for line in failures:
        make_error_console().print(f"not timed: {line}")
    return failures


def describe_not_combined(rest: Sequence[str]) -> str:
    """Return a line that lists the first ``LISTED`` entries of ``rest`` and counts the others.

    An entry names a solver and a key of its group in the suite that the solver does not take.
    """
    more = f", and {len(rest) - LISTED} more" if rest[LISTED:] else ""
    return f"not combined: {', '.join(rest[:LISTED])}{more}"


def parse_shard(given: str | None) -> tuple[int, int]:
    """Parse ``"2/5"`` into (2, 5), the second of five parts of a suite; None is the whole, (1, 1)."""
    if given is None:
        return 1, 1
    k, _, n = given.partition("/")
    if not (k.isdecimal() and n.isdecimal() and 1 <= int(k) <= int(n)):
        raise UsageError(f"--shard must be K/N with K from 1 to N (got {given!r})")
    return int(k), int(n)
