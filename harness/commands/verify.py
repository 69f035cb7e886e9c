"""``verify``: run a sample of a finished run again, here and now, and compare."""

import argparse
import json
import random
import tempfile
from pathlib import Path
from typing import Any

from ..execution.runner import Request, run_suite
from ..results import store
from ..results.comparison import compare, is_repeatable
from ..results.provenance import differences, same_platform, stamp_of
from ..results.records import RunRecord
from ..sandbox.trial import made
from ..suites.spec import RunSpec, make_spec
from ..suites.suite import Suite
from .diff import as_json, show
from .progress import progress
from .run import existing, jobs, whole
from .screen import lines
from .terms import UsageError, load_plugins

SEED = 1  # the same sample every time, unless --seed says otherwise


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    p = commands.add_parser("verify", help="re-run a sample of a run folder and compare; 0 agrees, 1 does not")
    p.add_argument("folder", help="run folder")
    p.add_argument("--sample", metavar="N", default="5", help="runs to run again (default: 5)")
    p.add_argument("--seed", metavar="K", default=str(SEED), help=f"which sample (default: {SEED})")
    p.add_argument("--jobs", metavar="N", help="processes at a time (default: cores)")
    p.add_argument("--plugin", action="append", default=[], metavar="FILE.py", help="plugin the run was made with")
    p.add_argument("--json", action="store_true", help="one JSON object, for machines")
    p.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """0 if the sample agrees: bit for bit on the same code and platform, else within what machines may differ by."""
    size, seed = whole(arguments.sample, "--sample"), whole(arguments.seed, "--seed")
    folder = existing(arguments.folder)
    plugins = load_plugins(arguments.plugin)
    loaded = store.load(folder)
    specs = store.newest(loaded.records)
    able = [r for r in specs if is_repeatable(r)]
    if not able:
        raise UsageError(f"{folder} has no run that can be repeated (stopped by limits, or none at all)")
    sample = random.Random(seed).sample(able, min(size, len(able)))
    suite = Suite("verify", "a sample run again", tuple(map(run_of, sample)), "", plugins)
    with tempfile.TemporaryDirectory() as place, progress(quiet=arguments.json) as watcher:
        again = run_suite(Request(suite, Path(place) / "run", jobs(arguments.jobs)), watcher)
        stamps = stamp_of(folder), stamp_of(Path(place) / "run")
    found = compare(sample, again.records)
    inputs = [d for d in differences(*stamps) if d.what != "suite"]
    exact = same_platform(*stamps) and all(r.code == again.records[0].code for r in sample)
    good = found.same if exact else found.alike
    out = lines()
    if arguments.json:
        out.print(as_json(found, inputs))
        return 0 if good else 1
    show(found, inputs, limit=40)
    demand = "bit for bit: same code, same platform" if exact else "within what machines may differ by"
    out.print(f"{'verified' if good else 'NOT verified'}: {len(sample)} of {len(specs)} runs ({demand})")
    for item in loaded.unreadable:
        out.print(f"not read: {item.path}: {item.why}")
    return 0 if good and not loaded.unreadable else 1


def run_of(record: RunRecord) -> RunSpec:
    """The run of a record, or UsageError where this checkout would run another."""
    try:
        problem = made(record.problem, json.loads(record.problem_parameters))
        control = {"dt": record.dt_s, "rtol": record.rtol, "max_step": record.max_step_s, "max_steps": record.max_steps}
        given = {k: v for k, v in control.items() if v == v and v > 0}
        limits = {"wall_limit": record.wall_limit_s, "memory": record.memory_limit_MB}
        spec = make_spec(problem, record.solver, json.loads(record.solver_options), given, **limits)
    except ValueError as error:
        raise UsageError(f"{record.case} cannot be run here: {error}") from None
    if spec.settings_id != record.settings_id:
        raise UsageError(f"{record.case} means other settings in this checkout: its defaults have changed")
    return spec
