"""The gate alone finds a planted fault: in a copy of the code one line is changed, and the runs it meets are judged.

In parts: ``pytest tests/harness/judge/gate/test_mutations.py -k measure``.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from mbsbench.harness.catalogue.suites.suite import load_suite
from mbsbench.harness.reference import orbit
from mbsbench.harness.results import environment
from mbsbench.tests.factories import copy_checkout

from .faults import FAULTS

LEAST = 38  # of 40: docs/judging.md says how many
DRIVER = """
import json, os, sys, tempfile
from pathlib import Path
import casadi, numba, numpy, pandas, scipy.integrate, scipy.spatial.transform  # once; the package itself in each child

def judged(runs):
    from mbsbench.tests.factories import run_here
    from mbsbench.harness.run.job import Job
    from mbsbench.harness.judge.gate.check import is_open, judge_runs, select_notable
    from mbsbench.harness.judge.gate.baseline import FOLDER, read_thresholds
    from mbsbench.harness.judge.gate.thresholds import Thresholds
    from mbsbench.harness.results import store
    from mbsbench.harness.catalogue.suites.suite import load_suite

    specs = [c for c in load_suite("ci").specs if c.case.startswith(tuple(runs))]
    assert specs, runs
    cases, all_ = {c.case for c in specs}, read_thresholds(FOLDER / "ci.toml")
    own = Thresholds("ci", *(tuple(b for b in part if b.case in cases) for part in (all_.bounds, all_.statuses)))
    with tempfile.TemporaryDirectory() as place:
        found = judge_runs(specs, [run_here(Job(c, store.create_folder(Path(place)))) for c in specs], own)
    sys.stderr.write("".join(f"{f.verdict} {f.quantity} {f.text}\\n" for f in select_notable(found)[:3]))
    return is_open(found)

for line in sys.stdin:
    child = os.fork()
    if not child:
        code = 3
        try:
            code = 0 if judged(json.loads(line)) else 1
        except Exception as error:
            sys.stderr.write(f"{type(error).__name__}: {error}\\n")
        finally:
            os._exit(code)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """The checkout without its results, at a place where the package has its name."""
    folder = tmp_path_factory.mktemp("copy") / "mbsbench"
    copy_checkout(folder, lambda name: not name.startswith(("docs/", "tests/")))
    if orbit.FOLDER.is_dir():  # references that are known already
        shutil.copytree(orbit.FOLDER, folder / orbit.FOLDER.relative_to(environment.ROOT))
    return folder


@pytest.fixture(scope="module")
def judged(copy):
    """Whether the gate of that copy, as it is now, is open for these runs: 0, closed: 1, or cannot judge them: 3."""
    environ = {**os.environ, "PYTHONPATH": str(copy.parent), "PYTHONDONTWRITEBYTECODE": "1"}
    pipe = subprocess.PIPE
    driver = subprocess.Popen((sys.executable, "-c", DRIVER), cwd=copy, env=environ, stdin=pipe, stdout=pipe, text=True)

    def ask(runs: tuple[str, ...]) -> int:
        driver.stdin.write(json.dumps(runs) + "\n")
        driver.stdin.flush()
        return int(driver.stdout.readline())

    yield ask
    driver.stdin.close()
    driver.wait()


def test_each_fault_is_one_line_that_is_there_and_has_its_runs():
    """Else nothing is planted, or nothing run."""
    cases = [c.case for c in load_suite("ci").specs]
    assert len(FAULTS) == len(set(FAULTS)) == 40
    for fault in FAULTS:
        text = (environment.ROOT / fault.file).read_text(encoding="utf-8")
        assert text.count(fault.old) == 1 and fault.old != fault.new, fault
        assert all(any(case.startswith(run) for case in cases) for run in fault.runs), fault


def test_the_score_is_that_of_the_page():
    """Those that the gate stays open for say why, and the tests below hold each to it."""
    found = sum(not fault.open for fault in FAULTS)
    page = (environment.ROOT / "docs" / "judging.md").read_text(encoding="utf-8")
    assert found >= LEAST and f"{found} of the forty" in page


@pytest.mark.slow
def test_without_a_fault_the_same_runs_are_within_their_bounds(judged):
    """Else a gate that is closed shows nothing."""
    assert judged(sorted({run for fault in FAULTS for run in fault.runs})) == 0


@pytest.mark.slow
@pytest.mark.parametrize("fault", [pytest.param(f, id=f"{n:02d}-{Path(f.file).stem}") for n, f in enumerate(FAULTS)])
def test_the_gate_alone_finds_a_planted_fault(fault, copy, judged):
    """Each copy is what a merge would be: a fault in problems, mechanics, metrics, verdict, references or solvers."""
    path = copy / fault.file
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace(fault.old, fault.new), encoding="utf-8")
    try:
        assert (judged(fault.runs) == 0) is bool(fault.open)
    finally:
        path.write_text(text, encoding="utf-8")
