"""``solve`` ended from outside: its file is whole or not there, what was there before stays, nothing runs on."""

import contextlib
import os
import signal
import subprocess
import sys
import time

import numpy as np
import psutil
import pytest

from mbsbench.harness.base import files
from mbsbench.harness.results import series
from mbsbench.tests.factories import PLUGIN


def started(tmp_path, *more):
    words = ("solve", "free_fall", "sleeps", "--plugin", str(PLUGIN), "--out", "x.npz")
    line = (sys.executable, "-m", "mbsbench.cli", *words)
    process = subprocess.Popen(
        (*line, *more),
        cwd=tmp_path,
        env=dict(os.environ),
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509 a background shell has it ignored
    )
    until = time.monotonic() + 60.0
    while not (children := solving(process.pid)) and time.monotonic() < until:
        time.sleep(0.02)
    return process, children


def solving(pid):
    """The process that integrates; before it, the plugin and its problem are tried in others."""
    found = []
    for child in psutil.Process(pid).children(recursive=True):
        with contextlib.suppress(psutil.NoSuchProcess):
            found += [child] if any("/stderr/" in f.path for f in child.open_files()) else []
    return found


def gone(process: psutil.Process) -> bool:
    until = time.monotonic() + 10.0
    while process.is_running() and process.status() != psutil.STATUS_ZOMBIE and time.monotonic() < until:
        time.sleep(0.02)
    return not process.is_running() or process.status() == psutil.STATUS_ZOMBIE


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("number", "code", "words"), [(signal.SIGINT, 130, True), (signal.SIGTERM, 143, True), (signal.SIGKILL, -9, False)]
)
def test_an_interrupted_solve_leaves_what_was_there(tmp_path, number, code, words):
    """An hour's run goes with its command, even by SIGKILL; an older file of that name is not touched."""
    np.savez(tmp_path / "x.npz", before=np.arange(3))
    process, children = started(tmp_path, "--set", "seconds=600")
    assert len(children) == 1
    time.sleep(0.2)
    process.send_signal(number)
    _, err = process.communicate(timeout=30)
    assert process.returncode == code and gone(children[0])
    assert "Traceback" not in err and ("nothing was written to x.npz" in err) == words and err.count("\n") == words
    assert [p.name for p in tmp_path.iterdir()] == ["x.npz"]
    with np.load(tmp_path / "x.npz") as file:
        assert file.files == ["before"]


@pytest.mark.sampled(1)
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_killed_run_of_solve_is_its_result(tmp_path, number):
    """The process that integrates is killed by somebody: status, message and exit code 1, in a whole file."""
    process, children = started(tmp_path, "--set", "seconds=600")
    time.sleep(0.2)
    children[0].send_signal(number)
    out, err = process.communicate(timeout=30)
    assert process.returncode == 1 and not err and number.name in out
    with np.load(tmp_path / "x.npz", allow_pickle=False) as file:
        assert str(file["status"]) == "crashed" and len(file["t"]) == 1


def test_a_disk_that_is_full_or_a_file_cut_short_is_no_result(tmp_path, monkeypatch):
    """Written beside and renamed: an error on the way leaves the older file and no rest."""
    path = tmp_path / "x.npz"
    series.write_npz(path, {"a": np.arange(3)})
    before = path.read_bytes()

    def full(*arguments, **more):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(files.os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        series.write_npz(path, {"a": np.arange(4)})
    assert path.read_bytes() == before and [p.name for p in tmp_path.iterdir()] == ["x.npz"]
