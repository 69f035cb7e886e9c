"""A run ended from outside is no result of its solver, and finished runs stay."""

import os
import signal
import subprocess
import sys
import time

import psutil
import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.base.forked_process import ASLEEP, ForkedProcess
from mbsbench.harness.results import environment, store
from mbsbench.harness.run.pool import PoolError
from mbsbench.tests.factories import PLUGIN, Silent, run_suite_text

from ..conftest import HOSTILE

SLEEPS = '[[runs]]\nproblem = "free_fall"\nsolver = "sleeps"\ncpu_limit = {wall}\noptions = {{ seconds = {seconds} }}\n'


def test_a_process_that_ended_before_anyone_looked_was_not_killed():
    """Its end is read before the clock: past its deadline, it still ended by itself."""
    process = ForkedProcess(lambda send: send("done"), limit=5.0, memory=500.0, wall=0.3)
    time.sleep(ASLEEP + 0.5)
    while (ended := process.check_end()) is None:
        pass
    assert (ended.code, ended.killed, ended.suspended) == (0, False, True)


def test_a_deadline_leaves_out_time_in_which_its_keeper_was_stopped():
    """Nobody looked for longer than the limit: the process has its time still, and is ended when that is over."""
    process = ForkedProcess(lambda send: time.sleep(600.0), limit=5.0, memory=500.0, wall=1.0)
    time.sleep(ASLEEP + 0.5)
    assert process.check_end() is None and not process.killed
    ended, began = process.wait(), time.monotonic()
    assert ended.killed and ended.suspended and time.monotonic() - began < 30.0


def started(tmp_path, text):
    """The command, and the processes it has started once a solver runs."""
    suite = tmp_path / "s.toml"
    suite.write_text(f'name = "s"\nplugins = ["{PLUGIN}", "{HOSTILE}"]\n{text}')
    line = (sys.executable, "-m", "mbsbench.cli", "run", str(suite), "--out", str(tmp_path / "run"), "--jobs", "1")
    process = subprocess.Popen(line, cwd=environment.ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    until = time.monotonic() + 300.0
    while not list((tmp_path / "run" / ".spool").glob("*.rows")) and time.monotonic() < until:
        time.sleep(0.02)
    return process, psutil.Process(process.pid).children(recursive=True)


@pytest.mark.sampled(0)
def test_a_suspension_longer_than_the_limit_costs_no_run(tmp_path):
    """The supervisor alone, stopped for twice the limit and continued: the run ends as it would have."""
    process, children = started(tmp_path, SLEEPS.format(wall=1.0, seconds="1.0"))
    children[0].suspend()
    time.sleep(4.0)  # the limit of 1 s and the 2 s of grace are over
    children[0].resume()
    out, _ = process.communicate(timeout=300)
    (record,) = store.load(tmp_path / "run").records
    assert (process.returncode, record.status) == (0, "success"), out


@pytest.mark.sampled(0)
def test_a_run_killed_from_outside_is_repeated_once_and_alone(tmp_path):
    """It is said that it was killed, --resume runs it beside no other, and a second time it is its own doing."""
    process, children = started(tmp_path, SLEEPS.format(wall=30.0, seconds="[1.0, 0.0]"))
    children[-1].send_signal(signal.SIGKILL)
    process.communicate(timeout=300)
    killed = next(r for r in store.load(tmp_path / "run").records if r.status == "crashed")
    assert killed.ended_by == "killed" and killed.signal == signal.SIGKILL
    assert main(["run", str(tmp_path / "s.toml"), "--out", str(tmp_path / "run"), "--resume"]) == 0
    assert {r.status for r in store.load(tmp_path / "run").records} == {"success"}
    text = '[[runs]]\nproblem = "free_fall"\nsolver = "kills_itself"'
    plugins = (PLUGIN, HOSTILE)
    ran = [run_suite_text(tmp_path / "own", text, 1, plugins=plugins, resume=k > 0)[1].ran for k in range(3)]
    assert [len(r) for r in ran] == [1, 1, 0]


def test_results_that_vanish_are_counted(tmp_path):
    """Somebody deletes what is done: no exit code 0, and --resume runs it again."""
    text = '[[runs]]\nproblem = "free_fall"\nsolver = ["exact", "deletes_results"]\n'
    with pytest.raises(PoolError, match=r"1 of 2 results .* are gone"):
        run_suite_text(tmp_path / "run", text, 1, plugins=(PLUGIN, HOSTILE))
    again, watcher = run_suite_text(tmp_path / "run", text, 1, plugins=(PLUGIN, HOSTILE), resume=True)
    assert len(watcher.ran) == 1 and {r.status for r in again.records} == {"success"}


def test_a_record_that_changes_behind_the_runner_is_noticed(tmp_path, monkeypatch):
    """Not as it was written: whatever it says now, it is no result."""
    told = Silent.on_end

    def changing(self, job, record):
        path = store.locate_record(job.folder, job.id).path
        path.write_bytes(path.read_bytes().replace(b"success", b"crashed"))
        told(self, job, record)

    monkeypatch.setattr(Silent, "on_end", changing)
    with pytest.raises(PoolError, match="not as they were written"):
        run_suite_text(tmp_path / "run", '[[runs]]\nproblem = "free_fall"\nsolver = "exact"', 1)


@pytest.mark.sampled(0)
def test_a_parent_that_ignores_its_children_changes_nothing(tmp_path):
    """SIGCHLD ignored is inherited: the system would keep no exit code for anybody."""
    suite = tmp_path / "s.toml"
    suite.write_text(f'plugins = ["{PLUGIN}"]\n[[runs]]\nproblem = "free_fall"\nsolver = ["exact", "segfaults"]\n')
    line = (sys.executable, "-m", "mbsbench.cli", "run", str(suite), "--out", str(tmp_path / "run"))
    done = subprocess.run(
        line,
        cwd=environment.ROOT,
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: signal.signal(signal.SIGCHLD, signal.SIG_IGN),
    )
    assert done.returncode == 0, done.stderr
    assert {r.solver: r.status for r in store.load(tmp_path / "run").records} == {
        "exact": "success",
        "segfaults": "crashed",
    }
    assert not [p for p in (tmp_path / "run").rglob(".*.part*") if os.path.lexists(p)]
