"""Repeat a sample of finished runs on this machine and compare (``verify``)."""

import argparse
import random
import tempfile
from pathlib import Path

from ..harness.catalogue.suites.suite import Suite
from ..harness.results import store
from ..harness.results.comparison import compare, is_repeatable
from ..harness.results.provenance import find_differences, is_same_platform, read_environment
from ..harness.results.reproduce import REFEREED
from ..harness.run.full_series import rebuild_spec
from ..harness.run.runner import Request
from .arguments import UsageError, count_jobs, load_plugins
from .diff import show_comparison
from .progress import run_watched, warn_of_deviating_bits
from .terminal import make_console, print_unreadable


def run(arguments: argparse.Namespace) -> int:
    """Repeat a sample of runs and compare; return 0 if they agree, else 1.

    Runs on the same code and platform must agree bit for bit, others within platform differences. An unreadable record
    gives 1, too.
    """
    folder = arguments.results
    plugins = load_plugins(arguments.plugin)
    loaded = store.load(folder)
    records = store.select_newest(loaded.records)
    able = [r for r in records if is_repeatable(r) and r.suite != REFEREED]
    if not able:
        raise UsageError(f"{folder} has no run that can be repeated (none at all, or all stopped by a limit)")
    sample = random.Random(arguments.seed).sample(able, min(arguments.sample, len(able)))
    suite = Suite("verify", "a sample of finished runs", tuple(map(rebuild_spec, sample)), "", plugins)
    warn_of_deviating_bits()
    with tempfile.TemporaryDirectory() as place:
        request = Request(suite, Path(place) / "run", count_jobs(arguments.jobs))
        again, _ = run_watched(request, quiet=arguments.json, resumable=False)
        stamps = read_environment(folder), read_environment(Path(place) / "run")
    found = compare(sample, again.records)
    codes = {r.settings_id: (r.code, r.measured_by) for r in again.records}
    exact = is_same_platform(*stamps) and all((r.code, r.measured_by) == codes.get(r.settings_id) for r in sample)
    good = found.is_identical if exact else found.alike
    show_comparison(found, [d for d in find_differences(*stamps) if d.quantity != "suite"], json=arguments.json)
    if arguments.json:
        print_unreadable(loaded.unreadable)
        return 0 if good and not loaded.unreadable else 1
    out = make_console()
    demand = "bit for bit: same code, same platform" if exact else "within the differences between platforms"
    out.print(f"{'verified' if good else 'NOT verified'}: {len(sample)} of {len(records)} runs ({demand})")
    print_unreadable(loaded.unreadable, out)
    return 0 if good and not loaded.unreadable else 1
