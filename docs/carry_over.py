"""Carry published results over to the present code, ``python docs/carry_over.py PARENT`` (a commit); list differences.

A change of names, types or places changes every digest and no number. This runs suite ``ci``, and a hundred runs of
suite ``referee`` drawn by the hash of PARENT with one more of each problem, solver and engine not drawn, by the code of
PARENT and by the present one, with the same pinned arithmetic. Solvers for which all statuses and all measured numbers
are equal bit for bit are noted with both digests in ``results/published/carried.json``: what was published for the old
code is then published for the new one. The others are named: their published results must be made again. Costs are
excluded: they are those of the code that was timed.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from mbsbench.harness.base import machine
from mbsbench.harness.base.files import to_json
from mbsbench.harness.judge.referee.carried import FILE, Generation, add_generation, digest_present_code, read_carried
from mbsbench.harness.mechanics.types import Status
from mbsbench.harness.results.comparison import compare, is_repeatable, read_change
from mbsbench.harness.results.environment import ROOT
from mbsbench.harness.results.store import load, select_newest


def main(parent: str) -> int:
    """Run both codes and compare; write ``carried.json`` and return 0 if some solver is carried over, else return 1."""
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
        made = [select_newest(load(Path(place) / f"{tree.name}-runs").records) for tree in (before, there)]
    found = [[r for r in records if is_repeatable(r)] for records in made]
    comparison = compare(*found)
    in_both = {r.case for r in made[0]} & {r.case for r in made[1]}
    unpaired = {*comparison.only_before, *comparison.only_after}
    cases = {c.subject for c in comparison.changes} | (
        unpaired & in_both
    )  # made by both, but a limit ended one of them
    for case in sorted(unpaired - in_both):
        _say(f"not compared, since one of the two suites lacks it: {case}")
    differing = sorted({r.solver for r in (*found[0], *found[1]) if r.case in cases})
    for case in sorted(cases):
        first = next((c for c in comparison.changes if c.subject == case), None)
        words = f": {first.quantity} {' -> '.join(map(str, read_change(first)))}" if first else ""
        _say(f"differs: {case}{words}")
    both = {r.settings_id for r in found[0]}
    equal = [r for r in found[1] if r.settings_id in both and r.solver not in differing and r.status != Status.REFUSED]
    if not equal:
        _say(f"nothing is carried over from {commit[:8]}")
        return 1
    judged = [d.pop("verdicts") for d in digests]
    unlike = sorted(k for k in {*judged[0], *judged[1]} if judged[0].get(k) != judged[1].get(k))
    if unlike:
        _say(f"verdicts on these runs differ, so rules of judging are not carried over: {', '.join(unlike)}")
        digests[0]["judging"] = ""
    shown = f"{len(equal)} runs of suites ci and referee, bit for bit, and the verdicts on them"
    solvers, problems = {r.solver for r in equal}, {r.problem for r in equal}
    old = Generation(**digests[0], commit=commit, shown=shown)
    FILE.write(to_json(add_generation(old, digest_present_code(), read_carried(), solvers, problems)) + "\n")
    _say(f"carried over from {commit[:8]}: {shown}")
    if differing:
        _say(f"not carried over, {len(cases)} runs differ: {', '.join(differing)}")
    return 0


def _make_runs(tree: Path, folder: Path, seed: str) -> dict[str, Any]:
    """Make the runs with the package in ``tree``, in a separate process; return its digests and its verdicts."""
    _say(f"runs by the code {tree.name} the change")
    env = {**os.environ, **machine.THREADS, **machine.list_variables(), "PYTHONPATH": str(tree)}
    for name in (machine.NATIVE, machine.CORE):  # both codes use the pinned arithmetic
        env.pop(name, None)
    script = tree / "mbsbench" / "docs" / "carry_over_runs.py"  # the tree's own: names differ between trees
    call = (sys.executable, str(script), str(folder), seed)
    done = subprocess.run(call, cwd=tree, env=env, stdout=subprocess.PIPE, check=True, text=True)
    digests: dict[str, Any] = json.loads(done.stdout)
    return digests


def _git(*words: str) -> str:
    return subprocess.run(("git", *words), cwd=ROOT, check=True, capture_output=True, text=True).stdout.strip()


def _say(words: str) -> None:
    sys.stderr.write(f"{words}\n")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]) if len(sys.argv) == 2 else "usage: python docs/carry_over.py PARENT")
