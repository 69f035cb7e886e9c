"""Foreign code that hangs, crashes or leaves is told in a line, before it can do so in the command's own process."""

import errno
import time

import numba.core.event
import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.catalogue import trial
from mbsbench.tests.factories import PLUGIN

PROBLEM = """
import os, sys, time
from mbsbench import problem
@problem("foreign")
def foreign():
    {}
"""
SUITE = """
[[runs]]
problem = "foreign"
solver = "gc_weak_form"
"""
LOADED = {
    "import os; os._exit(0)": "exited with code 0 unexpectedly",
    "import os; os.kill(os.getpid(), 11)": "ended by SIGSEGV",
    "while True: pass": "timed out after",
    "import sys; sys.exit()": "SystemExit",
    "x = [0] * 10**10": "MemoryError",
    "raise KeyboardInterrupt": "KeyboardInterrupt",
}
MADE = {
    "return 1 / 0": "ZeroDivisionError: division by zero",
    "return None": "AttributeError",
    "os._exit(0)": "exited with code 0 unexpectedly",
    "sys.exit(0)": "SystemExit",
    "time.sleep(600)": "timed out after",
}


def refused(capsys, words, *line):
    assert main(list(line)) == 2
    out, err = capsys.readouterr()
    assert words in err and err.count("\n") == 1 and not out


@pytest.mark.parametrize("text", LOADED)
def test_a_file_that_does_not_come_back_is_no_plugin(text, tmp_path, capsys, monkeypatch):
    """Above all, one that ends the process in good order: nothing was checked, so nothing is good."""
    monkeypatch.setattr(trial, "LIMIT", 0.5 if "while" in text else trial.LIMIT)
    path = tmp_path / "foreign.py"
    path.write_text(text)
    refused(capsys, LOADED[text], "check", str(path))
    refused(capsys, LOADED[text], "gate", "--plugin", str(path))


def test_a_plugin_that_compiles_long_is_no_plugin_that_hangs(monkeypatch):
    """The limit on its import leaves out what numba compiles."""

    def attempt():
        with numba.core.event.trigger_event("numba:compile"):
            until = time.thread_time() + 1.5
            while time.thread_time() < until:
                pass
        return "loaded"

    monkeypatch.setattr(trial, "LIMIT", 0.5)
    assert trial._try_in_child("plugin", attempt) == ""


@pytest.mark.parametrize("text", MADE)
def test_a_problem_that_cannot_be_made_is_reported(text, tmp_path, capsys, monkeypatch):
    """By run and solve alike, without a traceback."""
    monkeypatch.setattr(trial, "LIMIT", 0.2 if "sleep" in text else trial.LIMIT)
    (tmp_path / "foreign.py").write_text(PROBLEM.format(text))
    (tmp_path / "s.toml").write_text('plugins = ["foreign.py"]' + SUITE)
    refused(capsys, MADE[text], "run", str(tmp_path / "s.toml"), "--out", str(tmp_path / "run"))
    given = ("--plugin", str(tmp_path / "foreign.py"), "--out", str(tmp_path / "x.npz"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mbsbench.harness.catalogue.registry._plugin_files", set())
        patch.setattr("mbsbench.harness.catalogue.registry._plugin_problems", {})
        refused(capsys, MADE[text], "solve", "foreign", "gc_weak_form", *given)
    assert not (tmp_path / "run").exists() and not (tmp_path / "x.npz").exists()


def test_a_full_disk_is_no_crash_of_the_solver(tmp_path, capsys, monkeypatch):
    """``solve`` says so in a line, and leaves nothing."""

    def full(out, arrays):
        raise OSError(errno.ENOSPC, "No space left on device", str(out))

    monkeypatch.setattr("mbsbench.harness.run.run_file.write_npz", full)
    line = ("solve", "free_fall", "exact", "--plugin", str(PLUGIN), "--out", str(tmp_path / "x.npz"))
    refused(capsys, "no space left", *line)
    assert not list(tmp_path.iterdir())
