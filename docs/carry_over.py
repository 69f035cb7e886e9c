"""Carry published results over to the present code: ``python docs/carry_over.py PARENT`` (a commit), or say why not.

A change of names, types or places changes every digest and no number. This makes suite ``ci`` whole, and a hundred runs
of suite ``referee`` drawn by the hash of PARENT, by the code of PARENT and by the present one, under the same pinned
arithmetic. Where statuses and all measured numbers are equal bit for bit, it notes the digests of both in
``results/published/carried.json``: what was published of the one is published of the other. Else it names what differs,
and ``mbsbench run referee`` is needed. Costs are no part of it: they are those of the code that was timed.
"""

import json
import os
import random
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock  # a watcher that says nothing

from mbsbench.harness import machine
from mbsbench.harness.files import to_json
from mbsbench.harness.results.carried import FILE, Generation, carry, present, read_carried
from mbsbench.harness.results.comparison import compare, is_repeatable
from mbsbench.harness.results.environment import ROOT
from mbsbench.harness.results.store import load, newest

DRAWN = 100
RUN = "run"  # the word by which this file, called again, makes the runs with the package that PYTHONPATH names


def main(parent: str) -> int:
    """Return 0 if all runs are equal and the file is written, else 1."""
    commit = _git("rev-parse", "--verify", f"{parent}^{{commit}}")
    with tempfile.TemporaryDirectory() as place:
        before = Path(place) / "before"
        package = before / "mbsbench"
        package.mkdir(parents=True)
        subprocess.run(f"git archive {commit} | tar -x -C {package}", shell=True, cwd=ROOT, check=True)
        there = Path(place) / "after"
        there.mkdir()
        (there / "mbsbench").symlink_to(ROOT)
        digests = [_make_runs(tree, Path(place) / f"{tree.name}-runs", commit) for tree in (before, there)]
        found = [[r for r in newest(load(Path(place) / f"{tree.name}-runs").records) if is_repeatable(r)]
                 for tree in (before, there)]  # fmt: skip
        comparison = compare(*found)
    differing = sorted({c.case for c in comparison.changes} | {*comparison.only_before, *comparison.only_after})
    if differing or not comparison.compared:
        first = f" (the first: {comparison.changes[0]})" if comparison.changes else ""
        _say(
            f"not carried over: {len(differing)} of {comparison.compared} runs differ from those of {commit[:8]}{first}"
        )
        for case in differing:
            _say(f"  {case}")
        return 1
    shown = f"{comparison.compared} runs of suites ci and referee, bit for bit"
    old = Generation(**digests[0], commit=commit, shown=shown)
    FILE.write(to_json(carry(old, present(), read_carried())) + "\n")
    _say(f"carried over from {commit[:8]}: {shown}")
    return 0


def make_runs(folder: Path, seed: str) -> None:
    """Make the runs with the package that is imported; prints its digests."""
    from mbsbench.harness.execution.runner import Request, run_suite
    from mbsbench.harness.results import codes
    from mbsbench.harness.suites.spec import RunSpec
    from mbsbench.harness.suites.suite import Suite, load_suite

    def draw(specs: Sequence[RunSpec]) -> list[RunSpec]:
        return random.Random(seed).sample(sorted(specs, key=lambda s: s.settings_id), DRAWN)

    drawn = draw(load_suite("referee").specs)
    ci = load_suite("ci").specs
    specs = tuple({s.settings_id: s for s in (*drawn, *ci)}.values())
    suite = Suite("carried", "runs by two states of the code", specs, "")
    run_suite(Request(suite, folder, os.cpu_count() or 1), MagicMock())
    here = codes.package_sources()
    sys.stdout.write(json.dumps({"solvers": here.solvers, "problems": here.problems, "measuring": here.measuring}))


def _make_runs(tree: Path, folder: Path, seed: str) -> dict[str, Any]:
    """Make the runs with the package in ``tree``, in processes of their own; its digests."""
    _say(f"runs by the code {tree.name} the change")
    env = {**os.environ, **machine.THREADS, **machine.variables(), "PYTHONPATH": str(tree)}
    call = (sys.executable, __file__, RUN, str(folder), seed)
    done = subprocess.run(call, cwd=tree, env=env, stdout=subprocess.PIPE, check=True, text=True)
    digests: dict[str, Any] = json.loads(done.stdout)
    return digests


def _git(*words: str) -> str:
    return subprocess.run(("git", *words), cwd=ROOT, check=True, capture_output=True, text=True).stdout.strip()


def _say(words: str) -> None:
    sys.stderr.write(f"{words}\n")


if __name__ == "__main__":
    if len(sys.argv) == 4 and sys.argv[1] == RUN:
        make_runs(Path(sys.argv[2]), sys.argv[3])
    elif len(sys.argv) == 2:
        sys.exit(main(sys.argv[1]))
    else:
        sys.exit("usage: python docs/carry_over.py PARENT")
