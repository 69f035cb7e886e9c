"""The gate alone finds a planted fault: in forty copies of the code one line each is changed, and runs are judged."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from mbsbench.harness.results import environment

from .faults import FAULTS

LEAST = 38  # of 40: docs/gate.md names those that stay open, and why
JUDGING = """
import sys, tempfile
from pathlib import Path
from mbsbench.harness.execution import worker
from mbsbench.harness.execution.job import Job
from mbsbench.harness.gate.judging import judge
from mbsbench.harness.gate.thresholds import FOLDER, Thresholds, read_thresholds
from mbsbench.harness.results import store
from mbsbench.harness.suites.suite import load_suite

specs = [c for c in load_suite("ci").specs if c.case.startswith(tuple(sys.argv[1:]))]
assert specs
cases, all_ = {c.case for c in specs}, read_thresholds(FOLDER / "ci.toml")
own = Thresholds("ci", *(tuple(b for b in part if b.case in cases) for part in (all_.bounds, all_.statuses)))
with tempfile.TemporaryDirectory() as place:
    records = [worker.run(Job(c, store.create(Path(place)))) for c in specs]
result = judge(specs, records, own)
print(*(f"{f.state.name} {f.metric} {f.measured:.4g} {f.why}" for f in result.notable), sep="\\n")
sys.exit(0 if result.is_open else 1)
"""


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """The checkout without its results, at a place where the package has its name."""
    folder = tmp_path_factory.mktemp("copy") / "mbsbench"
    listed = ("git", "ls-files", "--cached", "--others", "--exclude-standard")
    done = subprocess.run(listed, cwd=environment.ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip("needs git and a checkout")
    for name in done.stdout.splitlines():
        if not name.startswith(("docs/", "tests/")) and (environment.ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes((environment.ROOT / name).read_bytes())
    return folder


def judged(folder: Path, runs: tuple[str, ...]) -> subprocess.CompletedProcess:
    """What the gate of that copy says of these runs."""
    paths = {"PYTHONPATH": str(folder.parent), "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run(
        (sys.executable, "-c", JUDGING, *runs), cwd=folder, env={**os.environ, **paths}, capture_output=True, text=True,
        check=False,
    )  # fmt: skip


def test_each_fault_is_one_line_that_is_there():
    """Else nothing is planted."""
    assert len(FAULTS) == len(set(FAULTS)) == 40
    for fault in FAULTS:
        text = (environment.ROOT / fault.file).read_text(encoding="utf-8")
        assert text.count(fault.old) == 1 and fault.old != fault.new, fault


@pytest.mark.slow
def test_the_gate_alone_finds_planted_faults(copy):
    """Each copy is what a merge would be: a fault in problems, mechanics, metrics, verdict, references or solvers."""
    sound = judged(copy, tuple({run for fault in FAULTS for run in fault.runs}))
    assert sound.returncode == 0, sound.stdout + sound.stderr
    missed = []
    for fault in FAULTS:
        path = copy / fault.file
        text = path.read_text(encoding="utf-8")
        path.write_text(text.replace(fault.old, fault.new), encoding="utf-8")
        done = judged(copy, fault.runs)
        path.write_text(text, encoding="utf-8")
        said = "closed" if done.returncode else "OPEN"
        sys.stdout.write(f"{said} {fault.file}: {fault.new.strip()}\n{done.stdout[:300]}\n")
        if not done.returncode:
            missed.append(fault)
    assert len(FAULTS) - len(missed) >= LEAST, missed
