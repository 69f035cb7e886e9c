"""The surroundings of the command change no result, and machines get JSON, one object a line, and nothing else."""

import json
import os
import subprocess
import sys

import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.catalogue import registry
from mbsbench.harness.mechanics.types import LEAST_RTOL, Status, StepControl
from mbsbench.harness.results import store
from mbsbench.tests.covering import few
from mbsbench.tests.factories import PLUGIN

SUITE = f"""
plugins = ["{PLUGIN}"]
[[runs]]
problem = "free_fall"
solver = ["exact", "gives_up", "raises", "refuses"]
[[runs]]
problem = "heavy_top"
parameters = {{ t_end = 0.01 }}
solver = "rk45_strong_form"
"""
SHORT = f"""
plugins = ["{PLUGIN}"]
[[runs]]
problem = "free_fall"
solver = ["exact", "raises"]
"""
THREADED = """
import threading, time
from mbsbench.harness.catalogue.registry import solver
from mbsbench.tests.harness.misbehaving import Exact

threading.Thread(target=time.sleep, args=(120.0,), daemon=True).start()

@solver("threaded")
class Threaded(Exact):
    pass
"""


def run_suite_by(tmp_path, name, *options, **environ):
    """The suite run by an interpreter with ``options`` and ``environ``: its records, and what it printed."""
    suite = tmp_path / "s.toml"
    suite.write_text(SUITE)
    line = (sys.executable, *options, "-m", "mbsbench.cli", "run", str(suite), "--out", str(tmp_path / name))
    done = subprocess.run(line, cwd=tmp_path, env=os.environ | environ, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    return store.load(tmp_path / name).records


@pytest.mark.slow
def test_an_optimised_interpreter_gives_the_same_results(tmp_path):
    """-OO drops assertions and docstrings: neither decides anything."""
    plain, fast = (
        {r.case: (r.status, r.energy_drift_max_J) for r in run_suite_by(tmp_path, name, *how)}
        for name, how in (("plain", ()), ("fast", ("-OO",)))
    )
    assert str(plain) == str(fast) and len(plain) == 5


@pytest.mark.sampled(0)
def test_the_c_locale_of_a_batch_system_changes_nothing(tmp_path):
    """Its encoding has no sparklines: what is printed is UTF-8 all the same."""
    c = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONIOENCODING": "ascii"}
    run_suite_by(tmp_path, "c", **c)
    line = (sys.executable, "-m", "mbsbench.cli", "show", str(tmp_path / "c"))
    done = subprocess.run(line, cwd=tmp_path, env=os.environ | c, capture_output=True, check=False)
    assert done.returncode == 0 and "heavy_top" in done.stdout.decode("utf-8"), done.stderr


@pytest.mark.sampled(0)
def test_a_plugin_that_starts_threads_when_imported(tmp_path, command):
    """A suite's runs are forked from a process that never imports it; ``solve`` says what to do, in a line."""
    (tmp_path / "threaded.py").write_text(THREADED)
    suite = tmp_path / "t.toml"
    suite.write_text(f'plugins = ["{PLUGIN}", "threaded.py"]\n[[runs]]\nproblem = "free_fall"\nsolver = "threaded"\n')
    assert command("run", "t.toml", "--out", "out").returncode == 0
    plugins = ("--plugin", str(PLUGIN), "--plugin", "threaded.py")
    done = command("solve", "free_fall", "threaded", *plugins, "--out", "x.npz")
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "start a plugin's own in solve" in done.stderr


@pytest.mark.parametrize(
    "name",
    [
        pytest.param("cvode", marks=pytest.mark.beyond_core),
        "ida_index1",
        "ndf_index1",
        "rk45_strong_form",
        "rkmk_dop853",
    ],
)
def test_at_the_least_tolerance_a_run_ends_as_a_status(name):
    """Of a kind each: reached, too small a step, or out of time; no exception, no crash."""
    problem = registry.make_problem("spherical_pendulum", {"omega_z": 0.1, "t_end": 0.05})
    done = registry.make_solver(name).solve(problem, StepControl(rtol=LEAST_RTOL, cpu_limit=20.0))
    assert done.status in (Status.SUCCESS, Status.STEP_UNDERFLOW, Status.STALLED), done.message


PAIRS = """
name = "small"
[[runs]]
problem = "free_fall"
solver = ["exact", "raises"]
dt = [0.1, 0.2]
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    where = tmp_path_factory.mktemp("json")
    (where / "small.toml").write_text(f'plugins = ["{PLUGIN}"]\n' + PAIRS)
    for name in ("a", "b"):
        assert main(["run", str(where / "small.toml"), "--out", str(where / name), "--json"]) == 0
    return where


@pytest.fixture
def objects(place, capsys, monkeypatch):
    """The lines of a command with ``--json``, in the folder of the runs."""

    def call(*arguments, code=0):
        monkeypatch.chdir(place)
        capsys.readouterr()
        assert main([*arguments, "--json"]) == code
        out, err = capsys.readouterr()
        assert not err
        return [json.loads(line, parse_constant=pytest.fail) for line in out.splitlines()]

    return call


@pytest.mark.sampled(0)
def test_run(objects):
    """One object at its end: where, how many, how they ended."""
    (said,) = objects("run", "small.toml", "--out", "c")
    assert said["runs"] == 4 and said["statuses"] == {"success": 2, "crashed": 2}
    assert said["folder"] == "c" and said["not_begun"] == 0 and said["not_combined"] == []


def test_list(objects):
    (said,) = objects("list")
    top = next(p for p in said["problems"] if p["name"] == "heavy_top")
    assert {"t_end", "yaw"} <= {o["name"] for o in top["parameters"]} and all(o["doc"] for o in top["parameters"])
    assert {s["control"] for s in said["solvers"]} == {"dt", "rtol"} and "ci" in said["suites"]


@pytest.mark.parametrize(
    ("arguments", "code", "key"),
    [
        (("show", "a"), 0, "settings_id"),
        (("diff", "a", "b"), 0, "same"),
        (("history", "a", "b"), 0, "energy_drift_max_J"),
        (("merge", "d", "a", "b"), 0, "conflicts"),
        (("verify", "a", "--sample", "1", "--plugin", str(PLUGIN)), 0, "alike"),
        (("solve", "free_fall", "exact", "--out", "x.npz"), 0, "status"),
        (("solve", "free_fall", "raises", "--out", "x.npz"), 1, "status"),
    ],
)
def test_others(objects, arguments, code, key):
    """Numbers that do not exist are null or words, never NaN."""
    said = objects(*arguments, code=code)
    assert said and all(key in x for x in said)


ALL_CLOSED = ">&- 2>&- <&-"


@pytest.mark.sampled(0)
@pytest.mark.parametrize(
    "closed", few(["2>&-", ">&-", "<&-", ALL_CLOSED], lambda closed: closed in ("2>&-", ALL_CLOSED))
)
@pytest.mark.parametrize(
    ("text", "runs"), [(SHORT, 2), pytest.param(SUITE, 5, marks=pytest.mark.slow)], ids=["short", "whole"]
)
def test_closed_streams_cost_no_run(tmp_path, closed, text, runs):
    """As a scheduler or a daemon may start a command: nothing that we open takes their place, and all is run."""
    suite, out = tmp_path / "s.toml", tmp_path / "out"
    suite.write_text(text)
    command = f"{sys.executable} -m mbsbench run {suite} --out {out} {closed}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stdout + done.stderr
    assert len(store.load(out).records) == runs


@pytest.mark.sampled(1)
@pytest.mark.parametrize("command", ["list problems", "show {out}", "run {suite} --dry-run", "list --json"])
def test_a_reader_that_leaves_is_no_success(place, command):
    """`| head -1`, and a reader that takes nothing: 141, without a word."""
    call = f"{sys.executable} -m mbsbench {command.format(out=place / 'a', suite=place / 'small.toml')}"
    script = f'{call} | (exec <&-); echo "${{PIPESTATUS[0]}}"'
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("141\n", "")
