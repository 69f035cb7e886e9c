"""``verify``: repeat a sample of finished runs on this machine and compare."""

import argparse
import json
import random
import tempfile
from pathlib import Path
from typing import Any

from ..harness.execution.runner import Request, run_suite
from ..harness.results import store
from ..harness.results.comparison import compare, is_repeatable
from ..harness.results.provenance import differences, same_platform, stamp_of
from ..harness.results.records import RunRecord
from ..harness.results.reproduce import REFEREED
from ..harness.sandbox.trial import made
from ..harness.suites.spec import RunSpec, make_spec
from ..harness.suites.suite import Suite
from .diff import show
from .progress import progress
from .screen import lines, print_unreadable
from .terms import RESULTS, UsageError, add_jobs, add_plugin, existing, jobs, load_plugins, subcommand, whole

SEED = 1  # the same sample every time, unless --seed says otherwise


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    words = "repeat a sample of finished runs and compare; exit code 0 if they agree, 1 if not"
    p = subcommand(commands, "verify", run, words, "one object, as diff prints it")
    p.add_argument("results", metavar="RESULTS", help=RESULTS)
    p.add_argument("--sample", metavar="N", default="5", help="number of runs to repeat (default: 5)")
    p.add_argument("--seed", metavar="K", default=str(SEED), help=f"seed of the sample (default: {SEED})")
    add_jobs(p)
    add_plugin(p, "plugin that the results were made with")


def run(arguments: argparse.Namespace) -> int:
    """0 if the sample agrees: bit for bit on the same code and platform, else within platform differences."""
    size, seed = whole(arguments.sample, "--sample"), whole(arguments.seed, "--seed")
    folder = existing(arguments.results)
    plugins = load_plugins(arguments.plugin)
    loaded = store.load(folder)
    records = store.newest(loaded.records)
    able = [r for r in records if is_repeatable(r) and r.suite != REFEREED]
    if not able:
        raise UsageError(f"{folder} has no run that can be repeated (none at all, or all stopped by a limit)")
    sample = random.Random(seed).sample(able, min(size, len(able)))
    suite = Suite("verify", "a sample of finished runs", tuple(map(run_of, sample)), "", plugins)
    with tempfile.TemporaryDirectory() as place, progress(quiet=arguments.json, resumable=False) as watcher:
        again = run_suite(Request(suite, Path(place) / "run", jobs(arguments.jobs)), watcher)
        stamps = stamp_of(folder), stamp_of(Path(place) / "run")
    found = compare(sample, again.records)
    made = {r.settings_id: r.code for r in again.records}
    exact = same_platform(*stamps) and all(r.code == made.get(r.settings_id) for r in sample)
    good = found.same if exact else found.alike
    show(found, [d for d in differences(*stamps) if d.what != "suite"], json=arguments.json)
    if arguments.json:
        return 0 if good else 1
    out = lines()
    demand = "bit for bit: same code, same platform" if exact else "within the differences between platforms"
    out.print(f"{'verified' if good else 'NOT verified'}: {len(sample)} of {len(records)} runs ({demand})")
    print_unreadable(loaded.unreadable, out)
    return 0 if good and not loaded.unreadable else 1


def run_of(record: RunRecord) -> RunSpec:
    """The spec of a record's run, or UsageError where this checkout would run something else."""
    try:
        problem = made(record.problem, json.loads(record.problem_parameters))
        control = {"dt": record.dt_s, "rtol": record.rtol, "max_step": record.max_step_s, "max_steps": record.max_steps}
        given = {k: v for k, v in control.items() if v == v and v > 0}
        limits = {
            "cpu_limit": record.cpu_limit_s if record.cpu_limit_s == record.cpu_limit_s else record.wall_limit_s,
            "memory": record.memory_limit_MB,
        }
        spec = make_spec(problem, record.solver, json.loads(record.solver_options), given, **limits)
    except ValueError as error:
        raise UsageError(f"{record.case} cannot be run here: {error}") from None
    if spec.settings_id != record.settings_id:
        raise UsageError(f"{record.case} has other settings in this checkout: defaults have changed")
    return spec
