"""No silent green: a gate that does not come to its verdict is red, whatever ended it and whatever it was given."""

import dataclasses
import datetime
import subprocess
import sys
from pathlib import Path

import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.judge.gate.check import describe_contradiction
from mbsbench.harness.results import environment, store
from mbsbench.harness.results.records import RunRecord

GOOD = RunRecord(
    run_id="a",
    case="c",
    problem="p",
    solver="s",
    status="success",
    claimed="success",
    ended_by="solver",
    finished=environment.read_utc_time(),
)
LEAVES = {  # a plugin that leaves wherever it is imported, and one that does where it was tried before
    "everywhere": "import os\nos._exit(0)\n",
    "then": "import os\nif os.path.exists('tried'):\n    os._exit(0)\nopen('tried', 'w').close()\n",
    "at its end": "import atexit, os\natexit.register(os._exit, 0)\n",
}
MARKED = '''
from mbsbench import make_problem, problem
@problem("there")
def there():
    """A pendulum."""
    return make_problem("spherical_pendulum", {"t_end": 0.5})
'''
SUITE = """
plugins = ["leaves.py"]
[[runs]]
problem = "spherical_pendulum"
solver = "rattle"
dt = 0.01
"""


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("where", "words"), [("everywhere", "leaves.py"), ("then", "ended before its verdict"), ("at its end", "")]
)
def test_a_plugin_that_leaves_takes_no_verdict_with_it(tmp_path: Path, where: str, words: str) -> None:
    """By os._exit(0), in the process that tries it or only in that which judges: a failure, and files that say so."""
    (tmp_path / "leaves.py").write_text(LEAVES[where] + MARKED)
    (tmp_path / "s.toml").write_text(SUITE)
    (tmp_path / "t.toml").write_text('schema = 2\nsuite = "s"\n')
    files = {"--junit": tmp_path / "j.xml", "--markdown": tmp_path / "m.md"}
    given = [str(x) for pair in files.items() for x in pair]
    done = subprocess.run(
        [sys.executable, "-m", "mbsbench", "gate", "--suite", "s.toml", "--thresholds", "t.toml", *given],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode != 0
    assert words in done.stderr
    if where == "at its end":  # it judged, and the plugin cannot turn that into 0
        assert done.returncode == 1 and "gate CLOSED" in done.stdout
        return
    assert 'failures="1"' in files["--junit"].read_text() and "not finished" in files["--markdown"].read_text()


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({}, ""),
        ({"status": "crashed", "claimed": "", "ended_by": "signal"}, ""),
        ({"status": "wrong"}, ""),
        ({"claimed": ""}, "success, though its solver claimed nothing and solver ended it"),
        ({"ended_by": "signal"}, "success, though its solver claimed success and signal ended it"),
        ({"status": "inaccurate", "claimed": "diverged"}, "inaccurate, though its solver claimed diverged"),
        ({"finished": "2099-01-01T00:00:00.000000Z"}, "finished at 2099-01-01T00:00:00.000000Z, which is to come"),
    ],
)
def test_records_that_contradict_themselves_are_named(changed: dict[str, str], words: str) -> None:
    """An hour by which clocks differ is none of it."""
    assert words in describe_contradiction(dataclasses.replace(GOOD, **changed))
    assert bool(words) is bool(describe_contradiction(dataclasses.replace(GOOD, **changed)))
    soon = datetime.datetime.now(datetime.UTC) + datetime.timedelta(hours=1)
    assert not describe_contradiction(dataclasses.replace(GOOD, finished=soon.strftime("%Y-%m-%dT%H:%M:%S.%fZ")))


def test_the_gate_judges_no_record_that_contradicts_itself(tmp_path: Path, capsys) -> None:
    """One that says success of a run that a signal ended; one of 2099, which would outlive a newer failure."""
    folder = store.create_folder(tmp_path / "r")
    for changed in ({"ended_by": "signal"}, {"finished": "2099-01-01T00:00:00.000000Z"}):
        store.write_record(folder, dataclasses.replace(GOOD, **changed))
        assert main(["gate", "--results", str(folder), "--any-code"]) == 2
        assert "1 record cannot be judged: c: " in capsys.readouterr().err
